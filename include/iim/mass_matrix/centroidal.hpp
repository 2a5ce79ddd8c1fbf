// Momentum of all bodies of a tree about their centre of mass: A_G with p_G = A_G q̇, and Ȧ_G q̇.
//
// Outward, each frame's acceleration for q̈ = 0 and the wrenches that its bodies' motion takes; inward, the inertia I_k
// of all that frame k carries. With rotors of axial inertia J, axis a, rate ratio·q̇ relative to their carrier:
//
//     A_G(:, i) = X(o_i − c)⁻ᵀ (Σ_k I_k S_k + Σ J (0; a) ratio)          o_i coupling point, c centre of mass
#pragma once

#include <iim/body.hpp>
#include <iim/mass_matrix/composite_body.hpp>
#include <iim/numerics/array.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/tree.hpp>
#include <iim/workspace.hpp>

#include <array>
#include <cstddef>

namespace iim {

namespace detail {

/// Column d, entry by entry: Eigen has no column of a 6 × 0 matrix.
template <class Scalar, int n>
[[gnu::always_inline]] inline Vector6<Scalar> column(const Eigen::Matrix<Scalar, 6, n>& m, int d)
{
  Vector6<Scalar> c;
  for (int i = 0; i < 6; ++i) { c(i) = m(i, d); }
  return c;
}

/// A_G, Ȧ_G q̇ and the centre of mass, in two passes over the tree. Lengths are taken from the first root's coupling
/// point, not from the world's origin, so that the robot's place in the world does not matter.
template <class Tree, Scene scene>
class CentroidalPass {
public:
  using Scalar = typename Tree::Scalar;

  explicit CentroidalPass(const Tree& tree)
      : tree_(&tree), frames_(static_cast<std::size_t>(tree.n_frames()) + 1), A_G_(6, tree.n_v())
  {
    for (Index i = 0; i < tree.size(); ++i) { mass_ += tree.inlet_mass(i).mass; }
    for (Index f = 0; f < tree.n_frames(); ++f) { mass_ += tree.frame_mass(f).mass; }
  }

  const Scalar& mass() const { return mass_; }
  Vector3<Scalar> com() const { return reference_ + com_; }  ///< world axes [m]
  const Eigen::Matrix<Scalar, 6, Eigen::Dynamic>& A_G() const { return A_G_; }
  const Vector6<Scalar>& Adot_G_qd() const { return rate_; }

  template <class Workspace>
  void operator()(const Workspace& ws)
  {
    At& world = at(-1);
    world.carried.set_zero();
    world.origin.setZero();
    world.omega.setZero();
    world.a.setZero();
    first_moment_.setZero();
    rate_.setZero();
    tree_->outward([&]<class N, class S>(const N& node, const S& s) { place<S>(node, s, ws); });
    for (int i = 0; i < 3; ++i) { com_(i) = first_moment_(i) / mass_; }
    rate_ = shift_wrench(Vector3<Scalar>(-com_), rate_);
    tree_->inward([&]<class N, class S>(const N& node, const S& s) { columns<S>(node, s, ws); });
  }

private:
  /// What is known of a frame; lengths from the reference, moments about the frame's coupling point.
  struct At {
    CompositeBody<Scalar> carried;
    Vector3<Scalar> origin;  ///< coupling point
    Vector3<Scalar> omega;
    Vector6<Scalar> a;  ///< acceleration at the coupling point for q̈ = 0
  };

  At& at(Index frame) { return frames_[static_cast<std::size_t>(frame + 1)]; }  // −1: the world

  /// A subsystem's bodies and rotors, and what they add to the momentum's rate for q̈ = 0.
  template <class S, class N, class Workspace>
  void place(const N& node, const S& s, const Workspace& ws)
  {
    const NodeState<S>& state = ws.template node<S>(node);
    if (node.index == 0) { reference_ = state.r; }
    At& inlet = at(node.inlet);
    const Vector3<Scalar> r = from_inlet(node, state);
    Vector6<Scalar> y = shift_twist(r, inlet.a);
    if constexpr (scene.velocity) {
      for (int i = 0; i < 3; ++i) { y(i) += state.c(i); }
    }
    for (int k = 0; k < S::n_frames; ++k) {
      const FrameState<Scalar>& f = ws.frame(node.frame + k);
      At& frame = at(node.frame + k);
      frame.carried.set_zero();
      frame.origin = inlet.origin + r;
      frame.a = y;
      frame.omega.setZero();
      if constexpr (scene.velocity) {
        add(frame.a, f.bias);
        frame.omega = f.omega;
      }
      add_body(tree_->frame_mass(node.frame + k), f.R, f.r, frame);
    }
    add_body(tree_->inlet_mass(node.index), ws.inlet_axes(node, state), r, inlet);

    for_each_coupled_rotor<S>(s, [&](const auto& rotor) {
      At& carrier = at(rotor.frame < 0 ? node.inlet : node.frame + rotor.frame);
      const Vector3<Scalar> a = rotor_axis<S>(rotor, node, state, ws);
      carrier.carried.add_rotor(rotor.inertia, a);
      if constexpr (scene.velocity) {
        // Spin momentum J (a·ω + ratio q̇) a: grows with the carrier's acceleration along a and turns with the carrier.
        const Vector3<Scalar> turning = cross(carrier.omega, a);
        Scalar spin = a(0) * carrier.omega(0) + a(1) * carrier.omega(1) + a(2) * carrier.omega(2);
        for (int d = 0; d < S::n_i; ++d) { spin += rotor.ratio(d) * state.qd(d); }
        const Scalar growth = a(0) * carrier.a(3) + a(1) * carrier.a(4) + a(2) * carrier.a(5);
        for (int i = 0; i < 3; ++i) { rate_(i + 3) += rotor.inertia * (spin * turning(i) + growth * a(i)); }
      }
    });
  }

  /// One body on a frame whose origin is r from the point that `frame` is about.
  void add_body(const FrameMass<Scalar>& body, const Matrix3<Scalar>& R, const Vector3<Scalar>& r, At& frame)
  {
    if (!body.present) { return; }
    Vector3<Scalar> x = r;
    add(x, times(R, body.com));
    const Symmetric3<Scalar> Theta = Symmetric3<Scalar>::turned(R, body.central_inertia);
    CompositeBody<Scalar> central;
    central.mass = body.mass;
    central.mc.setZero();
    central.Theta = Theta;
    frame.carried.add_shifted(central, x);
    for (int i = 0; i < 3; ++i) { first_moment_(i) += body.mass * (frame.origin(i) + x(i)); }

    if constexpr (scene.velocity) {
      const Vector3<Scalar>& w = frame.omega;
      const Vector6<Scalar> a = shift_twist(x, frame.a);
      const Vector3<Scalar> inward = cross(w, cross(w, x));
      const Vector3<Scalar> gyroscopic = cross(w, Theta * w);
      const Vector3<Scalar> growth = Theta * angular(a);
      Vector6<Scalar> wrench;
      for (int i = 0; i < 3; ++i) {
        wrench(i) = body.mass * (a(i) + inward(i));
        wrench(i + 3) = growth(i) + gyroscopic(i);
      }
      add(rate_, shift_wrench(Vector3<Scalar>(frame.origin + x), wrench));
    }
  }

  /// Columns of A_G for q̇_i; then what i carries is carried by its inlet.
  template <class S, class N, class Workspace>
  void columns(const N& node, const S& s, const Workspace& ws)
  {
    const NodeState<S>& state = ws.template node<S>(node);
    const Vector3<Scalar> from_com = at(node.frame).origin - com_;
    std::array<Vector6<Scalar>, S::n_i> p;
    for (Vector6<Scalar>& p_d : p) { p_d.setZero(); }
    for (int k = 0; k < S::n_frames; ++k) {
      const CompositeBody<Scalar>& carried = at(node.frame + k).carried;
      const auto& S_k = state.S_k[static_cast<std::size_t>(k)];
      for (int d = 0; d < S::n_i; ++d) {
        const Vector6<Scalar> twist = column(S_k, d);
        add(p[static_cast<std::size_t>(d)], carried.template times<true, true>(linear(twist), angular(twist)));
      }
      at(node.inlet).carried.add_shifted(carried, from_inlet(node, state));
    }
    for_each_coupled_rotor<S>(s, [&](const auto& rotor) {
      const Vector3<Scalar> a = rotor_axis<S>(rotor, node, state, ws);
      for (int d = 0; d < S::n_i; ++d) {
        for (int i = 0; i < 3; ++i) { p[static_cast<std::size_t>(d)](i + 3) += rotor.inertia * rotor.ratio(d) * a(i); }
      }
    });
    for (int d = 0; d < S::n_i; ++d) { A_G_.col(node.v + d) = shift_wrench(from_com, p[static_cast<std::size_t>(d)]); }
  }

  template <class N, class State>
  Vector3<Scalar> from_inlet(const N& node, const State& state) const
  {
    if (node.inlet >= 0) { return state.r; }
    return state.r - reference_;
  }

  template <class S, class F>
  static void for_each_coupled_rotor(const S& s, F&& f)
  {
    if constexpr (rotor_count<S>() > 0) {
      for (const auto& rotor : s.rotors()) {
        if (rotor.coupled) { f(rotor); }
      }
    }
  }

  template <class S, class RotorType, class N, class Workspace>
  static Vector3<Scalar> rotor_axis(const RotorType& rotor, const N& node, const NodeState<S>& state,
                                    const Workspace& ws)
  {
    return times(rotor.frame < 0 ? ws.inlet_axes(node, state) : ws.frame(node.frame + rotor.frame).R, rotor.axis);
  }

  const Tree* tree_;
  Scalar mass_{0};
  Array<At> frames_;
  Eigen::Matrix<Scalar, 6, Eigen::Dynamic> A_G_;
  Vector3<Scalar> reference_, first_moment_, com_;
  Vector6<Scalar> rate_;
};

}  // namespace detail
}  // namespace iim
