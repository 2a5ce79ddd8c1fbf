// Closed loops inside a subsystem: dependent coordinates from independent ones, with Jacobian and its derivative.
//
// Where there is a closed form it is written in Dependents, as `meeting_point` is. Otherwise the equations Φ(y, q) = 0
// are written once, as a generic function of Dependents, and `close_loop` does the rest:
//
//     y by Newton from a start,   ∂y/∂q = G = −Φ_y⁻¹ Φ_q,   ÿ = −Φ_y⁻¹ γ for q̈ = 0, γ: Φ̈ along ẏ = G q̇ for ÿ = 0
//
// A subsystem is constant and shared by threads: a warm start is a function of q (the assembled position, a table that
// `prepare` makes), never the last solution. That also keeps y on one branch whatever was computed before.
#pragma once

#include <iim/errors.hpp>
#include <iim/subsystem/joint.hpp>
#include <iim/subsystem/relative_motion.hpp>

#include <Eigen/LU>

#include <array>
#include <cmath>
#include <cstddef>
#include <string>

namespace iim {

/// How the closing of a loop ended.
enum class LoopStatus {
  ok,
  unreachable,  ///< the loop does not close for these q
  singular      ///< it closes, but y is not a differentiable function of q there (dead centre)
};

namespace detail {

/// What a sine x, or a distance in times of the lengths that it is the difference of, has to be: second derivatives,
/// which may be differences of terms of the size 1/x³, are wrong by ε/x³, here by 1/128. (Where a four-bar folds up,
/// crank and rocker as long and coupler and ground, q̈₀ was wrong by 1 at x = 10⁻⁶.) 3 × 10⁻⁵ in double, 0.025 in float.
template <class Scalar>
Scalar dead_centre()
{
  return Scalar(std::cbrt(128 * to_double(Eigen::NumTraits<Scalar>::epsilon())));
}

/// Throws ModelError, naming `owner`, unless `side` says which of the two ways a loop closes in.
template <class Scalar>
[[gnu::cold]] void check_side(const Scalar& side, const std::string& owner)
{
  if (side != Scalar(1) && side != Scalar(-1)) { refuse({owner, ": side must be 1 or −1, got ", to_text(side)}); }
}

}  // namespace detail

/// When the iteration ends, and what is taken for singular.
template <class Scalar>
struct LoopOptions {
  /// Newton ends when a step is at most this times (1 + |y|).
  Scalar tolerance = Scalar(16) * Eigen::NumTraits<Scalar>::epsilon();
  int max_iterations = 30;
  /// Singular if the smallest pivot of Φ_y is less than this times the largest, or times the largest entry of Φ_q.
  Scalar singular = detail::dead_centre<Scalar>();
};

/// The coordinates y of a closed loop as functions of q, with their derivatives.
template <class Scalar, int n_y, int n>
struct ClosedLoop {
  std::array<Dependent<Scalar, n>, static_cast<std::size_t>(n_y)> y;
  LoopStatus status = LoopStatus::unreachable;
  int iterations = 0;
};

/// Solves equations(y, q) = 0 for y, near `start`. equations: generic; takes arrays of Dependent<Scalar, m> of n_y and
/// n entries for any m and returns one of n_y. Does not throw or allocate.
template <int n_y, class Scalar, int n, std::size_t count, class Equations>
ClosedLoop<Scalar, n_y, n> close_loop(const Equations& equations, const std::array<Dependent<Scalar, n>, count>& q,
                                      const Eigen::Matrix<Scalar, n_y, 1>& start,
                                      const LoopOptions<Scalar>& options = {})
{
  static_assert(count == static_cast<std::size_t>(n));
  constexpr auto size = static_cast<std::size_t>(n_y);
  using Vector = Eigen::Matrix<Scalar, n_y, 1>;
  using Matrix = Eigen::Matrix<Scalar, n_y, n_y>;
  using std::abs;
  using std::sqrt;
  ClosedLoop<Scalar, n_y, n> loop;

  std::array<Dependent<Scalar, n_y>, count> held;
  for (std::size_t d = 0; d < count; ++d) { held[d] = Dependent<Scalar, n_y>(q[d].value); }
  Vector y = start;
  Matrix Phi_y;
  bool converged = false;
  Scalar before(0);  // the last step's length
  const Scalar small = sqrt(Eigen::NumTraits<Scalar>::epsilon());
  for (; loop.iterations < options.max_iterations && !converged; ++loop.iterations) {
    const auto Phi = equations(independent<Scalar, n_y>(y, Vector::Zero()), held);
    Vector residual;
    for (std::size_t k = 0; k < size; ++k) {
      residual(static_cast<Index>(k)) = Phi[k].value;
      Phi_y.row(static_cast<Index>(k)) = Phi[k].gradient;
    }
    const Vector step = Eigen::PartialPivLU<Matrix>(Phi_y).solve(residual);
    if (!detail::all_finite(step)) { break; }
    y -= step;
    // Steps that no longer shrink are what Φ_y⁻¹ makes of the roundings of Φ.
    const Scalar length = step.norm(), scale = Scalar(1) + y.norm();
    converged = length <= options.tolerance * scale ||
                (loop.iterations > 0 && length <= small * scale && length + length >= before);
    before = length;
  }
  // Where Φ_y is singular Newton creeps up to the solution, each step half the last, and ends √ε away from it: there
  // the last step has changed Φ_y by as much as is left of it.
  const Matrix last = Phi_y;
  const auto at_y = equations(independent<Scalar, n_y>(y, Vector::Zero()), held);
  Scalar residual(0);
  for (std::size_t k = 0; k < size; ++k) {
    Phi_y.row(static_cast<Index>(k)) = at_y[k].gradient;
    residual += abs(at_y[k].value);
  }
  // Φ_q with y held. It counts in what Φ_y is small against: one equation has no other measure.
  for (std::size_t k = 0; k < size; ++k) { loop.y[k] = Dependent<Scalar, n>(y(static_cast<Index>(k))); }
  Eigen::Matrix<Scalar, n_y, n> Phi_q;
  const auto at_q = equations(loop.y, q);
  for (std::size_t k = 0; k < size; ++k) { Phi_q.row(static_cast<Index>(k)) = at_q[k].gradient; }

  const Eigen::FullPivLU<Matrix> lu(Phi_y);
  const Scalar smallest = lu.matrixLU().diagonal().cwiseAbs().minCoeff();
  const Scalar of_q = Phi_q.cwiseAbs().maxCoeff();
  const Scalar largest = of_q > abs(lu.maxPivot()) ? of_q : Scalar(abs(lu.maxPivot()));
  const Scalar change = (Phi_y - last).cwiseAbs().maxCoeff();
  if (converged) {
    const bool regular = smallest > options.singular * largest && smallest > Scalar(4) * change;
    loop.status = regular ? LoopStatus::ok : LoopStatus::singular;
  } else if (residual <= small * largest * (Scalar(1) + y.norm())) {
    loop.status = LoopStatus::singular;
  }
  if (loop.status != LoopStatus::ok) { return loop; }

  // Φ̈ with y moving along.
  Eigen::Matrix<Scalar, n, 1> qd;
  for (std::size_t d = 0; d < count; ++d) { qd(static_cast<Index>(d)) = q[d].rate; }
  const Eigen::Matrix<Scalar, n_y, n> G = -lu.solve(Phi_q);
  for (std::size_t k = 0; k < size; ++k) {
    loop.y[k].gradient = G.row(static_cast<Index>(k));
    loop.y[k].rate = loop.y[k].gradient.dot(qd);
  }
  const auto moving = equations(loop.y, q);
  Vector gamma;
  for (std::size_t k = 0; k < size; ++k) { gamma(static_cast<Index>(k)) = moving[k].bias; }
  const Vector bias = -lu.solve(gamma);
  for (std::size_t k = 0; k < size; ++k) { loop.y[k].bias = bias(static_cast<Index>(k)); }
  return loop;
}

/// A point of the plane.
template <class Scalar, int n>
struct PlanePoint {
  Dependent<Scalar, n> x, y;

  friend PlanePoint operator-(const PlanePoint& a, const PlanePoint& b) { return {a.x - b.x, a.y - b.y}; }
  friend PlanePoint operator+(const PlanePoint& a, const PlanePoint& b) { return {a.x + b.x, a.y + b.y}; }
};

/// The point that is `a` away from A and `b` away from B: left of the way from A to B for side = 1, right for −1.
template <class Scalar, int n>
LoopStatus meeting_point(const PlanePoint<Scalar, n>& A, const Scalar& a, const PlanePoint<Scalar, n>& B,
                         const Scalar& b, const Scalar& side, PlanePoint<Scalar, n>& point)
{
  using D = Dependent<Scalar, n>;
  if (b < a) { return meeting_point(B, b, A, a, Scalar(-side), point); }  // a²L² is all that can cancel below
  const PlanePoint<Scalar, n> way = B - A;
  const D L2 = way.x * way.x + way.y * way.y;
  const D along = (L2 + D(a * a - b * b)) * D(Scalar(0.5));  // L times the part of a along the way
  const D across2 = D(a * a) * L2 - along * along;
  // Of the sines between the shorter bar and the way, and between the bars, the smaller.
  const Scalar least = detail::dead_centre<Scalar>();
  const Scalar size = a * a * (L2.value > b * b ? L2.value : Scalar(b * b));
  if (!ScalarTraits<Scalar>::is_positive(across2.value)) { return LoopStatus::unreachable; }
  const D across = sqrt(across2) * D(side);
  point = A + PlanePoint<Scalar, n>{(way.x * along - way.y * across) / L2, (way.y * along + way.x * across) / L2};
  return ScalarTraits<Scalar>::is_positive(across2.value - least * least * size) ? LoopStatus::ok
                                                                                 : LoopStatus::singular;
}

/// Axes of a plane mechanism: x × y = normal.
template <class Scalar>
struct Plane {
  Vector3<Scalar> normal = Vector3<Scalar>::UnitZ();  ///< unit vector in inlet axes
  Vector3<Scalar> x = Vector3<Scalar>::UnitX();       ///< unit vector in inlet axes, perpendicular to the normal

  Vector3<Scalar> y() const { return detail::cross(normal, x); }

  /// Throws ModelError naming `owner` unless normal and x are perpendicular unit vectors.
  void prepare(const std::string& owner)
  {
    normal = detail::UnitAxis<Scalar>(normal, owner + ": normal").direction;
    x = detail::UnitAxis<Scalar>(x, owner + ": x").direction;
    detail::check_perpendicular(normal, x, owner);
    x = (x - normal * normal.dot(x)).normalized();
  }

  /// A frame at a point of the plane, not turned.
  template <int n>
  RelativeMotion<Scalar, n> at(const PlanePoint<Scalar, n>& point) const
  {
    return RelativeMotion<Scalar, n>{}.slid(x, point.x).slid(y(), point.y);
  }

  template <class T>
  Plane<T> cast() const
  {
    return {normal.template cast<T>(), x.template cast<T>()};
  }
};

namespace detail {

/// Throws ModelError unless a length is positive and finite.
template <class Scalar>
void check_length(const Scalar& length, const std::string& what)
{
  if (!(length > Scalar(0)) || !is_finite(length)) {
    detail::refuse({what, " must be positive, got ", to_text(length), " m"});
  }
}

}  // namespace detail
}  // namespace iim
