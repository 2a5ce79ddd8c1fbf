// The number of lanes.hpp: arithmetic, roots, sines, comparisons for all lanes.
#pragma once

#include <iim/numerics/row.hpp>
#include <iim/scalar.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <ostream>
#include <type_traits>

#if defined(__AVX__) || defined(__SSE2__)
#include <immintrin.h>
#endif

namespace iim {

/// Whether a comparison of this thread was true in some lanes and false in others since the last `reset`.
class LaneVote {
public:
  static bool divided() { return divided_; }
  static void reset() { divided_ = false; }
  static void divide() { divided_ = true; }

private:
  static inline thread_local constinit bool divided_ = false;
};

namespace detail {

template <class T>
struct BitsOf;
template <>
struct BitsOf<double> {
  using Type = std::uint64_t;
  static constexpr Type sign = 0x8000000000000000u, exponent = 0x7ff0000000000000u, one = 0x0010000000000000u;
  static constexpr double round = 0x1.8p52;  ///< added and subtracted: rounds to an integer, which is in the last bits
  static constexpr std::array<double, 4> half_pi{0x1.921fb544p+0, 0x1.0b4611a6p-34, 0x1.3198a2e037073p-69, 0};
  static constexpr double largest_angle = 1e6;  ///< multiples of the leading parts of π/2 are exact up to here
  static constexpr int terms = 8;
};
template <>
struct BitsOf<float> {
  using Type = std::uint32_t;
  static constexpr Type sign = 0x80000000u, exponent = 0x7f800000u, one = 0x00800000u;
  static constexpr float round = 0x1.8p23f;
  static constexpr std::array<float, 4> half_pi{0x1.92p+0f, 0x1.fb4p-12f, 0x1.444p-24f, 0x1.68c234p-39f};
  static constexpr float largest_angle = 1e4f;
  static constexpr int terms = 5;
};

/// What a vector register holds, of it no more than Eigen aligns (EIGEN_DONT_VECTORIZE, EIGEN_MAX_ALIGN_BYTES).
inline constexpr int lanes_bytes =
    std::min({register_bytes, std::max(16, EIGEN_DEFAULT_ALIGN_BYTES),
              EIGEN_MAX_STATIC_ALIGN_BYTES > 0 ? EIGEN_MAX_STATIC_ALIGN_BYTES : register_bytes});

}  // namespace detail

/// N numbers, one of each of N states. (A register as in Row; <experimental/simd>, which consists of such, takes 0.8 s
/// to compile, and clang does not contract its products and sums.) T: double or float. N: by default what a vector
/// register holds.
template <class T, int N = detail::lanes_bytes / static_cast<int>(sizeof(T))>
class Lanes {
  static_assert(std::is_same_v<T, double> || std::is_same_v<T, float>);
  static_assert(N > 0 && (N & (N - 1)) == 0 && N * static_cast<int>(sizeof(T)) <= detail::lanes_bytes,
                "Lanes: a power of two that fits into one vector register, and that Eigen aligns");
  using BitTraits = detail::BitsOf<T>;
  using Word = typename BitTraits::Type;
  using Vector = typename detail::VectorOf<T, N>::Type;
  using Words = typename detail::VectorOf<Word, N>::Type;

public:
  using value_type = T;
  static constexpr int size = N;

  Lanes() = default;

  /// The same number in all lanes.
  template <class Number>
    requires std::is_arithmetic_v<Number>
  [[gnu::always_inline]] Lanes(Number x) : v_(static_cast<T>(x) - Vector{})  // x − 0 is x, also for −0
  {
  }

  [[gnu::always_inline]] T operator[](int lane) const { return v_[lane]; }
  [[gnu::always_inline]] void set(int lane, T x) { v_[lane] = x; }

  /// The number that all lanes hold (constants of a tree); NaN if they differ.
  explicit operator double() const
  {
    for (int k = 1; k < N; ++k) {
      if (!(v_[k] == v_[0])) { return std::numeric_limits<double>::quiet_NaN(); }
    }
    return static_cast<double>(v_[0]);
  }

  // clang contracts over function boundaries only where it is told to.
#ifdef __clang__
#define IIM_CONTRACT _Pragma("clang fp contract(fast)")
#else
#define IIM_CONTRACT
#endif
  [[gnu::always_inline]] friend inline Lanes operator+(const Lanes& a, const Lanes& b)
  {
    IIM_CONTRACT
    return of(a.v_ + b.v_);
  }
  [[gnu::always_inline]] friend inline Lanes operator-(const Lanes& a, const Lanes& b)
  {
    IIM_CONTRACT
    return of(a.v_ - b.v_);
  }
  [[gnu::always_inline]] friend inline Lanes operator*(const Lanes& a, const Lanes& b)
  {
    IIM_CONTRACT
    return of(a.v_ * b.v_);
  }
  [[gnu::always_inline]] friend inline Lanes operator/(const Lanes& a, const Lanes& b) { return of(a.v_ / b.v_); }
  [[gnu::always_inline]] friend inline Lanes operator-(const Lanes& a) { return of(-a.v_); }
#undef IIM_CONTRACT
  [[gnu::always_inline]] friend inline Lanes operator+(const Lanes& a) { return a; }
  [[gnu::always_inline]] Lanes& operator+=(const Lanes& b) { return *this = *this + b; }
  [[gnu::always_inline]] Lanes& operator-=(const Lanes& b) { return *this = *this - b; }
  [[gnu::always_inline]] Lanes& operator*=(const Lanes& b) { return *this = *this * b; }
  [[gnu::always_inline]] Lanes& operator/=(const Lanes& b) { return *this = *this / b; }

  // In every lane; LaneVote where lanes differ.
  // clang-format off
  friend bool operator==(const Lanes& a, const Lanes& b) { return vote(a.v_ == b.v_); }
  friend bool operator<(const Lanes& a, const Lanes& b) { return vote(a.v_ < b.v_); }
  friend bool operator<=(const Lanes& a, const Lanes& b) { return vote(a.v_ <= b.v_); }
  // clang-format on
  friend bool operator>(const Lanes& a, const Lanes& b) { return b < a; }
  friend bool operator>=(const Lanes& a, const Lanes& b) { return b <= a; }

  /// Correctly rounded as std::sqrt is, but one instruction, without errno.
  [[gnu::always_inline]] friend inline Lanes sqrt(const Lanes& a)
  {
#if defined(__AVX512F__)
    if constexpr (bytes == 64 && N == 8) { return from(_mm512_maskz_sqrt_pd(0xff, a.as<__m512d>())); }
    if constexpr (bytes == 64 && N == 16) { return from(_mm512_maskz_sqrt_ps(0xffff, a.as<__m512>())); }
#endif
#if defined(__AVX__)
    if constexpr (bytes == 32 && N == 4) { return from(_mm256_sqrt_pd(a.as<__m256d>())); }
    if constexpr (bytes == 32 && N == 8) { return from(_mm256_sqrt_ps(a.as<__m256>())); }
#endif
#if defined(__SSE2__)
    if constexpr (bytes == 16 && N == 2) { return from(_mm_sqrt_pd(a.as<__m128d>())); }
    if constexpr (bytes == 16 && N == 4) { return from(_mm_sqrt_ps(a.as<__m128>())); }
#endif
    return each([&](int k) { return std::sqrt(a[k]); });
  }
  // clang-format off
  friend Lanes abs(const Lanes& a) { return each([&](int k) { return std::abs(a[k]); }); }
  // clang-format on
  // Of vectors: what is written lane by lane stays so with g++ (8 % of the O(n) pass, whose sizes are maxima).
  [[gnu::always_inline]] friend inline Lanes max(const Lanes& a, const Lanes& b)
  {
    return of(a.v_ < b.v_ ? b.v_ : a.v_);
  }
  [[gnu::always_inline]] friend inline Lanes min(const Lanes& a, const Lanes& b)
  {
    return of(b.v_ < a.v_ ? b.v_ : a.v_);
  }
  friend Lanes fabs(const Lanes& a) { return abs(a); }
  /// Found by detail::if_greater: a > b ? x : y, lane by lane.
  [[gnu::always_inline]] friend inline Lanes if_greater(const Lanes& a, const Lanes& b, const Lanes& x, const Lanes& y)
  {
    return of(a.v_ > b.v_ ? x.v_ : y.v_);
  }

  friend inline Lanes sin(const Lanes& a) { return sine(a, 0); }
  friend inline Lanes cos(const Lanes& a) { return sine(a, 1); }

  // Lane by lane, for subsystems that need them.
  // clang-format off
  friend Lanes tan(const Lanes& a) { return each([&](int k) { return std::tan(a[k]); }); }
  friend Lanes asin(const Lanes& a) { return each([&](int k) { return std::asin(a[k]); }); }
  friend Lanes acos(const Lanes& a) { return each([&](int k) { return std::acos(a[k]); }); }
  friend Lanes atan(const Lanes& a) { return each([&](int k) { return std::atan(a[k]); }); }
  friend Lanes atan2(const Lanes& a, const Lanes& b) { return each([&](int k) { return std::atan2(a[k], b[k]); }); }
  friend Lanes exp(const Lanes& a) { return each([&](int k) { return std::exp(a[k]); }); }
  friend Lanes log(const Lanes& a) { return each([&](int k) { return std::log(a[k]); }); }
  friend Lanes tanh(const Lanes& a) { return each([&](int k) { return std::tanh(a[k]); }); }
  friend Lanes hypot(const Lanes& a, const Lanes& b) { return each([&](int k) { return std::hypot(a[k], b[k]); }); }
  friend Lanes pow(const Lanes& a, const Lanes& b) { return each([&](int k) { return std::pow(a[k], b[k]); }); }
  // clang-format on

  friend bool isfinite(const Lanes& a) { return a.is_finite(); }
  friend std::ostream& operator<<(std::ostream& out, const Lanes& a)
  {
    for (int k = 0; k < N; ++k) { out << (k == 0 ? "[" : " ") << a[k]; }
    return out << "]";
  }

  /// In every lane; without a mark. Answered by bits, so that -ffast-math cannot optimise them away.
  [[gnu::always_inline]] bool is_finite() const
  {
    const Words bits = words(*this);
    return !any_sign((bits & BitTraits::exponent) + BitTraits::one);
  }
  [[gnu::always_inline]] bool is_positive() const
  {
    const Words bits = words(*this);
    return !any_sign(bits | (bits - 1) | (bits - 1 + BitTraits::one));  // negative, zero, NaN
  }
  /// Found by detail::all_finite: whether `count` Lanes in a row are finite.
  friend bool all_finite(const Lanes* x, Eigen::Index count)
  {
    Words carried = words(Lanes(0));
    for (Eigen::Index k = 0; k < count; ++k) { carried |= (words(x[k]) & BitTraits::exponent) + BitTraits::one; }
    return !any_sign(carried);
  }

  [[gnu::always_inline]] void hold() { detail::hold_register(v_); }

  T* data() { return reinterpret_cast<T*>(&v_); }
  const T* data() const { return reinterpret_cast<const T*>(&v_); }

private:
  static constexpr int bytes = N * static_cast<int>(sizeof(T));

  [[gnu::always_inline]] static Lanes of(const Vector& v)
  {
    Lanes lanes;
    lanes.v_ = v;
    return lanes;
  }
  /// From and to the processor's own names of the same register.
  template <class Register>
  [[gnu::always_inline]] static Lanes from(const Register& r)
  {
    return of(std::bit_cast<Vector>(r));
  }
  template <class Register>
  [[gnu::always_inline]] Register as() const
  {
    return std::bit_cast<Register>(v_);
  }
  template <class F>
  [[gnu::always_inline]] static Lanes each(F&& f)
  {
    Lanes result;
    for (int k = 0; k < N; ++k) { result.v_[k] = f(k); }
    return result;
  }
  /// yes: of each lane all bits or none. (Lane by lane, several states take 1 to 2 % more.)
  template <class Mask>
  [[gnu::always_inline]] static bool vote(const Mask& yes)
  {
    const Words bits = std::bit_cast<Words>(yes);
    if (!any_sign(bits)) { return false; }
    if (!any_sign(~bits)) { return true; }
    LaneVote::divide();
    return false;
  }

  [[gnu::always_inline]] static Words words(const Lanes& a) { return std::bit_cast<Words>(a.v_); }
  [[gnu::always_inline]] static Lanes numbers(const Words& bits) { return of(std::bit_cast<Vector>(bits)); }

  /// Whether the uppermost bit of any lane is set.
  [[gnu::always_inline]] static bool any_sign(const Words& w)
  {
#if defined(__AVX512DQ__)
    if constexpr (bytes == 64 && N == 8) { return _mm512_movepi64_mask(std::bit_cast<__m512i>(w)) != 0; }
    if constexpr (bytes == 64 && N == 16) { return _mm512_movepi32_mask(std::bit_cast<__m512i>(w)) != 0; }
#endif
#if defined(__AVX__)
    if constexpr (bytes == 32 && N == 4) { return _mm256_movemask_pd(std::bit_cast<__m256d>(w)) != 0; }
    if constexpr (bytes == 32 && N == 8) { return _mm256_movemask_ps(std::bit_cast<__m256>(w)) != 0; }
#endif
#if defined(__SSE2__)
    if constexpr (bytes == 16 && N == 2) { return _mm_movemask_pd(std::bit_cast<__m128d>(w)) != 0; }
    if constexpr (bytes == 16 && N == 4) { return _mm_movemask_ps(std::bit_cast<__m128>(w)) != 0; }
#endif
    Word any = 0;
    for (int k = 0; k < N; ++k) { any |= w[k]; }
    return (any & BitTraits::sign) != 0;
  }

  /// sin(angle + quarter_turns·π/2) to 1.5 ulp, 2.5 from 100 rad on: Cody and Waite's reduction to |r| ≤ π/4 and the
  /// Taylor series, whose first neglected term is below ε/50. Both series are needed, each in some lanes; sin and cos
  /// of one angle share them.
  [[gnu::always_inline]] static inline Lanes sine(const Lanes& angle, int quarter_turns)
  {
    if constexpr (detail::rounds_as_written) {
      const Words magnitude = words(angle) & ~words(Lanes(T(-0.0)));
      if (!any_sign(words(Lanes(BitTraits::largest_angle)) - magnitude)) {
        return reduced_sine(angle.v_, quarter_turns);
      }
    }
    return each([&](int k) { return quarter_turns == 0 ? std::sin(angle[k]) : std::cos(angle[k]); });
  }

  [[gnu::always_inline]] static inline Lanes reduced_sine(const Vector& angle, int quarter_turns)
  {
    IIM_AS_WRITTEN
    const Vector shifted = angle * all(T(2 / std::numbers::pi)) + all(BitTraits::round);
    const Words quarter = std::bit_cast<Words>(shifted) + static_cast<Word>(quarter_turns);
    const Vector k = shifted - all(BitTraits::round);
    Vector r = angle;
    for (const T part : BitTraits::half_pi) {
      if (part != 0) { r -= k * all(part); }
    }
    const Vector r2 = r * r;
    Vector s = all(inverse_factorial(2 * BitTraits::terms + 1));
    Vector c = all(inverse_factorial(2 * BitTraits::terms));
    for (int n = BitTraits::terms - 1; n > 0; --n) {
      s = all(inverse_factorial(2 * n + 1)) - r2 * s;
      c = all(inverse_factorial(2 * n)) - r2 * c;
    }
    s = r - r * (r2 * s);
    c = all(T(1)) - r2 * c;
    const Words odd = -(quarter & 1);
    const Words sign = (quarter & 2) << (sizeof(T) * 8 - 2);
    return numbers(((odd & std::bit_cast<Words>(c)) | (~odd & std::bit_cast<Words>(s))) ^ sign);
  }

  [[gnu::always_inline]] static Vector all(T x) { return Lanes(x).v_; }
  static constexpr T inverse_factorial(int n)
  {
    double product = 1;
    for (int k = 2; k <= n; ++k) { product *= k; }
    return static_cast<T>(1 / product);
  }

  Vector v_;
};

}  // namespace iim
