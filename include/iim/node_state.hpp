// What the O(n) pass keeps of one frame and of one subsystem.
#pragma once

#include <iim/body.hpp>
#include <iim/spatial.hpp>
#include <iim/square_root/square_root.hpp>
#include <iim/subsystem.hpp>
#include <iim/update.hpp>

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <type_traits>

namespace iim {

/// Inertia of what one frame carries, at the coupling point of the subsystem that moves the frame, in the axes of its
/// step (ParallelAxes::of).
template <class Scalar>
struct FrameInertia {
  Vector6<Scalar> h;         ///< bias wrench of what A is the inertia of
  SpatialInertia<Scalar> A;  ///< inertia: its own bodies and all that hangs on it (M̄* of what the frame carries);
                             ///< before the frame's own step inward, of what hangs on it
  detail::TriplePair<Scalar> size;  ///< of the roundings of A (roundings.hpp)
  detail::TriplePair<Scalar> loss;  ///< roundings that what hangs on the frame has left to A

  FrameInertia& inertia() { return *this; }
  const FrameInertia& inertia() const { return *this; }
};

namespace detail {

/// Of several states at once, the place where it is from when the first comes to the frame until its own step
/// (SharedPlaces).
template <class Scalar>
struct PlacedInertia {
  FrameInertia<Scalar>* place = nullptr;

  FrameInertia<Scalar>& inertia() { return *place; }
  const FrameInertia<Scalar>& inertia() const { return *place; }
};

}  // namespace detail

/// How one frame moves. World axes; at the coupling point of the subsystem that moves the frame.
template <class Scalar>
struct FrameMovement {
  Matrix3<Scalar> R;      ///< frame to world
  Vector3<Scalar> r;      ///< frame origin from the coupling point [m]
  Vector3<Scalar> omega;  ///< angular velocity [rad/s]
  Vector6<Scalar> bias;   ///< acceleration of the frame for zero guidance acceleration and q̈ = 0
};

/// State of one frame. (What is no number comes last: Triple::settled.)
template <class Scalar>
struct FrameState
    : FrameMovement<Scalar>,
      std::conditional_t<detail::is_several<Scalar>, detail::PlacedInertia<Scalar>, FrameInertia<Scalar>> {
  using FrameMovement<Scalar>::R, FrameMovement<Scalar>::r;

  /// Acceleration less gravity's: of what is held still by (0, 0, 9.81; 0, 0, 0). World axes, at the coupling point.
  Vector6<Scalar> Vdot;
  bool offset = false;   ///< whether the frame's bodies are about another point than the coupling point
  bool arrived = false;  ///< on the way inward: whether anything has come to A, h and size
  bool loses = false;    ///< whether loss is, and large against A

  /// The point that the frame's bodies are about, from the coupling point.
  Vector3<Scalar> bodies_at() const { return offset ? r : Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(0)); }
};

/// What a spring adds to M̄_i in an implicit step h, ratioᵀ (h·damping + h²·stiffness) ratio, and to h̄_i, ratioᵀ force.
template <class Scalar, int n_i>
struct SpringInertia {
  Eigen::Matrix<Scalar, 1, n_i> ratio;
  Scalar inertia;
  Scalar force;  ///< 0 where it is among the loads: without inertia, and but for the square-root form
};

namespace detail {

/// What the steps of accelerations and of B̂ know of a type of subsystem. Those of one shape, as of a link and of a
/// motor-arm, are compiled once.
template <class Scalar_, int n_i_, int n_frames_, MotionPattern pattern_, bool is_free_, bool keeps_v_>
struct Shape {
  using Scalar = Scalar_;
  static constexpr int n_i = n_i_;
  static constexpr int n_frames = n_frames_;
  static constexpr MotionPattern pattern = pattern_;
  static constexpr bool is_free = is_free_;
};
template <class S>
using ShapeOf = Shape<typename S::Scalar, S::n_i, S::n_frames, S::pattern.about_coupling_point(), is_free<S>(),
                      along<S>() != Along::nothing>;

/// In place of what a type does not have.
struct Nothing {};

/// Whether in square-root form the frame of S moves by one column, and n S is kept beside each of its rows n.
template <class S>
inline constexpr bool keeps_v = along<S>() != Along::nothing;
template <class Scalar, int n_i, int n_frames, MotionPattern pattern, bool is_free, bool keeps_v_>
inline constexpr bool keeps_v<Shape<Scalar, n_i, n_frames, pattern, is_free, keeps_v_>> = keeps_v_;

template <class S, class Workspace>
inline constexpr bool one_column = Workspace::update == Update::square_root && keeps_v<S>;

/// Whether in square-root form a subsystem of this shape may share a motion with its inlet (SharedAxis).
template <class S, class Workspace>
inline constexpr bool shares_motion =
    Workspace::update == Update::square_root && S::n_frames == 1 && S::n_i <= 6 && !is_free<S>();

/// Whether in matrix form a subsystem of this shape may begin a FreeLimb.
template <class S, class Workspace>
inline constexpr bool follows_free_axis =
    Workspace::update != Update::square_root && S::n_i == 1 && S::n_frames == 1 && !is_free<S>();

/// What a subsystem of this shape keeps. F_i = (0; 0; 1), so M̄*_i = [ A U ; Uᵀ D ] and M̄_R = D. Of a free one, where D
/// is all of M̄*, Sᵀ A S, nothing needs U and D: they stay as they are.
template <class Shape>
struct NodeMemory {
  using Scalar = typename Shape::Scalar;
  static constexpr int n_i = Shape::n_i;

  std::array<Eigen::Matrix<Scalar, 6, n_i>, Shape::n_frames> S_k;  ///< twist of frame k per q̇_i, at the coupling point
  Matrix3<Scalar> R;                ///< inlet to world, where it is not that of the frame (WorkspaceData::inlet_axes)
  Vector3<Scalar> r;                ///< coupling point from the parent's coupling point, r_pi [m]
  Vector3<Scalar> c;                ///< ω × (ω × r): linear part of Ṫ_ip V_p, inlet velocities only
  Eigen::Matrix<Scalar, 6, n_i> U;  ///< guidance–q̇ block of M̄*; not of several states at once
  Eigen::Matrix<Scalar, n_i, n_i> MbarR;           ///< D = M̄_R (17); as A has it (mended_root.hpp); as U
  Eigen::Matrix<Scalar, n_i, n_i> MbarR_inv_root;  ///< C with M̄_R⁻¹ = C Cᵀ
  Eigen::Matrix<Scalar, n_i, n_i> MbarR_inv;       ///< M̄_R⁻¹
  Eigen::Matrix<Scalar, n_i, 6> W;                 ///< gain M̄_R⁻¹ Uᵀ = M̄_R⁻¹ F_iᵀ M̄* (1; 0); of a free one S⁻¹
  Eigen::Matrix<Scalar, n_i, 1> qd;                ///< q̇_i, kept for rotors
  Eigen::Matrix<Scalar, n_i, 1> psi;               ///< M̄_R⁻¹ (F_iᵀ h̄*)
};

}  // namespace detail

/// What one subsystem keeps.
template <class S>
struct NodeState : detail::NodeMemory<detail::ShapeOf<S>> {
  [[no_unique_address]] std::conditional_t<detail::has_own_twist<S>(), detail::OwnColumn<typename S::Scalar>,
                                           detail::Nothing> own;  ///< of the frame's own bodies
  [[no_unique_address]] std::array<SpringInertia<typename S::Scalar, S::n_i>,
                                   static_cast<std::size_t>(detail::spring_count<S>())>
      springs;  ///< of an implicit step
};

}  // namespace iim
