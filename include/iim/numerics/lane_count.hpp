// A long row of numbers, a strip of it at a time: of how many, and how it is loaded and stored.
#pragma once

#include <iim/numerics/row.hpp>

#include <algorithm>

namespace iim::detail {

/// How many numbers a strip has: those of two registers, eight at most. (With four SSE2 registers and the sweep of that
/// time q̈₀ and B̂ of a chain of 20 took 2.4 times as long, of 50 four times.)
template <class Scalar>
inline constexpr int lane_count = register_lanes<Scalar> > 1 ? std::min(2 * register_lanes<Scalar>, 8) : 1;

/// What one step of a loop treats.
template <class Scalar>
using Strip = Row<Scalar, lane_count<Scalar>>;

template <class Scalar>
Eigen::Index padded(Eigen::Index size)
{
  return (size + lane_count<Scalar> - 1) / lane_count<Scalar> * lane_count<Scalar>;
}

template <class Scalar>
[[gnu::always_inline]] inline Strip<Scalar> load(const Scalar* from)
{
  return Strip<Scalar>::load(from);
}

template <class Scalar>
[[gnu::always_inline]] inline void store(Scalar* to, const Strip<Scalar>& x)
{
  x.store(to);
}

/// The first `count` lanes only, in runs of halving length.
template <int run, class Scalar>
[[gnu::always_inline]] inline void store_run(Scalar* to, const Strip<Scalar>& x, Eigen::Index count, int done)
{
  if constexpr (run > 0) {
    if ((count & run) != 0) {
      Row<Scalar, run>::load(x.data() + done).store(to + done);
      done += run;
    }
    store_run<run / 2>(to, x, count, done);
  }
}
template <class Scalar>
[[gnu::always_inline]] inline void store(Scalar* to, const Strip<Scalar>& x, Eigen::Index count)
{
  if (count >= lane_count<Scalar>) {
    store(to, x);
  } else {
    store_run<lane_count<Scalar> / 2>(to, x, count, 0);
  }
}

}  // namespace iim::detail
