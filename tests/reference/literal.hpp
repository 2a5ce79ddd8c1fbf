// The paper as printed: global matrices, dense, equation by equation. (n) are its equations.
//
// V stacks the V_i, size Σ(6 + n_i). Roots have no parent: their guidance velocities are zero.
#pragma once

#include "../random_tree.hpp"
#include "subsystem.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace iim::reference {

/// One subsystem in the tree.
template <class T>
struct Part {
  std::string name;
  Index parent = -1;
  Index v = 0;          ///< first of its n_i entries in q̇
  Index V = 0;          ///< first of its 6 + n_i entries in V
  Kinematics<T> joint;
  Matrix3<T> R0;        ///< frame i to world
  Vector3<T> r0;        ///< coupling point in the world
  MatrixX<T> T_ip, T_ip_dot;  ///< (8), (6 + n_i) × (6 + n_p); empty for roots
  VectorX<T> velocity;        ///< V_i
  SubsystemDynamics<T> dynamics{0};

  Index n_i() const { return joint.n_i(); }
  Index size() const { return 6 + n_i(); }
};

/// What the three recursions of Sect. 2.3 leave, for one h̄.
template <class T>
struct Recursion {
  std::vector<MatrixX<T>> M_star, T_star, MbarR_inv, S;
  std::vector<VectorX<T>> h_star, V_dot;
  VectorX<T> qdd;
};

template <class T>
MatrixX<T> inverse(const MatrixX<T>& A)
{
  if (A.rows() == 0) { return A; }
  return A.fullPivLu().inverse();
}

/// A robot at one state.
template <class T>
class Literal {
public:
  Literal(const StandardAssembly<T>& assembly, const std::vector<test::NamedInput>& inputs, const VectorX<T>& q,
          const VectorX<T>& qd)
      : g_(assembly.gravity()), qd_(qd)
  {
    Index next_q = 0;
    grow(assembly, "world", -1, q, next_q);
    MatrixX<T> Bbar(n_V_, 0);
    for (const test::NamedInput& input : inputs) {
      if (!input.active) { continue; }
      const MatrixX<T> block = Bbar_of(assembly, input);
      Bbar.conservativeResize(Eigen::NoChange, Bbar.cols() + block.cols());
      Bbar.rightCols(block.cols()) = block;
    }
    Bbar_ = Bbar;
  }

  Index n() const { return n_v_; }
  const std::vector<Part<T>>& parts() const { return parts_; }
  const MatrixX<T>& Bbar() const { return Bbar_; }  ///< Σ(6 + n_i) × m

  /// (9): blocks T_ia F_a with T_ia = T_ip T_pa.
  MatrixX<T> F() const { return propagated([](const Part<T>& part, std::size_t) { return part.T_ip; }); }

  /// d/dt of (9), block row by block row.
  MatrixX<T> F_dot() const
  {
    const MatrixX<T> F = this->F();
    MatrixX<T> F_dot = MatrixX<T>::Zero(n_V_, n_v_);
    for (const Part<T>& part : parts_) {
      if (part.parent < 0) { continue; }
      const Part<T>& p = parts_[at(part.parent)];
      F_dot.middleRows(part.V, part.size()) = part.T_ip_dot * F.middleRows(p.V, p.size()) +
                                              part.T_ip * F_dot.middleRows(p.V, p.size());
    }
    return F_dot;
  }

  MatrixX<T> M() const  // (11)
  {
    const MatrixX<T> F = this->F();
    MatrixX<T> M = MatrixX<T>::Zero(n_v_, n_v_);
    for (const Part<T>& part : parts_) {
      const MatrixX<T> F_i = F.middleRows(part.V, part.size());
      M += F_i.transpose() * part.dynamics.Mbar * F_i;
    }
    return M;
  }

  VectorX<T> h() const  // (12)
  {
    const MatrixX<T> F = this->F();
    const VectorX<T> F_dot_qd = F_dot() * qd_;
    VectorX<T> h = VectorX<T>::Zero(n_v_);
    for (const Part<T>& part : parts_) {
      h += F.middleRows(part.V, part.size()).transpose() *
           (part.dynamics.Mbar * F_dot_qd.segment(part.V, part.size()) + part.dynamics.hbar);
    }
    return h;
  }

  MatrixX<T> B() const { return F().transpose() * Bbar_; }  // (13)

  /// (14)–(19) for h̄_i = h̄_0i − B̄_i u.
  Recursion<T> recursion(const VectorX<T>& u) const
  {
    const std::size_t N = parts_.size();
    const VectorX<T> Bu = Bbar_ * u;
    Recursion<T> r;
    r.T_star.resize(N);
    r.MbarR_inv.resize(N);
    r.S.resize(N);
    r.V_dot.resize(N);
    r.qdd = VectorX<T>::Zero(n_v_);
    for (const Part<T>& part : parts_) {
      r.M_star.push_back(part.dynamics.Mbar);
      r.h_star.push_back(part.dynamics.hbar - Bu.segment(part.V, part.size()));
    }
    for (std::size_t i = N; i-- > 0;) {
      const Part<T>& part = parts_[i];
      const MatrixX<T>& F = part.dynamics.F;
      r.MbarR_inv[i] = inverse<T>(F.transpose() * r.M_star[i] * F);  // (17)
      r.S[i] = F * r.MbarR_inv[i] * F.transpose();
      if (part.parent < 0) { continue; }
      const std::size_t p = at(part.parent);
      const MatrixX<T> I = MatrixX<T>::Identity(part.size(), part.size());
      r.T_star[i] = (I - r.M_star[i] * r.S[i]).transpose() * part.T_ip;  // (16)
      r.M_star[p] += r.T_star[i].transpose() * r.M_star[i] * part.T_ip;  // (14)
      r.h_star[p] += r.T_star[i].transpose() * (r.M_star[i] * (part.T_ip_dot * parts_[p].velocity) + r.h_star[i]);  // (15)
    }
    for (std::size_t i = 0; i < N; ++i) {
      const Part<T>& part = parts_[i];
      const MatrixX<T>& F = part.dynamics.F;
      VectorX<T> guided = VectorX<T>::Zero(part.size());
      if (part.parent >= 0) {
        guided = part.T_ip * r.V_dot[at(part.parent)] + part.T_ip_dot * parts_[at(part.parent)].velocity;
      }
      const VectorX<T> qdd_i = -(r.MbarR_inv[i] * (F.transpose() * (r.M_star[i] * guided + r.h_star[i])));  // (18)
      r.qdd.segment(part.v, part.n_i()) = qdd_i;
      r.V_dot[i] = guided + F * qdd_i;  // (19), Ḟ_i = 0
    }
    return r;
  }

  /// (14) again with T*ᵀ M̄* T* in place of T*ᵀ M̄* T: the two are equal.
  MatrixX<T> star_congruence(const Recursion<T>& r, std::size_t i) const
  {
    return r.T_star[i].transpose() * r.M_star[i] * r.T_star[i];
  }

  /// (31): blocks T*_ia F_a.
  MatrixX<T> F_star(const Recursion<T>& r) const
  {
    return propagated([&](const Part<T>&, std::size_t i) { return r.T_star[i]; });
  }

  /// (25) as a whole, Σ(6 + n_i) square.
  MatrixX<T> T_star(const Recursion<T>& r) const
  {
    MatrixX<T> T_star = MatrixX<T>::Identity(n_V_, n_V_);
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const Part<T>& part = parts_[i];
      if (part.parent < 0) { continue; }
      const Part<T>& p = parts_[at(part.parent)];
      T_star.middleRows(part.V, part.size()).leftCols(part.V) =
          r.T_star[i] * T_star.middleRows(p.V, p.size()).leftCols(part.V);
    }
    return T_star;
  }

  /// diag(F_i), Σ(6 + n_i) × n.
  MatrixX<T> diag_F() const
  {
    MatrixX<T> D = MatrixX<T>::Zero(n_V_, n_v_);
    for (const Part<T>& part : parts_) { D.block(part.V, part.v, part.size(), part.n_i()) = part.dynamics.F; }
    return D;
  }

  /// diag(M̄_Ri⁻¹), n × n.
  MatrixX<T> diag_MbarR_inv(const Recursion<T>& r) const
  {
    MatrixX<T> D = MatrixX<T>::Zero(n_v_, n_v_);
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      D.block(parts_[i].v, parts_[i].v, parts_[i].n_i(), parts_[i].n_i()) = r.MbarR_inv[i];
    }
    return D;
  }

  /// Γ = diag(M̄_R⁻¹ Fᵀ M̄*) F, before (32).
  MatrixX<T> Gamma(const Recursion<T>& r) const
  {
    MatrixX<T> D = MatrixX<T>::Zero(n_v_, n_V_);
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const Part<T>& part = parts_[i];
      D.block(part.v, part.V, part.n_i(), part.size()) = r.MbarR_inv[i] * part.dynamics.F.transpose() * r.M_star[i];
    }
    return D * F();
  }

  /// (33)–(35): Γ⁻¹ by growing it, A_i⁻¹ = [ A_p⁻¹ 0 ; −C_i A_p⁻¹  1 ].
  MatrixX<T> Gamma_inv_cascade(const MatrixX<T>& Gamma) const
  {
    MatrixX<T> A_inv(0, 0);
    for (const Part<T>& part : parts_) {
      const Index old = part.v;
      MatrixX<T> grown = MatrixX<T>::Zero(old + part.n_i(), old + part.n_i());
      grown.topLeftCorner(old, old) = A_inv;
      grown.bottomLeftCorner(part.n_i(), old) = -(Gamma.block(part.v, 0, part.n_i(), old) * A_inv);
      grown.bottomRightCorner(part.n_i(), part.n_i()).setIdentity();
      A_inv = grown;
    }
    return A_inv;
  }

  /// (48), with F̂ of (47); its example for three links is (44).
  MatrixX<T> Gamma_inv(const Recursion<T>& r) const
  {
    const MatrixX<T> F_star = this->F_star(r);
    MatrixX<T> result = MatrixX<T>::Identity(n_v_, n_v_);
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const Part<T>& part = parts_[i];
      if (part.parent < 0) { continue; }  // (47): f_i = 0
      const Part<T>& p = parts_[at(part.parent)];
      result.middleRows(part.v, part.n_i()) -= r.MbarR_inv[i] * part.dynamics.F.transpose() * r.M_star[i] * part.T_ip *
                                               F_star.middleRows(p.V, p.size());
    }
    return result;
  }

  /// (50).
  MatrixX<T> Bhat(const Recursion<T>& r) const
  {
    return Gamma_inv(r) * diag_MbarR_inv(r) * F_star(r).transpose() * Bbar_;
  }

  /// Algorithm 1, steps 2 and 3, line by line; "1:p" is the ancestors of i.
  MatrixX<T> algorithm_1(const Recursion<T>& r) const
  {
    const std::size_t N = parts_.size();
    MatrixX<T> F_star = MatrixX<T>::Zero(n_V_, n_v_);
    MatrixX<T> Gamma_inv = MatrixX<T>::Zero(n_v_, n_v_);
    for (std::size_t i = 0; i < N; ++i) {
      const Part<T>& part = parts_[i];
      const Index n = part.n_i();
      F_star.block(part.V, part.v, part.size(), n) = part.dynamics.F;
      Gamma_inv.block(part.v, part.v, n, n).setIdentity();
      if (part.parent < 0) { continue; }
      const Part<T>& p = parts_[at(part.parent)];
      const MatrixX<T> row = F_star.block(p.V, 0, p.size(), part.v);
      F_star.block(part.V, 0, part.size(), part.v) = r.T_star[i] * row;
      Gamma_inv.block(part.v, 0, n, part.v) =
          -(r.MbarR_inv[i] * part.dynamics.F.transpose() * r.M_star[i] * part.T_ip * row);
    }
    MatrixX<T> Bhat = MatrixX<T>::Zero(n_v_, Bbar_.cols());
    for (std::size_t i = N; i-- > 0;) {
      const Part<T>& part = parts_[i];
      const Index rows = n_v_ - part.v, below = n_V_ - part.V;
      Bhat.bottomRows(rows) += Gamma_inv.block(part.v, part.v, rows, part.n_i()) * r.MbarR_inv[i] *
                               F_star.block(part.V, part.v, below, part.n_i()).transpose() * Bbar_.bottomRows(below);
    }
    return Bhat;
  }

private:
  static std::size_t at(Index i) { return static_cast<std::size_t>(i); }

  /// Subsystems depth first, brothers in the order of adding, with their kinematics (6), (8) and dynamics.
  void grow(const StandardAssembly<T>& assembly, const std::string& parent_name, Index parent, const VectorX<T>& q,
            Index& next_q)
  {
    for (const auto& named : assembly.parts()) {
      if (named.on.parent != parent_name) { continue; }
      Part<T> part;
      part.name = named.name;
      part.parent = parent;
      part.v = n_v_;
      part.V = n_V_;
      std::visit(
          [&]<class S>(const S& s) {
            part.joint = kinematics_of<T>(s, q.segment(next_q, S::n_q), qd_.segment(n_v_, S::n_i));
            next_q += S::n_q;
          },
          named.part);
      part.R0 = named.on.R;
      part.r0 = named.on.p;
      part.velocity = VectorX<T>::Zero(part.size());
      if (parent >= 0) {
        const Part<T>& p = parts_[at(parent)];
        const MovedPoint<T> outlet = p.joint.moved(named.on.p);
        const TwistMap<T> map(outlet, named.on.R);
        part.T_ip = MatrixX<T>::Zero(part.size(), p.size());
        part.T_ip.topRows(6) = map.G;
        part.T_ip_dot = MatrixX<T>::Zero(part.size(), p.size());
        part.T_ip_dot.topRows(6) = map.G_dot;
        part.R0 = p.R0 * outlet.E * named.on.R;
        part.r0 = p.r0 + p.R0 * outlet.r;
        part.velocity = part.T_ip * p.velocity;  // (6)
      }
      part.velocity.tail(part.n_i()) += part.joint.qd;
      const Vector3<T> g = part.R0.transpose() * g_;
      std::visit([&](const auto& s) { part.dynamics = dynamics_of<T>(s, part.joint, g, part.velocity); }, named.part);
      n_v_ += part.n_i();
      n_V_ += part.size();
      const Index self = static_cast<Index>(parts_.size());
      parts_.push_back(part);
      grow(assembly, named.name, self, q, next_q);
    }
  }

  /// Global rows of one input, −∂h̄/∂u.
  MatrixX<T> Bbar_of(const StandardAssembly<T>& assembly, const test::NamedInput& input) const
  {
    std::string owner = input.name;
    Placement<T> on_part;
    for (const auto& frame : assembly.named_frames()) {
      if (frame.name == input.name) {
        owner = frame.on.parent;
        on_part = {frame.on.R, frame.on.p};
      }
    }
    for (const Part<T>& part : parts_) {
      if (part.name != owner) { continue; }
      MatrixX<T> block;
      if (input.kind == InputKind::motor) {
        block = part.dynamics.Bbar;
      } else {
        const Vector3<T> x = on_part.R * input.point.template cast<T>() + on_part.p;
        const MovedPoint<T> moved = part.joint.moved(x);
        // Velocity of the point in the axes of the force, from V_i; its transpose is B̄_i.
        const Matrix3<T> axes = input.axes == Axes::body ? on_part.R : Matrix3<T>((part.R0 * moved.E).transpose());
        block = TwistMap<T>(moved, axes).G.topRows(input.kind == InputKind::force ? 3 : 6).transpose();
      }
      MatrixX<T> global = MatrixX<T>::Zero(n_V_, block.cols());
      global.middleRows(part.V, part.size()) = block;
      return global;
    }
    throw ModelError("no part for input '" + input.name + "'");
  }

  /// Σ(6 + n_i) × n with F_i on the diagonal and transforms X_ia F_a, X_ia = X_ip X_pa, below it.
  template <class Transform>
  MatrixX<T> propagated(Transform&& transform) const
  {
    MatrixX<T> result = MatrixX<T>::Zero(n_V_, n_v_);
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const Part<T>& part = parts_[i];
      if (part.parent >= 0) {
        const Part<T>& p = parts_[at(part.parent)];
        result.middleRows(part.V, part.size()) = transform(part, i) * result.middleRows(p.V, p.size());
      }
      result.block(part.V, part.v, part.size(), part.n_i()) = part.dynamics.F;
    }
    return result;
  }

  std::vector<Part<T>> parts_;
  Vector3<T> g_;
  VectorX<T> qd_;
  MatrixX<T> Bbar_;
  Index n_v_ = 0;
  Index n_V_ = 0;
};

/// B̂ = M⁻¹B and q̈₀ = −M⁻¹h (2) by the global matrices.
template <class T>
std::pair<MatrixX<T>, VectorX<T>> direct_solution(const Literal<T>& robot)
{
  if (robot.n() == 0) { return {robot.B(), robot.h()}; }
  const Eigen::LLT<MatrixX<T>> M(robot.M());
  return {M.solve(robot.B()), VectorX<T>(-M.solve(robot.h()))};
}

}  // namespace iim::reference
