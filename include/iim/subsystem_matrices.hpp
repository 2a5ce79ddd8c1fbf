// T_ip, F_i, M̄_i, h̄_i and B̄_i of one subsystem as dense matrices: to look at, to check against, to teach with.
// The recursions never form them.
#pragma once

#include <iim/pass/internal_inertia.hpp>
#include <iim/receipt.hpp>

#include <cassert>
#include <cstddef>
#include <vector>

namespace iim {

/// One subsystem i in the paper's terms, V_i = (v_o; ω_o; q̇_i) (6): velocity of the inlet's point that is at i's
/// coupling point, angular velocity of the inlet, internal velocities. All axes are parallel to the world's. A free
/// base's coupling point is its centre of mass.
template <class Scalar>
struct SubsystemMatrices {
  MatrixX<Scalar> T_ip;                ///< (6 + n_i) × (6 + n_p), V_i = T_ip V_p + F_i q̇_i (8); no columns for a root
  VectorX<Scalar> T_ip_dot_V_p;        ///< 6 + n_i: V̇_i = T_ip V̇_p + Ṫ_ip V_p + F_i q̈_i
  MatrixX<Scalar> F;                   ///< (0; 0; 1), (6 + n_i) × n_i (7)
  MatrixX<Scalar> Mbar;                ///< M̄_i, (6 + n_i) square (A5); of an implicit step with hC + h²K
  VectorX<Scalar> hbar;                ///< h̄_i for u = 0: velocity terms, weight, springs (10)
  MatrixX<Scalar> Bbar;                ///< B̄_i of the subsystem's own motors, (6 + n_i) × n_u
  std::vector<MatrixX<Scalar>> frame;  ///< [1 S_k]: twist of frame k at the coupling point from V_i, 6 × (6 + n_i); its
                                       ///< transpose takes a wrench on the frame, about that point, into h̄_i
};

namespace detail {

template <Scene scene, class S, class Workspace>
void add_rotors(const Node& node, const S& s, [[maybe_unused]] const NodeState<S>& state, const Workspace& ws,
                SubsystemMatrices<typename S::Scalar>& m)
{
  using Scalar = typename S::Scalar;
  if constexpr (rotor_count<S>() > 0) {
    for (const auto& rotor : s.rotors()) {
      const SpunRotor<S> spun = spin_rotor<scene, S>(node, rotor, state, ws);
      VectorX<Scalar> g = VectorX<Scalar>::Zero(6 + S::n_i);
      spun.a.put(g.data() + 3);
      g.tail(S::n_i) = spun.e;
      m.Mbar += spun.J * g * g.transpose();
      m.hbar += spun.J * spun.bias * g;
      if constexpr (scene.velocity) {
        Vector6<Scalar> hg = Vector6<Scalar>::Zero();
        Eigen::Matrix<Scalar, S::n_i, 1> hq = Eigen::Matrix<Scalar, S::n_i, 1>::Zero();
        add_gyroscopic(spun, rotor, state, hg, hq);
        m.hbar.head(6) += hg;
        m.hbar.tail(S::n_i) += hq;
      }
    }
  }
}

/// The bodies on one frame, whose twist at the coupling point is G V_i.
template <bool velocity, class Scalar>
void add_bodies(const FrameMass<Scalar>& body, const Matrix3<Scalar>& R, const Vector3<Scalar>& r,
                const Vector3<Scalar>& omega, const Vector6<Scalar>& bias, const MatrixX<Scalar>& G,
                SubsystemMatrices<Scalar>& m)
{
  SpatialInertia<Scalar> inertia;
  TriplePair<Scalar> h_pair;
  place_bodies<true, velocity>(body, R, triple(r), triple(omega), inertia, h_pair);
  Vector6<Scalar> h;
  h_pair.put(h.data());
  const Matrix6<Scalar> A = inertia.dense();
  m.Mbar += G.transpose() * A * G;
  if constexpr (velocity) { m.hbar += G.transpose() * (A * bias + h); }
}

/// What has no part in how the parent moves. Workspace: its part that depends on Scalar and update alone.
template <bool velocity, class S, class Workspace>
void set_matrices(const Node& node, const S& s, const NodeState<S>& state, const Workspace& ws, bool implicit,
                  SubsystemMatrices<typename S::Scalar>& m)
{
  using Scalar = typename S::Scalar;
  constexpr int n_i = S::n_i;
  for (const auto& S_k : state.S_k) {
    m.frame.emplace_back(6, 6 + n_i);
    m.frame.back() << Matrix6<Scalar>::Identity(), S_k;
  }
  m.F.setZero(6 + n_i, n_i);
  m.F.bottomRows(n_i).setIdentity();
  m.Mbar.setZero(6 + n_i, 6 + n_i);
  m.hbar.setZero(6 + n_i);
  m.Bbar.setZero(6 + n_i, S::n_u);
  m.Bbar.bottomRows(n_i) = ws.Bbar().segment(node.bbar, n_i * S::n_u).reshaped(n_i, S::n_u);
  const Vector3<Scalar> zero = Vector3<Scalar>::Zero();
  for (int k = 0; k < S::n_frames; ++k) {
    const FrameState<Scalar>& f = ws.frame(node.frame + k);
    add_bodies<velocity>(ws.tree().frame_mass(node.frame + k), f.R, f.bodies_at(), f.omega, f.bias,
                         m.frame[static_cast<std::size_t>(k)], m);
  }
  const MatrixX<Scalar> inlet = MatrixX<Scalar>::Identity(6, 6 + n_i);
  add_bodies<velocity>(ws.tree().inlet_mass(node.index), ws.inlet_axes(node, state), zero,
                       node.inlet < 0 ? zero : ws.frame(node.inlet).omega, Vector6<Scalar>(Vector6<Scalar>::Zero()),
                       inlet, m);
  add_rotors<Scene{.velocity = velocity}>(node, s, state, ws, m);
  if (implicit) {
    for (const auto& spring : state.springs) {
      m.Mbar.bottomRightCorner(n_i, n_i) += spring.ratio.transpose() * spring.inertia * spring.ratio;
      m.hbar.tail(n_i) += spring.ratio.transpose() * spring.force;
    }
  }
  m.hbar.tail(n_i) -= ws.load().segment(node.v, n_i);
}

}  // namespace detail

/// Subsystem `i` of the tree at the state of the receipt `fd`. Allocates; not for the cycle. A workspace that has been
/// used since is an assertion or, where these are off, a ModelError.
template <class Workspace>
SubsystemMatrices<typename Workspace::Scalar> subsystem_matrices(const ForwardDynamics<Workspace>& fd, Index i)
{
  using Scalar = typename Workspace::Scalar;
  const Workspace& ws = fd.workspace();
  const auto& tree = ws.tree();
  if (fd.status_on(tree) == Status::mismatch) { detail::refuse({"the workspace has been used since the receipt"}); }
  assert(0 <= i && i < tree.size() && "no such subsystem");
  SubsystemMatrices<Scalar> m;
  Vector3<Scalar> r, c;
  tree.visit(i, [&]<class S>(const Node& node, const S& s) {
    const NodeState<S>& state = ws.template node<S>(node);
    const typename Workspace::Data& data = ws;
    r = state.r;
    c = state.c;
    if (fd.scene().velocity) {
      detail::set_matrices<true>(node, s, state, data, fd.scene().implicit, m);
    } else {
      detail::set_matrices<false>(node, s, state, data, fd.scene().implicit, m);
    }
  });
  if (fd.scene().gravity) { m.hbar -= m.Mbar.leftCols(3) * tree.gravity(); }

  const Node& node = tree.node(i);
  const Index size = m.F.rows();
  m.T_ip.setZero(size, 0);
  m.T_ip_dot_V_p.setZero(size);
  if (node.inlet < 0) { return m; }
  MatrixX<Scalar> S_p;
  tree.visit(node.parent, [&]<class P>(const Node& parent, const P&) {
    S_p = ws.template node<P>(parent).S_k[static_cast<std::size_t>(node.inlet - parent.frame)];
  });
  Matrix6<Scalar> X = Matrix6<Scalar>::Identity();
  X.template topRightCorner<3, 3>() = -skew(r);
  m.T_ip.setZero(size, 6 + S_p.cols());
  m.T_ip.template topLeftCorner<6, 6>() = X;
  m.T_ip.topRightCorner(6, S_p.cols()) = X * S_p;
  if (fd.scene().velocity) {
    m.T_ip_dot_V_p.head(6) = X * ws.frame(node.inlet).bias;
    m.T_ip_dot_V_p.head(3) += c;
  }
  return m;
}

}  // namespace iim
