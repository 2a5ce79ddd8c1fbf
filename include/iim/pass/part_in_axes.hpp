// A subsystem in the axes of the group of parallel joints that it belongs to (parallel_axes.hpp), for the sums of
// motion_residual.hpp.
#pragma once

#include <iim/numerics/triple.hpp>
#include <iim/pass/bodies_beyond.hpp>
#include <iim/pass/parallel_axes.hpp>
#include <iim/pass/roundings.hpp>
#include <iim/pass/single_motion.hpp>
#include <iim/spatial.hpp>

namespace iim::detail {

/// Between the world's axes and others; null: the world's.
template <class Scalar>
TriplePair<Scalar> from_world(const Matrix3<Scalar>* axes, const TriplePair<Scalar>& x)
{
  return axes == nullptr ? x : turned(*axes, false, x);
}
template <class Scalar>
TriplePair<Scalar> to_world(const Matrix3<Scalar>* axes, const TriplePair<Scalar>& x)
{
  return axes == nullptr ? x : turned(*axes, true, x);
}

/// Place, columns and gains in the axes `own` of its frame; what is on its inlet is in the axes `there`.
template <class Scalar>
class PartInAxes {
  using Pair = TriplePair<Scalar>;
  using Part = typename BodiesBeyond<Scalar>::Part;

public:
  PartInAxes(const Part& part, const Matrix3<Scalar>* own_axes, const Matrix3<Scalar>* inlet_axes)
      : own(own_axes), there(inlet_axes), part_(&part)
  {
    if (own != nullptr) { turn(); }
  }
  PartInAxes(const PartInAxes&) = delete;  // part_ may be within
  PartInAxes& operator=(const PartInAxes&) = delete;

  const Part& part() const { return *part_; }
  Pair from_inlet(const Pair& x) const { return own == there ? x : from_world(own, to_world(there, x)); }
  Pair to_inlet(const Pair& x) const { return own == there ? x : from_world(there, to_world(own, x)); }

  const Matrix3<Scalar>*own, *there;

private:
  /// What belongs to a group has one frame, and one velocity at most.
  [[gnu::noinline]] void turn()
  {
    turned_ = *part_;
    const TransposedRotation<Scalar> into(*own);
    R_ = *part_->R;
    r_ = *part_->r;
    turn_each(into, R_.data(), 3);
    turn_each(into, r_.data(), 1);
    turned_.R = &R_;
    turned_.r = &r_;
    if (part_->n_i > 0) {
      turned(*own, false, part_->gain(0)).put(W_.data());
      const Pair S = turned(*own, false, part_->column(0, 0));
      Pair(tidy(S.linear), tidy(S.angular)).put(S_.data());
      turned_.W = W_.data();
      turned_.S = S_.data();
    }
    part_ = &turned_;
  }
  /// Without components that are roundings: the group's direction is one of its axes.
  static Triple<Scalar> tidy(const Triple<Scalar>& x)
  {
    const Scalar zero(0), least = largest_of(x) * (Scalar(16) * Eigen::NumTraits<Scalar>::epsilon());
    const auto component = [&](int k) { return if_greater(magnitude(x(k)), least, Scalar(x(k)), zero); };
    return {component(0), component(1), component(2)};
  }

  const Part* part_;
  Part turned_;
  Matrix3<Scalar> R_;
  Vector3<Scalar> r_;
  Vector6<Scalar> S_, W_;
};

/// Where all is in the world's axes.
template <class Scalar>
struct PartAsItIs {
  const typename BodiesBeyond<Scalar>::Part& whole;
  const auto& part() const { return whole; }
};

}  // namespace iim::detail
