// Products Gᵢⱼ = aᵢᵀ I aⱼ of accelerations of a frame with the inertia of a body, or of all that the frame carries: of
// one in single numbers, or of several side by side.
#pragma once

#include <iim/body.hpp>
#include <iim/numerics/registers.hpp>
#include <iim/numerics/row.hpp>
#include <iim/spatial.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cstddef>
#include <type_traits>
#include <utility>

namespace iim::detail {

/// Numbers side by side, in registers if these can be. (Eigen's arrays of built-in numbers would make a controller 9 %
/// slower to compile.)
template <class Scalar, int n>
struct LanesOf {
  using Type = Eigen::Array<Scalar, n, 1>;
};
template <class Scalar, int n>
  requires std::is_same_v<Scalar, float> || std::is_same_v<Scalar, double>
struct LanesOf<Scalar, n> : VectorOf<Scalar, n> {};
template <class Scalar>
using EightLanes = typename LanesOf<Scalar, 8>::Type;

/// Accelerations of a frame, component by component: linear and angular, world axes, at the coupling point.
template <class Lane>
using Motions = std::array<Lane, 6>;

/// x = 0, whatever it was.
template <class Scalar, class Lane>
[[gnu::always_inline]] inline void clear(Lane& x)
{
  if constexpr (std::is_same_v<Lane, Scalar>) {
    x = Scalar(0);
  } else if constexpr (requires { x.setZero(); }) {
    x.setZero();
  } else {
    x = Lane{};
  }
}

/// f(0), …, f(n − 1), behind them zeros. (Made in one: numbers put into a register one by one go through memory.)
template <class Lane, class Scalar, int n, class F>
[[gnu::always_inline]] inline void side_by_side(const F& f, Lane& lane)
{
  if constexpr (std::is_floating_point_v<Scalar> && sizeof(Lane) == 8 * sizeof(Scalar)) {
    const auto at = [&](auto k) __attribute__((always_inline)) {
      if constexpr (k < n) {
        return Scalar(f(k));
      } else {
        return Scalar(0);
      }
    };
    [&]<int... k>(std::integer_sequence<int, k...>) __attribute__((always_inline)) {
      lane = Lane{at(std::integral_constant<int, k>{})...};
    }(std::make_integer_sequence<int, 8>{});
  } else {
    clear<Scalar>(lane);
    for (int k = 0; k < n; ++k) { lane[k] = f(k); }
  }
}

/// The n columns of X side by side, in lanes 0 … n − 1.
template <class Lane, class Scalar, int n, class Columns>
[[gnu::always_inline]] inline Motions<Lane> abreast(const Columns& X)
{
  Motions<Lane> a;
#pragma GCC unroll 8
  for (int i = 0; i < 6; ++i) {
    side_by_side<Lane, Scalar, n>([&](int k) __attribute__((always_inline)) { return X(i, k); },
                                  a[static_cast<std::size_t>(i)]);
  }
  return a;
}

/// to = from, register by register: g++ copies an array in pieces, which are slow to load as a whole.
template <class Lane>
[[gnu::always_inline]] inline void copy(const Motions<Lane>& from, Motions<Lane>& to)
{
#pragma GCC unroll 8
  for (std::size_t i = 0; i < 6; ++i) { to[i] = from[i]; }
}

/// G += Σᵢ aᵢ bᵢᵀ.
template <class Lane, std::size_t terms>
[[gnu::always_inline]] inline void add_products(const std::array<Lane, terms>& a, const std::array<Lane, terms>& b,
                                                Lane& G)
{
#pragma GCC unroll 8
  for (std::size_t i = 0; i < terms; ++i) { G += a[i] * b[i]; }
}
template <class Lane, std::size_t terms, std::size_t n>
[[gnu::always_inline]] inline void add_products(const std::array<Lane, terms>& a, const std::array<Lane, terms>& b,
                                                std::array<Lane, n>& G)
{
  // A loop: written out, a controller is 3 % larger.
#pragma GCC unroll 1
  for (std::size_t k = 0; k < n; ++k) {
    Lane column = G[k];
#pragma GCC unroll 8
    for (std::size_t i = 0; i < terms; ++i) { column += a[i] * b[i][static_cast<int>(k)]; }
    G[k] = column;
  }
}

/// Accelerations, and the forces and moments that an inertia takes by them, in the same axes about the same point.
template <class Lane>
struct Moved {
  Motions<Lane> a, wrench;
};

/// Q of both parts of x, or Qᵀ.
template <bool transposed, class Lane, class Scalar>
[[gnu::always_inline]] inline void turn(const Matrix3<Scalar>& Q, const Motions<Lane>& x, Motions<Lane>& result)
{
  for (std::size_t k = 0; k < 6; k += 3) {
#pragma GCC unroll 8
    for (int i = 0; i < 3; ++i) {
      const auto q = [&](int j) { return transposed ? Q(j, i) : Q(i, j); };
      result[k + static_cast<std::size_t>(i)] = x[k] * q(0) + x[k + 1] * q(1) + x[k + 2] * q(2);
    }
  }
}

/// Of the body on a frame that has the accelerations a at its coupling point, from which the frame's origin is r away.
/// wrench: at the coupling point in world axes. (Called: with a copy for each kind of sum a controller is 5 % larger,
/// and arms under loads take up to 8 % less time.)
template <class Lane, class Scalar>
[[gnu::noinline]] void move_body(const FrameMass<Scalar>& body, const Matrix3<Scalar>& R, const Vector3<Scalar>& r,
                                 const Motions<Lane>& at_point, Moved<Lane>& moved, Motions<Lane>& wrench)
{
  Vector3<Scalar> centre = times(R, body.com);
  add(centre, r);
  Motions<Lane> a, w;
  copy(at_point, a);
  move_twist(centre, a);
  // Turning in the body's axes, where its moments are what they are.
  Motions<Lane> own;
#pragma GCC unroll 8
  for (int i = 0; i < 3; ++i) {
    const auto at = static_cast<std::size_t>(i);
    moved.a[at] = a[at];
    moved.wrench[at] = w[at] = a[at] * body.mass;
    own[at] = a[3] * R(0, i) + a[4] * R(1, i) + a[5] * R(2, i);
    moved.a[at + 3] = own[at];
  }
#pragma GCC unroll 8
  for (int i = 0; i < 3; ++i) {
    const Matrix3<Scalar>& I = body.central_inertia;
    const auto at = static_cast<std::size_t>(i) + 3;
    moved.wrench[at] = own[at] = own[0] * I(i, 0) + own[1] * I(i, 1) + own[2] * I(i, 2);
  }
#pragma GCC unroll 8
  for (int i = 0; i < 3; ++i) {
    w[static_cast<std::size_t>(i) + 3] = own[3] * R(i, 0) + own[4] * R(i, 1) + own[5] * R(i, 2);
  }
  move_wrench(centre, w);
  copy(w, wrench);
}
template <class Lane, class Scalar, class Sum>
[[gnu::always_inline]] inline void add_body(const FrameMass<Scalar>& body, const Matrix3<Scalar>& R,
                                            const Vector3<Scalar>& r, const Motions<Lane>& at_point, Sum& G,
                                            Motions<Lane>& wrench)
{
  if (!body.present) {
    for (Lane& x : wrench) { clear<Scalar>(x); }
    return;
  }
  Moved<Lane> moved;
  move_body(body, R, r, at_point, moved, wrench);
  add_products(moved.a, moved.wrench, G);
}

/// Of all that a frame carries, A about its coupling point. `axes`: those of A; null: the world's.
template <class Lane, class Scalar>
[[gnu::noinline]] void move_inertia(const SpatialInertia<Scalar>& A, const Matrix3<Scalar>* axes,
                                    const Motions<Lane>& at_point, Moved<Lane>& moved, Motions<Lane>& wrench)
{
  Motions<Lane> a, w;
  if (axes) [[unlikely]] {
    turn<true>(*axes, at_point, a);
  } else {
    copy(at_point, a);
  }
  copy(a, moved.a);
  // Indices that g++ knows as constants: otherwise -O2 warns of places beyond the arrays.
  unrolled<3>([&](auto index) __attribute__((always_inline)) {
    constexpr int i = decltype(index)::value;
    constexpr std::size_t at = i;
    constexpr int low = std::min(i, 1), high = std::max(i, 1);  // of a symmetric block there is the upper half
    Lane force = a[0] * A.M(0, i) + a[1] * A.M(low, high) + a[2] * A.M(i, 2);
    Lane moment = a[3] * A.J(0, i) + a[4] * A.J(low, high) + a[5] * A.J(i, 2);
    force += a[3] * A.H(i, 0) + a[4] * A.H(i, 1) + a[5] * A.H(i, 2);
    moment += a[0] * A.H(0, i) + a[1] * A.H(1, i) + a[2] * A.H(2, i);
    w[at] = force;
    w[at + 3] = moment;
  });
  copy(w, moved.wrench);
  if (axes) [[unlikely]] {
    turn<false>(*axes, w, wrench);
  } else {
    copy(w, wrench);
  }
}
template <class Lane, class Scalar, class Sum>
[[gnu::always_inline]] inline void add_inertia(const SpatialInertia<Scalar>& A, const Matrix3<Scalar>* axes,
                                               const Motions<Lane>& at_point, Sum& G, Motions<Lane>& wrench)
{
  Moved<Lane> moved;
  move_inertia(A, axes, at_point, moved, wrench);
  add_products(moved.a, moved.wrench, G);
}

}  // namespace iim::detail
