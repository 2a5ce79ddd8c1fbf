// Planar four-bar linkage and parallelogram.
#pragma once

#include <iim/subsystem/compound.hpp>
#include <iim/subsystem/loop.hpp>

#include <array>
#include <cmath>
#include <string>

namespace iim {

/// Crank, coupler and rocker between two hinges A (the coupling point) and D of the inlet. q: angle of the crank from
/// the plane's x [rad]; closed form. Frames: 0 crank, 1 coupler, 2 rocker, with origins at A, at B on the crank, and at
/// D; their axes are the inlet's, turned so that `plane.x` points along the bar: to B, to C, to C.
template <class Scalar_>
struct FourBarLinkage {
  using Scalar = Scalar_;
  static constexpr int n_i = 1;
  static constexpr int n_frames = 3;

  Plane<Scalar> plane{};
  Eigen::Matrix<Scalar, 2, 1> ground = Eigen::Matrix<Scalar, 2, 1>::UnitX();  ///< D in the plane, from A [m]
  Scalar crank = Scalar(1);                                                   ///< A to B [m]
  Scalar coupler = Scalar(1);                                                 ///< B to C [m]
  Scalar rocker = Scalar(1);                                                  ///< D to C [m]
  Scalar side = Scalar(1);  ///< C is left (1) or right (−1) of the way from D to B

  void prepare(const std::string& owner)
  {
    plane.prepare(owner);
    detail::check_length(crank, owner + ": crank");
    detail::check_length(coupler, owner + ": coupler");
    detail::check_length(rocker, owner + ": rocker");
    if (!detail::all_finite(ground) || !(ground.norm() > Scalar(0))) {
      detail::refuse({owner, ": ground must be finite and not zero, got ", detail::to_text(ground)});
    }
    using std::abs;
    const Scalar length = ground.norm();  // D to B is between |length − crank| and length + crank
    if (!(abs(length - crank) < coupler + rocker) || !(abs(coupler - rocker) < length + crank)) {
      detail::refuse({owner, ": one of the bars is longer than the others together: the loop does not close"});
    }
    detail::check_side(side, owner);
  }

  bool place(const std::array<Dependent<Scalar, 1>, 1>& q, std::array<RelativeMotion<Scalar, 1>, 3>& frames) const
  {
    using D = Dependent<Scalar, 1>;
    using Point = PlanePoint<Scalar, 1>;
    const Point B{cos(q[0]) * D(crank), sin(q[0]) * D(crank)};
    const Point pivot{D(ground(0)), D(ground(1))};
    Point C;
    const LoopStatus status = meeting_point(pivot, rocker, B, coupler, side, C);
    if (status != LoopStatus::ok) { C = Point{B.x + D(coupler), B.y}; }
    frames[0] = RelativeMotion<Scalar, 1>{}.turned(plane.normal, q[0]);
    frames[1] = plane.at(B).turned(plane.normal, atan2((C - B).y, (C - B).x));
    frames[2] = plane.at(pivot).turned(plane.normal, atan2((C - pivot).y, (C - pivot).x));
    return status == LoopStatus::ok;
  }

  template <class T>
  FourBarLinkage<T> cast() const
  {
    return {plane.template cast<T>(), ground.template cast<T>(), T(crank), T(coupler), T(rocker), T(side)};
  }
};

/// Four-bar whose coupler keeps its direction: rocker and crank parallel, D anywhere. q and frames as FourBarLinkage,
/// the coupler's axes those of the inlet; no dead centre.
template <class Scalar_>
struct ParallelogramLinkage {
  using Scalar = Scalar_;
  static constexpr int n_i = 1;
  static constexpr int n_frames = 3;

  Plane<Scalar> plane{};
  Eigen::Matrix<Scalar, 2, 1> ground = Eigen::Matrix<Scalar, 2, 1>::UnitX();  ///< D in the plane, from A [m]
  Scalar crank = Scalar(1);                                                   ///< A to B, D to C [m]

  void prepare(const std::string& owner)
  {
    plane.prepare(owner);
    detail::check_length(crank, owner + ": crank");
    if (!detail::all_finite(ground)) {
      detail::refuse({owner, ": ground must be finite, got ", detail::to_text(ground)});
    }
  }

  bool place(const std::array<Dependent<Scalar, 1>, 1>& q, std::array<RelativeMotion<Scalar, 1>, 3>& frames) const
  {
    frames[0] = RelativeMotion<Scalar, 1>{}.turned(plane.normal, q[0]);
    frames[1] = frames[0].at(plane.x * crank).upright();
    frames[2] = RelativeMotion<Scalar, 1>{}.at(plane.x * ground(0) + plane.y() * ground(1)).turned(plane.normal, q[0]);
    return true;
  }

  template <class T>
  ParallelogramLinkage<T> cast() const
  {
    return {plane.template cast<T>(), ground.template cast<T>(), T(crank)};
  }
};

template <class Scalar>
using FourBar = Compound<FourBarLinkage<Scalar>>;
template <class Scalar>
using Parallelogram = Compound<ParallelogramLinkage<Scalar>>;

static_assert(Subsystem<FourBar<double>>);
static_assert(Subsystem<Parallelogram<double>>);

}  // namespace iim
