// Sines and cosines of all joint angles of a state at once, as many as a register holds. One joint after the other,
// each waiting for its series, the O(n) pass takes 9 % more time with AVX-512.
#pragma once

#include <iim/numerics/sine_cosine.hpp>
#include <iim/scalar.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <type_traits>

namespace iim {

/// What turning by an angle takes.
template <class Scalar>
struct Turn {
  Scalar sine, cosine;

  Turn() = default;
  [[gnu::always_inline]] explicit Turn(const Scalar& angle) { detail::sine_cosine(angle, sine, cosine); }
};

namespace detail {

/// `width` angles of magnitude ≤ largest_reduced_angle; others give numbers without meaning.
template <int width, class Scalar>
[[gnu::always_inline]] inline void several_sines(const Scalar* angle, Scalar* sine, Scalar* cosine)
{
  using Real [[gnu::vector_size(8 * width)]] = double;
  using Bits [[gnu::vector_size(8 * width)]] = std::int64_t;
  using Numbers [[gnu::vector_size(sizeof(Scalar) * width)]] = Scalar;
  Numbers numbers;
  std::memcpy(&numbers, angle, sizeof numbers);
  Real shifted, s, c;
  reduced_sine_cosine<std::is_same_v<Scalar, float> ? 4 : 6>(__builtin_convertvector(numbers, Real), shifted, s, c);
  // As for one angle: an exchange, and signs.
  const Bits quarter = reinterpret_cast<Bits>(shifted), odd = -(quarter & 1);
  const Bits s_bits = reinterpret_cast<Bits>(s), c_bits = reinterpret_cast<Bits>(c);
  const Bits exchanged = (s_bits ^ c_bits) & odd;
  s = reinterpret_cast<Real>((s_bits ^ exchanged) ^ ((quarter & 2) << 62));
  c = reinterpret_cast<Real>((c_bits ^ exchanged) ^ (((quarter + 1) & 2) << 62));
  numbers = __builtin_convertvector(s, Numbers);
  std::memcpy(sine, &numbers, sizeof numbers);
  numbers = __builtin_convertvector(c, Numbers);
  std::memcpy(cosine, &numbers, sizeof numbers);
}

/// The turns of one state. For other numbers than float and double each is computed when it is asked for.
template <class Scalar>
class Turns {
public:
  /// Coordinate i, larger than those before, is an angle that will be asked for.
  void add(Eigen::Index) {}

  /// After the last of them.
  void allocate() {}

  template <class Q>
  void set(const Q&)
  {
  }

  /// Of coordinate i, which is `angle`.
  Turn<Scalar> of(Eigen::Index, const Scalar& angle) const { return Turn<Scalar>(angle); }
};

template <class Scalar>
  requires(std::is_same_v<Scalar, double> || std::is_same_v<Scalar, float>)
class Turns<Scalar> {
public:
  void add(Eigen::Index i)
  {
    begin_ = end_ == 0 ? i : begin_;
    end_ = i + 1;
  }

  void allocate()
  {
    for (auto* numbers : {&sine_, &cosine_, &angle_}) { numbers->resize(end_ - begin_); }
  }

  template <class Q>
  void set(const Q& q)
  {
    if constexpr (largest_reduced_angle > 0) {
      const Scalar* from = angle_.data();
      if constexpr (requires { q.data(); } && Q::InnerStrideAtCompileTime == 1) {
        from = q.data() + begin_;
      } else {
        angle_ = q.segment(begin_, angle_.size());
      }
      set<std::clamp<int>(EIGEN_MAX_STATIC_ALIGN_BYTES / sizeof(double), 2, 8)>(from);
    }
  }

  [[gnu::always_inline]] Turn<Scalar> of(Eigen::Index i, const Scalar& angle) const
  {
    if (!(std::abs(angle) <= static_cast<Scalar>(largest_reduced_angle))) [[unlikely]] { return Turn<Scalar>(angle); }
    Turn<Scalar> turn;
    turn.sine = sine_.data()[i - begin_];
    turn.cosine = cosine_.data()[i - begin_];
    return turn;
  }

private:
  /// The last begin earlier instead of being fewer.
  template <int width>
  void set(const Scalar* angle)
  {
    const Eigen::Index n = sine_.size();
    if (n < width) {
      if constexpr (width > 1) { set<width / 2>(angle); }
      return;
    }
    for (Eigen::Index i = 0; i < n; i += width) {
      const Eigen::Index at = std::min<Eigen::Index>(i, n - width);
      if constexpr (width > 1) {
        several_sines<width>(angle + at, sine_.data() + at, cosine_.data() + at);
      } else {
        sine_cosine(angle[at], sine_(at), cosine_(at));
      }
    }
  }

  Eigen::Index begin_ = 0, end_ = 0;  ///< coordinates from the first to behind the last
  Eigen::Matrix<Scalar, Eigen::Dynamic, 1> sine_, cosine_;
  Eigen::Matrix<Scalar, Eigen::Dynamic, 1> angle_;  ///< if they do not lie side by side
};

}  // namespace detail
}  // namespace iim
