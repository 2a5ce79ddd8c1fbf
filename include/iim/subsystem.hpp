// What a subsystem is: the contract between a mechanical part and the recursions.
//
// A subsystem hangs on its parent at a coupling point. The part of the parent that carries the coupling point is its
// inlet; the rigid frames that the subsystem itself moves are its frames, and children hang on those. Everything is
// written in axes parallel to the world and at the coupling point, so an author only says how
// the frames move relative to the inlet and which bodies they carry; velocity and inertia terms follow from that:
//
//     twist of frame k at the coupling point      V_k = (v_o; ω_o) + S_k q̇_i
//     M̄_i = Σ_b [1 S_b]ᵀ M_b [1 S_b]                                                     (A5)
//     outlet at r from the coupling point         T_ip = [ X(r) [1 S_k] ; 0 ]             (8) with R_ip = 1
//     F_i = (0; 0; 1)                                                                     (7)
#pragma once

#include <iim/body.hpp>
#include <iim/numerics/turns.hpp>
#include <iim/spatial.hpp>

#include <array>
#include <concepts>
#include <string>
#include <type_traits>
#include <utility>

namespace iim {

/// How one frame of a subsystem moves relative to the inlet; filled in by Subsystem::motion. World axes. What no state
/// changes from zero need not be written.
template <class Scalar, int n_i>
struct FrameMotion {
  Matrix3<Scalar>& R;                ///< frame to world
  Vector3<Scalar>& r;                ///< frame origin from the coupling point [m]
  Eigen::Matrix<Scalar, 6, n_i>& S;  ///< per q̇_i: velocity v of that point of the frame that is at the coupling
                                     ///< point now, and angular velocity ω of the frame
  Vector6<Scalar>& bias;             ///< accelerations of the same for q̈ = 0, the inlet at rest: linear Ṡ q̇ + ω × v,
                                     ///< angular Ṡ q̇
};

/// What `motion` leaves zero (and need not write): the recursions then leave out the work for it.
struct MotionPattern {
  bool linear = true;   ///< S has linear rows
  bool angular = true;  ///< S has angular rows
  bool offset = true;   ///< r is not zero
  bool bias = true;     ///< bias is not zero
  /// S and bias are about the frame's origin instead of the coupling point, which moves there. Of one frame that slides
  /// far, with no bodies on the inlet: what it carries is then about a point of its own. (A base that slides and turns
  /// in a plane, 1 km away: B̂ 5.6e6 ε without, 1 with.) A single column must be the same about both points, as a
  /// screw's is.
  bool about_frame = false;

  /// Of a joint without bias whose S is the same about both points.
  constexpr MotionPattern about_coupling_point() const
  {
    MotionPattern pattern = *this;
    pattern.about_frame = false;
    return pattern;
  }
};

/// A body and the frame that carries it; frame −1 is the inlet (a motor housing on the parent's side).
template <class Scalar>
struct CarriedBody {
  int frame = 0;
  Body<Scalar> body;
};

/// An axisymmetric rotor that spins relative to its carrier at the rate ratio·q̇_i about `axis`.
/// Its mass, and its inertia across the axis, are a CarriedBody; this is the inertia about the axis.
template <class Scalar, int n_i>
struct Rotor {
  int frame = -1;                       ///< carrier; −1 is the inlet
  Vector3<Scalar> axis;                 ///< unit vector in the carrier's axes
  Scalar inertia;                       ///< about the axis [kg m²]
  Eigen::Matrix<Scalar, 1, n_i> ratio;  ///< spin rate per q̇_i
  bool coupled = true;                  ///< false: armature, inertia·ratioᵀratio on M̄_i's q̇ block and nothing else
};

/// Springs and dampers with one elongation, which grows at the rate ratio·q̇_i: what `internal_force` does to first
/// order, ∂/∂q → ratioᵀ·stiffness·ratio and ∂/∂q̇ = ratioᵀ·damping·ratio. Both not negative.
template <class Scalar, int n_i>
struct Spring {
  Eigen::Matrix<Scalar, 1, n_i> ratio;
  Scalar stiffness{0};  ///< [N m/rad, N/m]
  Scalar damping{0};    ///< [N m s/rad, N s/m]
  /// What internal_force contains of it, ratioᵀ·force [N m, N]. Given, it does not cost the square-root form of an
  /// implicit step any digits, however stiff the spring; zero: it is not known apart from the rest.
  Scalar force{0};
};

/// Requirements on a subsystem. Sizes are compile-time constants, functions are const and do not allocate.
template <class T>
concept Subsystem = requires(
    const T s, T mutable_s, const Matrix3<typename T::Scalar> R, const Eigen::Matrix<typename T::Scalar, T::n_q, 1> q,
    const Eigen::Matrix<typename T::Scalar, T::n_i, 1> qd,
    std::array<FrameMotion<typename T::Scalar, T::n_i>, T::n_frames> frames, const std::string name) {
  // Numbers of coordinates q_i, of internal velocities q̇_i, of own motor inputs, of moving frames (at least one).
  requires T::n_q >= 0 && T::n_i >= 0 && T::n_u >= 0 && T::n_frames >= 1;
  { T::pattern } -> std::convertible_to<MotionPattern>;
  // Motion of all frames for the inlet's orientation R (inlet to world). False: no such configuration.
  { s.motion(R, q, qd, frames) } -> std::same_as<bool>;
  // A std::array of CarriedBody; constant.
  { s.bodies()[0] } -> std::convertible_to<CarriedBody<typename T::Scalar>>;
  // q̇ rows of B̄_i: generalised force on q̇_i per motor input, n_i × n_u.
  { s.Bbar(q) } -> std::convertible_to<Eigen::Matrix<typename T::Scalar, T::n_i, T::n_u>>;
  // Throws ModelError naming `name` if the parameters are wrong; may precompute. Called by the tree, on what may be
  // prepared already.
  mutable_s.prepare(name);
};

namespace detail {

/// Says of a type that is none which requirement it does not meet.
template <class S>
struct IsSubsystem {
  static_assert(Subsystem<S>, "this type does not meet the requirements on a Subsystem (iim/subsystem.hpp)");
};
template <class... S>
struct AreSubsystems {
  template <class T>
  static constexpr int count = (int(std::same_as<T, S>) + ...);
  static_assert((sizeof(IsSubsystem<S>) + ...) > 0);
  static_assert(((count<S> == 1) && ...), "each type of subsystem is listed once (two names may mean one type)");
};

/// S with the Scalar T: by its own cast<T>(), not by that of a base, which would leave out what S adds.
template <class S, class T>
struct InScalar {
  using Type = decltype(std::declval<const S&>().template cast<T>());
  static_assert(std::same_as<decltype(std::declval<const S&>().template cast<typename S::Scalar>()), S>,
                "cast<T>() of this subsystem makes another type of it: it needs one of its own, not that of its base");
};

// Optional members of a subsystem, and what holds without them.

template <class S>
using Coordinates = Eigen::Matrix<typename S::Scalar, S::n_q, 1>;
template <class S>
using Velocities = Eigen::Matrix<typename S::Scalar, S::n_i, 1>;

/// `static constexpr bool is_free = true`: the internal motion is all of SE(3), so nothing passes from the frame to the
/// parent. One frame with one body; its coupling point moves with it and is the body's centre of mass, q begins with
/// the frame's origin in inlet axes, and q̇_i is the velocity of the origin and the angular velocity, both in the
/// frame's axes e_d: with r the origin from the centre, S = [e r×e; 0 e] and W = S⁻¹ = [eᵀ (r×e)ᵀ; 0 eᵀ]. With motors
/// or internal forces it is for the world alone: on another part these would need something to push from. It has
/// neither rotors nor springs.
template <class S>
constexpr bool is_free()
{
  if constexpr (requires { S::is_free; }) {
    static_assert(!S::is_free || (S::n_i == 6 && S::n_frames == 1), "is_free is for one frame with six velocities");
    return S::is_free;
  }
  return false;
}

/// `fixed_body()`: the Body of the one frame, by reference. FixedLinks on it are frames, their bodies put into it;
/// without, they are subsystems whose bodies are moved to the coupling point at every state, which costs time, and
/// digits where they are far out along the axis of a joint.
template <class S>
constexpr bool takes_fixed_bodies()
{
  if constexpr (requires(S s) { s.fixed_body(); }) {
    static_assert(S::n_frames == 1, "fixed_body() is for one frame");
    return true;
  }
  return false;
}

/// `static constexpr bool is_fixed = true`: with fixed_body(), whose frame is the coupling point's on the inlet.
template <class S>
constexpr bool is_fixed()
{
  if constexpr (requires { S::is_fixed; }) {
    static_assert(!S::is_fixed || S::n_i == 0, "is_fixed is for what has no velocities");
    return S::is_fixed;
  }
  return false;
}

/// Whether the coupling point goes to the origin that `motion` gives the frame.
template <class S>
constexpr bool follows_frame()
{
  static_assert(!S::pattern.about_frame || S::n_frames == 1, "MotionPattern::about_frame is for one frame");
  return S::pattern.about_frame;
}

/// Whether FrameMass is about another point than the coupling point.
template <class S>
constexpr bool is_placed_off()
{
  return S::pattern.offset && !is_free<S>() && !follows_frame<S>();
}

/// `rotors()`: std::array of Rotor.
template <class S>
constexpr int rotor_count()
{
  static_assert(
      requires(const S s) { s.rotors(); } || !requires { &S::rotors; },
      "rotors must be: std::array<Rotor<Scalar, n_i>, N> rotors() const");
  if constexpr (requires(const S s) { s.rotors(); }) {
    static_assert(!is_free<S>(), "what is_free has no rotors()");
    return static_cast<int>(std::tuple_size_v<std::remove_cvref_t<decltype(std::declval<const S&>().rotors())>>);
  }
  return 0;
}

/// `internal_force(q, qd)`: springs, dampers, friction, n_i; on the left-hand side
/// of (10) as the q̇ rows of h̄_i, so that a spring k q returns +k q.
template <class S>
constexpr bool has_internal_force()
{
  constexpr bool has = requires(const S s, Coordinates<S> q, Velocities<S> qd) {
    { s.internal_force(q, qd) } -> std::convertible_to<Velocities<S>>;
  };
  static_assert(
      has || !requires { &S::internal_force; },
      "internal_force must be: Velocities internal_force(const Coordinates& q, const Velocities& qd) const");
  return has;
}

/// `springs(q, qd)`: std::array of Spring, the stiff part of internal_force, which implicit_step takes at the step's
/// end. Internal forces without it stay explicit.
template <class S>
constexpr int spring_count()
{
  static_assert(
      requires(const S s, Coordinates<S> q, Velocities<S> qd) { s.springs(q, qd); } || !requires { &S::springs; },
      "springs must be: std::array<Spring<Scalar, n_i>, N> springs(const Coordinates& q, const Velocities& qd) const");
  if constexpr (requires(const S s, Coordinates<S> q, Velocities<S> qd) { s.springs(q, qd); }) {
    static_assert(!is_free<S>(), "what is_free has no springs(); its internal_force stays explicit");
    static_assert(has_internal_force<S>(), "springs() are part of internal_force(q, qd), which there must be, too");
    return static_cast<int>(std::tuple_size_v<std::remove_cvref_t<decltype(std::declval<const S&>().springs(
                                std::declval<const Coordinates<S>&>(), std::declval<const Velocities<S>&>()))>>);
  }
  return 0;
}

/// `own_twist()`: one frame and one velocity only; twist of the frame per q̇ at the frame's origin in the frame's own
/// axes, which is the same in every configuration, a unit vector where it only turns or only slides.
/// U and D of the frame's own body are formed from it: a centre of mass on the axis, or a thin moment about it, then
/// stays what it is, whatever a turn to world axes rounds. Without it, no pivot of the subsystem that is a small
/// difference is computed anew (pass/weak_pivot.hpp), and joints about parallel axes or one line are not known as such.
template <class S>
constexpr bool has_own_twist()
{
  static_assert(
      requires(const S s) { s.own_twist(); } || !requires { &S::own_twist; },
      "own_twist must be: Vector6<Scalar> own_twist() const");
  if constexpr (requires(const S s) { s.own_twist(); }) {
    static_assert(S::n_frames == 1 && S::n_i == 1, "own_twist() is for one frame with one velocity");
    return true;
  }
  return false;
}

/// Whether S moves its frame along one unit column, turning it or sliding.
template <class S>
constexpr bool has_unit_column()
{
  return has_own_twist<S>() && S::pattern.linear != S::pattern.angular;
}

/// `inlet_twists()`: one frame only, n_i > 1; columns, at most n_i, that span the twists which the frame can have
/// against the inlet in every configuration, about the inlet's coupling point in its axes (of a universal joint, the
/// first axis alone). Update::square_root keeps from them the digits of a free base that is much lighter than two limbs
/// which let it move in one way (common_motion.hpp).
template <class S>
constexpr bool has_inlet_twists()
{
  static_assert(
      requires(const S s) { s.inlet_twists(); } || !requires { &S::inlet_twists; },
      "inlet_twists must be: Eigen::Matrix<Scalar, 6, k> inlet_twists() const");
  if constexpr (requires(const S s) { s.inlet_twists(); }) {
    using Twists = decltype(std::declval<const S&>().inlet_twists());
    static_assert(
        Twists::RowsAtCompileTime == 6 && Twists::ColsAtCompileTime >= 1 && Twists::ColsAtCompileTime <= S::n_i,
        "inlet_twists() has 6 rows and one column for each motion, at most n_i");
    static_assert(S::n_frames == 1 && S::n_i > 1, "inlet_twists() is for one frame with several velocities");
    return rotor_count<S>() + spring_count<S>() == 0 && S::n_i <= 6;
  }
  return false;
}

/// `motion(R, turn, qd, frames)`: of one coordinate, which is an angle, with its sine and cosine in place of it. Those
/// of all subsystems are computed at once.
template <class S>
constexpr bool takes_turn()
{
  return requires(const S s, const Matrix3<typename S::Scalar> R, const Turn<typename S::Scalar> turn, Velocities<S> qd,
                  std::array<FrameMotion<typename S::Scalar, S::n_i>, S::n_frames> frames) {
    requires S::n_q == 1;
    { s.motion(R, turn, qd, frames) } -> std::same_as<bool>;
  };
}

}  // namespace detail

/// dq_i/dt for the velocities q̇_i: the same numbers, but for types whose coordinates are not integrals of them.
template <Subsystem S>
detail::Coordinates<S> coordinate_rate(const S& s, const detail::Coordinates<S>& q, const detail::Velocities<S>& qd)
{
  static_assert(
      requires { s.coordinate_rate(q, qd); } || !requires { &S::coordinate_rate; },
      "coordinate_rate must be: Coordinates coordinate_rate(const Coordinates& q, const Velocities& qd) const");
  if constexpr (requires { s.coordinate_rate(q, qd); }) {
    return s.coordinate_rate(q, qd);
  } else {
    static_assert(S::n_q == S::n_i, "a subsystem with n_q != n_i needs coordinate_rate(q, qd)");
    return qd;
  }
}

/// Divides out what coordinates have lost or gained that a subsystem keeps constant: the length of a quaternion.
template <Subsystem S>
void normalize(const S& s, detail::Coordinates<S>& q)
{
  static_assert(
      requires { s.normalize(q); } || !requires { &S::normalize; },
      "normalize must be: void normalize(Coordinates& q) const");
  if constexpr (requires { s.normalize(q); }) { s.normalize(q); }
}

/// Coordinates at which the subsystem is in its reference position: zero, or a unit quaternion.
template <Subsystem S>
detail::Coordinates<S> neutral(const S& s)
{
  static_assert(
      requires { s.neutral(); } || !requires { &S::neutral; }, "neutral must be: Coordinates neutral() const");
  if constexpr (requires { s.neutral(); }) {
    return s.neutral();
  } else {
    return detail::Coordinates<S>::Zero();
  }
}

}  // namespace iim
