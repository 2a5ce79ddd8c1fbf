// The paper as printed: global matrices, dense, equation by equation. (n) are its equations.
//
// V stacks the V_i, size Σ(6 + n_i). Roots have no parent: their guidance velocities are zero.
#pragma once

#include "../random_tree.hpp"
#include "subsystem.hpp"

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
  Index v = 0;  ///< first of its n_i entries in q̇
  Index V = 0;  ///< first of its 6 + n_i entries in V
  Kinematics<T> joint;
  Dense<T> R0;              ///< frame i to world
  Dense<T> r0;              ///< coupling point in the world
  Dense<T> T_ip, T_ip_dot;  ///< (8), (6 + n_i) × (6 + n_p); empty for roots
  Dense<T> velocity;        ///< V_i
  SubsystemDynamics<T> dynamics;

  Index n_i() const { return joint.n_i(); }
  Index size() const { return 6 + n_i(); }
  const Dense<T>& F() const { return dynamics.F; }
  const Dense<T>& Mbar() const { return dynamics.Mbar; }
};

/// What the three recursions of Sect. 2.3 leave, for one h̄.
template <class T>
struct Recursion {
  std::vector<Dense<T>> M_star, T_star, MbarR_inv, S, h_star, V_dot;
  Dense<T> qdd;
};

/// A robot at one state.
template <class T>
class Literal {
public:
  Literal(const StandardAssembly<T>& assembly, const std::vector<test::NamedInput>& inputs, const Dense<T>& q,
          const Dense<T>& qd)
      : g_(assembly.gravity()), qd_(qd)
  {
    Index next_q = 0;
    grow(assembly, "world", -1, q, next_q);
    Bbar_ = Dense<T>(n_V_, 0);
    for (const test::NamedInput& input : inputs) {
      if (input.active) { Bbar_ = beside(Bbar_, Bbar_of(assembly, input)); }
    }
  }

  Index n() const { return n_v_; }
  const std::vector<Part<T>>& parts() const { return parts_; }
  const Part<T>& parent(const Part<T>& part) const { return parts_[at(part.parent)]; }
  const Dense<T>& qd() const { return qd_; }
  const Dense<T>& gravity() const { return g_; }
  const Dense<T>& Bbar() const { return Bbar_; }  ///< Σ(6 + n_i) × m

  /// (9): blocks T_ia F_a with T_ia = T_ip T_pa.
  Dense<T> F() const
  {
    return propagated([&](std::size_t i) { return parts_[i].T_ip; });
  }

  /// d/dt of (9), block row by block row.
  Dense<T> F_dot() const
  {
    const Dense<T> F = this->F();
    Dense<T> F_dot(n_V_, n_v_);
    for (const Part<T>& part : parts_) {
      if (part.parent < 0) { continue; }
      const Part<T>& p = parent(part);
      F_dot.set(part.V, 0, part.T_ip_dot * F.rows(p.V, p.size()) + part.T_ip * F_dot.rows(p.V, p.size()));
    }
    return F_dot;
  }

  Dense<T> M() const  // (11)
  {
    const Dense<T> F = this->F();
    Dense<T> M(n_v_, n_v_);
    for (const Part<T>& part : parts_) {
      const Dense<T> F_i = F.rows(part.V, part.size());
      M += F_i.transpose() * part.Mbar() * F_i;
    }
    return M;
  }

  Dense<T> h() const  // (12)
  {
    const Dense<T> F = this->F();
    const Dense<T> F_dot_qd = F_dot() * qd_;
    Dense<T> h(n_v_);
    for (const Part<T>& part : parts_) {
      h += F.rows(part.V, part.size()).transpose() *
           (part.Mbar() * F_dot_qd.rows(part.V, part.size()) + part.dynamics.hbar);
    }
    return h;
  }

  Dense<T> B() const { return F().transpose() * Bbar_; }  // (13)

  /// (14)–(19) for h̄_i = h̄_0i − B̄_i u.
  Recursion<T> recursion(const Dense<T>& u) const
  {
    const std::size_t N = parts_.size();
    const Dense<T> Bu = Bbar_ * u;
    Recursion<T> r;
    r.T_star.resize(N);
    r.MbarR_inv.resize(N);
    r.S.resize(N);
    r.V_dot.resize(N);
    r.qdd = Dense<T>(n_v_);
    for (const Part<T>& part : parts_) {
      r.M_star.push_back(part.Mbar());
      r.h_star.push_back(part.dynamics.hbar - Bu.rows(part.V, part.size()));
    }
    for (std::size_t i = N; i-- > 0;) {
      const Part<T>& part = parts_[i];
      const Dense<T> FT = part.F().transpose();
      r.MbarR_inv[i] = inverse(FT * r.M_star[i] * part.F());  // (17)
      r.S[i] = part.F() * r.MbarR_inv[i] * FT;
      if (part.parent < 0) { continue; }
      const std::size_t p = at(part.parent);
      r.T_star[i] = (Dense<T>::identity(part.size()) - r.M_star[i] * r.S[i]).transpose() * part.T_ip;  // (16)
      const Dense<T> T_starT = r.T_star[i].transpose();
      r.M_star[p] += T_starT * r.M_star[i] * part.T_ip;                                             // (14)
      r.h_star[p] += T_starT * (r.M_star[i] * (part.T_ip_dot * parts_[p].velocity) + r.h_star[i]);  // (15)
    }
    for (std::size_t i = 0; i < N; ++i) {
      const Part<T>& part = parts_[i];
      Dense<T> guided(part.size());
      if (part.parent >= 0) { guided = part.T_ip * r.V_dot[at(part.parent)] + part.T_ip_dot * parent(part).velocity; }
      const Dense<T> qdd_i = -(r.MbarR_inv[i] * (part.F().transpose() * (r.M_star[i] * guided + r.h_star[i])));  // (18)
      r.qdd.set(part.v, 0, qdd_i);
      r.V_dot[i] = guided + part.F() * qdd_i;  // (19), Ḟ_i = 0
    }
    return r;
  }

  /// (31): blocks T*_ia F_a.
  Dense<T> F_star(const Recursion<T>& r) const
  {
    return propagated([&](std::size_t i) { return r.T_star[i]; });
  }

  /// (25) as a whole, Σ(6 + n_i) square.
  Dense<T> T_star(const Recursion<T>& r) const
  {
    Dense<T> T_star = Dense<T>::identity(n_V_);
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const Part<T>& part = parts_[i];
      if (part.parent < 0) { continue; }
      const Part<T>& p = parent(part);
      T_star.set(part.V, 0, r.T_star[i] * T_star.block(p.V, 0, p.size(), part.V));
    }
    return T_star;
  }

  /// diag(F_i), Σ(6 + n_i) × n.
  Dense<T> diag_F() const
  {
    Dense<T> D(n_V_, n_v_);
    for (const Part<T>& part : parts_) { D.set(part.V, part.v, part.F()); }
    return D;
  }

  /// diag(M̄_Ri⁻¹), n × n.
  Dense<T> diag_MbarR_inv(const Recursion<T>& r) const
  {
    Dense<T> D(n_v_, n_v_);
    for (std::size_t i = 0; i < parts_.size(); ++i) { D.set(parts_[i].v, parts_[i].v, r.MbarR_inv[i]); }
    return D;
  }

  /// Γ = diag(M̄_R⁻¹ Fᵀ M̄*) F, before (32).
  Dense<T> Gamma(const Recursion<T>& r) const
  {
    Dense<T> D(n_v_, n_V_);
    for (std::size_t i = 0; i < parts_.size(); ++i) { D.set(parts_[i].v, parts_[i].V, gain(r, i)); }
    return D * F();
  }

  /// (33)–(35): Γ⁻¹ by growing it, A_i⁻¹ = [ A_p⁻¹ 0 ; −C_i A_p⁻¹  1 ].
  Dense<T> Gamma_inv_cascade(const Dense<T>& Gamma) const
  {
    Dense<T> A_inv(0, 0);
    for (const Part<T>& part : parts_) {
      const Index old = part.v, n = part.n_i();
      Dense<T> grown(old + n, old + n);
      grown.set(0, 0, A_inv);
      grown.set(old, 0, -(Gamma.block(old, 0, n, old) * A_inv));
      grown.set(old, old, Dense<T>::identity(n));
      A_inv = grown;
    }
    return A_inv;
  }

  /// (47): row i of F̂ is row p(i) of F*, or zero.
  Dense<T> F_hat(const Recursion<T>& r, std::size_t i) const
  {
    const Part<T>& part = parts_[i];
    if (part.parent < 0) { return Dense<T>(6, n_v_); }
    return F_star(r).rows(parent(part).V, parent(part).size());
  }

  /// (48); its example for three links is (44).
  Dense<T> Gamma_inv(const Recursion<T>& r) const
  {
    Dense<T> result = Dense<T>::identity(n_v_);
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const Part<T>& part = parts_[i];
      if (part.parent < 0) { continue; }
      result.set(part.v, 0, result.rows(part.v, part.n_i()) - gain(r, i) * part.T_ip * F_hat(r, i));
    }
    return result;
  }

  /// (50).
  Dense<T> Bhat(const Recursion<T>& r) const
  {
    return Gamma_inv(r) * diag_MbarR_inv(r) * F_star(r).transpose() * Bbar_;
  }

  /// Algorithm 1, steps 2 and 3, line by line.
  Dense<T> algorithm_1(const Recursion<T>& r) const
  {
    const std::size_t N = parts_.size();
    Dense<T> F_star(n_V_, n_v_), Gamma_inv(n_v_, n_v_);
    for (std::size_t i = 0; i < N; ++i) {
      const Part<T>& part = parts_[i];
      F_star.set(part.V, part.v, part.F());
      Gamma_inv.set(part.v, part.v, Dense<T>::identity(part.n_i()));
      if (part.parent < 0) { continue; }
      const Dense<T> F_star_p = F_star.block(parent(part).V, 0, parent(part).size(), part.v);
      F_star.set(part.V, 0, r.T_star[i] * F_star_p);
      Gamma_inv.set(part.v, 0, -(gain(r, i) * part.T_ip * F_star_p));
    }
    Dense<T> Bhat(n_v_, Bbar_.cols());
    for (std::size_t i = N; i-- > 0;) {
      const Part<T>& part = parts_[i];
      const Index rows = n_v_ - part.v, below = n_V_ - part.V;
      const Dense<T> F_star_i = F_star.block(part.V, part.v, below, part.n_i());
      Bhat.set(part.v, 0,
               Bhat.rows(part.v, rows) + Gamma_inv.block(part.v, part.v, rows, part.n_i()) * r.MbarR_inv[i] *
                                             F_star_i.transpose() * Bbar_.rows(part.V, below));
    }
    return Bhat;
  }

private:
  static std::size_t at(Index i) { return static_cast<std::size_t>(i); }

  /// M̄_R⁻¹ Fᵀ M̄*.
  Dense<T> gain(const Recursion<T>& r, std::size_t i) const
  {
    return r.MbarR_inv[i] * parts_[i].F().transpose() * r.M_star[i];
  }

  /// Subsystems depth first, brothers in the order of adding, with their kinematics (6), (8) and dynamics.
  void grow(const StandardAssembly<T>& assembly, const std::string& parent_name, Index parent, const Dense<T>& q,
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
            part.joint = kinematics_of<T>(s, q.rows(next_q, S::n_q), qd_.rows(n_v_, S::n_i));
            next_q += S::n_q;
          },
          named.part);
      part.R0 = named.on.R;
      part.r0 = named.on.p;
      part.velocity = Dense<T>(part.size());
      if (parent >= 0) {
        const Part<T>& p = parts_[at(parent)];
        const MovedPoint<T> outlet = p.joint.moved(part.r0);
        const TwistMap<T> map(outlet, part.R0);
        part.T_ip = stacked(map.G, Dense<T>(part.n_i(), p.size()));
        part.T_ip_dot = stacked(map.G_dot, Dense<T>(part.n_i(), p.size()));
        part.R0 = p.R0 * outlet.E * part.R0;
        part.r0 = p.r0 + p.R0 * outlet.r;
        part.velocity = part.T_ip * p.velocity;
      }
      SubsystemDynamics<T> dynamics(part.n_i());
      part.velocity += dynamics.F * part.joint.qd;  // (6)
      const Dense<T> g = part.R0.transpose() * g_;
      std::visit([&](const auto& s) { part.dynamics = dynamics_of<T>(s, part.joint, g, part.velocity); }, named.part);
      n_v_ += part.n_i();
      n_V_ += part.size();
      const Index self = static_cast<Index>(parts_.size());
      parts_.push_back(part);
      grow(assembly, named.name, self, q, next_q);
    }
  }

  /// Global rows of one input, −∂h̄/∂u.
  Dense<T> Bbar_of(const StandardAssembly<T>& assembly, const test::NamedInput& input) const
  {
    std::string owner = input.name;
    Dense<T> R = Dense<T>::identity(3), x(input.point);
    for (const auto& frame : assembly.named_frames()) {
      if (frame.name == input.name) {
        owner = frame.on.parent;
        R = frame.on.R;
        x = R * x + Dense<T>(frame.on.p);
      }
    }
    for (const Part<T>& part : parts_) {
      if (part.name != owner) { continue; }
      Dense<T> block = part.dynamics.Bbar;
      if (input.kind != InputKind::motor) {
        // Velocity of the point in the axes of the force, from V_i; its transpose is B̄_i.
        const MovedPoint<T> moved = part.joint.moved(x);
        const Dense<T> axes = input.axes == Axes::body ? R : (part.R0 * moved.E).transpose();
        block = TwistMap<T>(moved, axes).G.head(input.kind == InputKind::force ? 3 : 6).transpose();
      }
      Dense<T> global(n_V_, block.cols());
      global.set(part.V, 0, block);
      return global;
    }
    throw ModelError("no part for input '" + input.name + "'");
  }

  /// Σ(6 + n_i) × n with F_i on the diagonal and X_ia F_a, X_ia = X_ip X_pa, below it.
  template <class Transform>
  Dense<T> propagated(Transform&& X_ip) const
  {
    Dense<T> result(n_V_, n_v_);
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const Part<T>& part = parts_[i];
      if (part.parent >= 0) { result.set(part.V, 0, X_ip(i) * result.rows(parent(part).V, parent(part).size())); }
      result.set(part.V, part.v, part.F());
    }
    return result;
  }

  std::vector<Part<T>> parts_;
  Dense<T> g_;
  Dense<T> qd_;
  Dense<T> Bbar_;
  Index n_v_ = 0;
  Index n_V_ = 0;
};

/// B̂ = M⁻¹B and q̈₀ = −M⁻¹h (2) by the global matrices.
template <class T>
std::pair<Dense<T>, Dense<T>> direct_solution(const Literal<T>& robot)
{
  const Dense<T> M = robot.M();
  return {solve(M, robot.B()), -solve(M, robot.h())};
}

}  // namespace iim::reference
