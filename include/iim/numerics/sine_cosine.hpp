// Sine and cosine of one angle, inline for float and double: a call would take 10 ns per joint and empty all registers.
// turns.hpp: of many.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>

namespace iim::detail {

/// sin and cos of one angle.
template <class Scalar>
void sine_cosine(const Scalar& angle, Scalar& s, Scalar& c)
{
  using std::cos;
  using std::sin;
  s = sin(angle);
  c = cos(angle);
}

/// (sin r − r)/r³ and (cos r − 1 + r²/2)/r⁴ as polynomials in r² for |r| ≤ π/4, interpolated in Chebyshev's points with
/// 60 digits. Errors of sin and cos: 2e-17; of the short ones, for float, below 1e-10.
template <std::size_t terms>
struct SineSeries;
template <>
struct SineSeries<6> {
  static constexpr std::array<double, 6> sine{-0x1.5555555555555p-3, 0x1.1111111110bb2p-7,   -0x1.a01a019e83816p-13,
                                              0x1.71de379654304p-19, -0x1.ae600aca92c64p-26, 0x1.5e0b05bff20f2p-33};
  static constexpr std::array<double, 6> cosine{0x1.5555555555555p-5,   -0x1.6c16c16c16967p-10, 0x1.a01a019f4e9b4p-16,
                                                -0x1.27e4fa17bf139p-22, 0x1.1eeb68cd22f56p-29,  -0x1.907d8f29fe831p-37};
};
template <>
struct SineSeries<4> {
  static constexpr std::array<double, 4> sine{-0x1.555555545df18p-3, 0x1.11110deef0ae3p-7, -0x1.a013a740c35cep-13,
                                              0x1.6dbded5452c9bp-19};
  static constexpr std::array<double, 4> cosine{0x1.5555555502c6dp-5, -0x1.6c16bf54be1f5p-10, 0x1.a015c4462d9e2p-16,
                                                -0x1.25243c2f39550p-22};
};

/// Whether sums are rounded as they are written. Not so where a compiler may put the parts of π/2 together again, nor
/// in x87's registers.
#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || __FLT_EVAL_METHOD__ == 1 || __FLT_EVAL_METHOD__ == 2
inline constexpr bool rounds_as_written = false;
#else
inline constexpr bool rounds_as_written = true;
#endif

// The same of clang with a part of -ffast-math, which it has no macro for.
#ifdef __clang__
#define IIM_AS_WRITTEN _Pragma("clang fp reassociate(off)")
#else
#define IIM_AS_WRITTEN
#endif

/// Real: double, or several in a vector.
template <class Real, std::size_t terms>
[[gnu::always_inline]] inline Real polynomial(const std::array<double, terms>& coefficient, const Real& x)
{
  Real sum = coefficient[terms - 1] * x + coefficient[terms - 2];
#pragma GCC unroll 8
  for (std::size_t n = terms - 2; n > 0; --n) { sum = sum * x + coefficient[n - 1]; }
  return sum;
}

/// To 0.9 ulp of double with six terms. Cody and Waite: |angle − k π/2| ≤ π/4 in two parts, r + low. |angle| ≤ 1e4.
/// s, c: of r; the last bits of `shifted` are k.
template <std::size_t terms, class Real>
[[gnu::always_inline]] inline void reduced_sine_cosine(const Real& angle, Real& shifted, Real& s, Real& c)
{
  IIM_AS_WRITTEN
  constexpr double round = 0x1.8p52;  // added and subtracted: rounds to an integer, which is in the last bits
  shifted = angle * (2 / std::numbers::pi) + round;
  const Real k = shifted - round;
  const Real nearly = angle - k * 0x1.921fb544p+0;  // exact: 33 bits times 20
  const Real step = k * 0x1.0b4611a6p-34;           // exact
  const Real r = nearly - step;
  const Real low = ((nearly - r) - step) - k * 0x1.3198a2e037073p-69;
  const Real r2 = r * r, half = 0.5 * r2, w = 1.0 - half;
  s = r + (low * w + r * r2 * polynomial(SineSeries<terms>::sine, r2));
  c = w + (((1.0 - w) - half) + (r2 * r2 * polynomial(SineSeries<terms>::cosine, r2) - r * low));
}

/// sin and cos of r are those of the angle up to an exchange (k odd) and signs (k, k + 1 ≥ 2 modulo 4).
template <std::size_t terms>
[[gnu::always_inline]] inline void reduced_sine_cosine(double angle, double& sine, double& cosine)
{
  using Pair [[gnu::vector_size(16)]] = double;
  using Bits [[gnu::vector_size(16)]] = std::uint64_t;
  double shifted, s, c;
  reduced_sine_cosine<terms>(angle, shifted, s, c);
  const auto quarter = std::bit_cast<std::uint64_t>(shifted);
  const Bits turns{quarter, quarter + 1};
  const Bits odd = -(turns & 1);
  const Bits both = (odd & std::bit_cast<Bits>(Pair{c, c})) | (~odd & std::bit_cast<Bits>(Pair{s, s}));
  const Pair result = std::bit_cast<Pair>(both ^ ((turns & 2) << 62));
  sine = result[0];
  cosine = result[1];
}

#if defined(__GLIBC__) && defined(__USE_GNU)
inline void library_sine_cosine(double angle, double& s, double& c) { ::sincos(angle, &s, &c); }
#else
inline void library_sine_cosine(double angle, double& s, double& c) { s = std::sin(angle), c = std::cos(angle); }
#endif

inline constexpr double largest_reduced_angle = rounds_as_written ? 1e4 : -1;

inline void sine_cosine(double angle, double& s, double& c)
{
  if (std::abs(angle) <= largest_reduced_angle) [[likely]] {
    reduced_sine_cosine<6>(angle, s, c);
  } else {
    library_sine_cosine(angle, s, c);
  }
}
inline void sine_cosine(float angle, float& s, float& c)
{
  double sine, cosine;
  if (std::abs(angle) <= static_cast<float>(largest_reduced_angle)) [[likely]] {
    reduced_sine_cosine<4>(static_cast<double>(angle), sine, cosine);
  } else {
    library_sine_cosine(static_cast<double>(angle), sine, cosine);
  }
  s = static_cast<float>(sine);
  c = static_cast<float>(cosine);
}

}  // namespace iim::detail
