// Three numbers that are worked on together, and pairs of them: columns of 3 × 3 blocks, wrenches, gains.
#pragma once

#include <algorithm>
#include <bit>
#include <cstring>
#include <type_traits>

#if defined(__AVX2__)
#include <immintrin.h>
#endif

namespace iim::detail {

/// Whether three numbers of this type lie in one register, with a fourth, zero. (Where four doubles need two registers,
/// the O(n) pass takes 2.7 times as long with them as with single numbers.)
template <class Scalar>
inline constexpr bool three_in_register = false;
#if defined(__AVX2__)
template <>
inline constexpr bool three_in_register<double> = true;
#endif
template <>
inline constexpr bool three_in_register<float> = true;

/// (a, b, c).
template <class Scalar>
class Triple {
public:
  Triple() = default;
  /// Number by number: of registers g++ copies what is not by halves, or calls memcpy, and the next load waits for that
  /// (several states with AVX2: arm 19 % less, biped 7 %).
  [[gnu::always_inline]] Triple(const Triple& b) : at_{b.at_[0], b.at_[1], b.at_[2]} {}
  [[gnu::always_inline]] Triple& operator=(const Triple& b)
  {
    at_[0] = b.at_[0], at_[1] = b.at_[1], at_[2] = b.at_[2];
    return *this;
  }
  [[gnu::always_inline]] Triple(const Scalar& a, const Scalar& b, const Scalar& c) : at_{a, b, c} {}
  /// Three numbers that lie one behind the other.
  [[gnu::always_inline]] explicit Triple(const Scalar* x) : at_{x[0], x[1], x[2]} {}
  [[gnu::always_inline]] void put(Scalar* x) const { x[0] = at_[0], x[1] = at_[1], x[2] = at_[2]; }
  /// The same for numbers that were written some time ago, where x[3], or x[-1], may be read, too.
  [[gnu::always_inline]] static Triple settled(const Scalar* x) { return Triple(x); }
  [[gnu::always_inline]] static Triple settled_after(const Scalar* x) { return Triple(x); }

  [[gnu::always_inline]] const Scalar& operator()(int i) const { return at_[i]; }
  /// Number i as a factor of another triple.
  template <int i>
  [[gnu::always_inline]] const Scalar& all() const
  {
    return at_[i];
  }
  [[gnu::always_inline]] static const Scalar& all(const Scalar& x) { return x; }

  [[gnu::always_inline]] Triple& operator+=(const Triple& b)
  {
    at_[0] += b.at_[0], at_[1] += b.at_[1], at_[2] += b.at_[2];
    return *this;
  }
  [[gnu::always_inline]] friend Triple operator+(const Triple& a, const Triple& b)
  {
    return Triple(a.at_[0] + b.at_[0], a.at_[1] + b.at_[1], a.at_[2] + b.at_[2]);
  }
  [[gnu::always_inline]] friend Triple operator-(const Triple& a, const Triple& b)
  {
    return Triple(a.at_[0] - b.at_[0], a.at_[1] - b.at_[1], a.at_[2] - b.at_[2]);
  }
  [[gnu::always_inline]] friend Triple operator*(const Triple& a, const Scalar& s)
  {
    return Triple(a.at_[0] * s, a.at_[1] * s, a.at_[2] * s);
  }
  /// Number by number.
  [[gnu::always_inline]] friend Triple operator*(const Triple& a, const Triple& b)
  {
    return Triple(a.at_[0] * b.at_[0], a.at_[1] * b.at_[1], a.at_[2] * b.at_[2]);
  }
  [[gnu::always_inline]] friend Scalar dot(const Triple& a, const Triple& b)
  {
    return a.at_[0] * b.at_[0] + a.at_[1] * b.at_[1] + a.at_[2] * b.at_[2];
  }
  [[gnu::always_inline]] friend Scalar sum(const Triple& a) { return a.at_[0] + a.at_[1] + a.at_[2]; }
  [[gnu::always_inline]] friend Triple cross(const Triple& a, const Triple& b)
  {
    return Triple(a.at_[1] * b.at_[2] - a.at_[2] * b.at_[1], a.at_[2] * b.at_[0] - a.at_[0] * b.at_[2],
                  a.at_[0] * b.at_[1] - a.at_[1] * b.at_[0]);
  }
  [[gnu::always_inline]] friend Triple max(const Triple& a, const Triple& b)
  {
    using std::max;
    return Triple(max(a.at_[0], b.at_[0]), max(a.at_[1], b.at_[1]), max(a.at_[2], b.at_[2]));
  }
  /// (b, c, a).
  [[gnu::always_inline]] Triple turned() const { return Triple(at_[1], at_[2], at_[0]); }

private:
  Scalar at_[3];  // std::array's subscripts were half of all calls that g++ inlined in a controller
};

// clang contracts over function boundaries only where it is told to.
#ifdef __clang__
#define IIM_CONTRACT _Pragma("clang fp contract(fast)")
#else
#define IIM_CONTRACT
#endif

template <class Scalar>
  requires three_in_register<Scalar>
class Triple<Scalar> {
  using Vector [[gnu::vector_size(4 * sizeof(Scalar))]] = Scalar;
  using Half [[gnu::vector_size(2 * sizeof(Scalar))]] = Scalar;
  /// What it is stored as; unlike bytes, not to be taken for other than Scalars (kinematics of a joint: 5 of 204
  /// instructions).
  using HalfInMemory [[gnu::vector_size(2 * sizeof(Scalar)), gnu::aligned(sizeof(Scalar))]] = Scalar;

public:
  Triple() = default;
  [[gnu::always_inline]] Triple(Scalar a, Scalar b, Scalar c) : v_{a, b, c, Scalar(0)} {}
  [[gnu::always_inline]] explicit Triple(const Scalar* x)
  {
#if defined(__AVX2__)
    if constexpr (std::is_same_v<Scalar, double>) {  // g++ takes one instruction more for the same
      v_ = std::bit_cast<Vector>(_mm256_insertf128_pd(_mm256_castpd128_pd256(_mm_loadu_pd(x)), _mm_load_sd(x + 2), 1));
      return;
    }
#endif
    Half first;
    std::memcpy(&first, x, sizeof first);
    const Half last{x[2], Scalar(0)};
    v_ = __builtin_shufflevector(first, last, 0, 1, 2, 3);
  }
  /// The same for numbers that were written some time ago, where x[3], or x[-1], may be read, too: one instruction
  /// instead of three, but a load of four numbers waits until stores of fewer have left the core. That x[3] must be a
  /// number: clang computes with it where it sees that nothing comes of it, and flags or addresses are subnormal there,
  /// which Intel's processors take 150 cycles for (flags behind FrameState::bias: arm 1.5 times as long, biped 1.3).
  [[gnu::always_inline]] static Triple settled(const Scalar* x)
  {
    Vector four;
    std::memcpy(&four, x, sizeof four);
#if defined(__AVX2__)
    if constexpr (std::is_same_v<Scalar, double>) {  // g++ makes three of the other
      return of(std::bit_cast<Vector>(_mm256_blend_pd(std::bit_cast<__m256d>(four), _mm256_setzero_pd(), 8)));
    } else {
      return of(std::bit_cast<Vector>(_mm_blend_ps(std::bit_cast<__m128>(four), _mm_setzero_ps(), 8)));
    }
#else
    return of(__builtin_shufflevector(four, Vector{}, 0, 1, 2, 7));
#endif
  }
  [[gnu::always_inline]] static Triple settled_after(const Scalar* x)
  {
    Vector four;
    std::memcpy(&four, x - 1, sizeof four);
#if defined(__AVX512VL__)
    if constexpr (std::is_same_v<Scalar, double>) {
      return of(std::bit_cast<Vector>(_mm256_alignr_epi64(_mm256_setzero_si256(), std::bit_cast<__m256i>(four), 1)));
    }
#endif
    return of(__builtin_shufflevector(four, Vector{}, 1, 2, 3, 7));
  }
  [[gnu::always_inline]] void put(Scalar* x) const
  {
    *reinterpret_cast<HalfInMemory*>(x) = __builtin_shufflevector(v_, v_, 0, 1);
    x[2] = v_[2];
  }

  [[gnu::always_inline]] Scalar operator()(int i) const { return v_[i]; }
  template <int i>
  [[gnu::always_inline]] Triple all() const
  {
    return of(__builtin_shufflevector(v_, v_, i, i, i, i));
  }
  [[gnu::always_inline]] static Triple all(Scalar x) { return of(Vector{x, x, x, x}); }

  [[gnu::always_inline]] Triple& operator+=(const Triple& b) { return *this = *this + b; }
  [[gnu::always_inline]] friend Triple operator+(const Triple& a, const Triple& b)
  {
    IIM_CONTRACT
    return of(a.v_ + b.v_);
  }
  [[gnu::always_inline]] friend Triple operator-(const Triple& a, const Triple& b)
  {
    IIM_CONTRACT
    return of(a.v_ - b.v_);
  }
  [[gnu::always_inline]] friend Triple operator*(const Triple& a, const Triple& all)
  {
    IIM_CONTRACT
    return of(a.v_ * all.v_);
  }
  [[gnu::always_inline]] friend Triple operator*(const Triple& a, Scalar s) { return a * all(s); }
  [[gnu::always_inline]] friend Scalar dot(const Triple& a, const Triple& b) { return sum(a * b); }
  [[gnu::always_inline]] friend Scalar sum(const Triple& a)
  {
#if defined(__AVX2__)
    if constexpr (std::is_same_v<Scalar, double>) {
      const __m256d v = std::bit_cast<__m256d>(a.v_);
      const __m128d low = _mm256_castpd256_pd128(v), high = _mm256_extractf128_pd(v, 1);
      return _mm_cvtsd_f64(_mm_add_sd(_mm_add_sd(low, _mm_unpackhi_pd(low, low)), high));
    }
#endif
    return (a.v_[0] + a.v_[1]) + a.v_[2];
  }
  [[gnu::always_inline]] friend Triple cross(const Triple& a, const Triple& b)
  {
    return (a * b.turned() - a.turned() * b).turned();
  }
  [[gnu::always_inline]] friend Triple max(const Triple& a, const Triple& b) { return of(a.v_ > b.v_ ? a.v_ : b.v_); }
  [[gnu::always_inline]] Triple turned() const { return of(__builtin_shufflevector(v_, v_, 1, 2, 0, 3)); }

  /// The transpose of the columns a, b, c.
  [[gnu::always_inline]] friend void transpose(const Triple& a, const Triple& b, const Triple& c, Triple* row)
  {
    const Vector even = __builtin_shufflevector(a.v_, b.v_, 0, 4, 2, 6),
                 odd = __builtin_shufflevector(a.v_, b.v_, 1, 5, 3, 7);
    row[0] = of(__builtin_shufflevector(even, c.v_, 0, 1, 4, 7));
    row[1] = of(__builtin_shufflevector(odd, c.v_, 0, 1, 5, 7));
    row[2] = of(__builtin_shufflevector(even, c.v_, 2, 3, 6, 7));
  }

  /// The diagonal of the columns a, b, c.
  [[gnu::always_inline]] friend Triple diagonal_of(const Triple& a, const Triple& b, const Triple& c)
  {
    return of(__builtin_shufflevector(__builtin_shufflevector(a.v_, b.v_, 0, 5, 2, 3), c.v_, 0, 1, 6, 7));
  }

  /// The columns of the transposed cross-product matrix of a.
  [[gnu::always_inline]] friend void skew_transposed(const Triple& a, Triple* column)
  {
    const Vector minus = -a.v_;
    column[0] = of(__builtin_shufflevector(a.v_, minus, 3, 6, 1, 3));
    column[1] = of(__builtin_shufflevector(a.v_, minus, 2, 3, 4, 3));
    column[2] = of(__builtin_shufflevector(a.v_, minus, 5, 0, 3, 3));
  }

  /// The first two columns of a symmetric matrix whose upper triangle stands in the columns a, b, c.
  [[gnu::always_inline]] friend Triple mirror_first(const Triple& a, const Triple& b, const Triple& c)
  {
    const Vector even = __builtin_shufflevector(a.v_, b.v_, 0, 4, 2, 6);
    return of(__builtin_shufflevector(even, c.v_, 0, 1, 4, 7));
  }
  [[gnu::always_inline]] friend Triple mirror_second(const Triple& b, const Triple& c)
  {
    return of(__builtin_shufflevector(b.v_, c.v_, 0, 1, 5, 7));
  }

private:
  [[gnu::always_inline]] static Triple of(const Vector& v)
  {
    Triple t;
    t.v_ = v;
    return t;
  }
  Vector v_;
};
#undef IIM_CONTRACT

/// A wrench or a twist.
template <class Scalar>
struct TriplePair {
  Triple<Scalar> linear, angular;

  TriplePair() = default;
  /// One after the other: both in one, as g++ copies otherwise, are loaded in another size than they were stored in,
  /// and wait for that (passes of chains of boxes, where small pivots are mended, 22 % less).
  [[gnu::always_inline]] TriplePair(const TriplePair& b) : linear(b.linear), angular(b.angular) {}
  [[gnu::always_inline]] TriplePair& operator=(const TriplePair& b)
  {
    linear = b.linear;
    angular = b.angular;
    return *this;
  }
  [[gnu::always_inline]] TriplePair(const Triple<Scalar>& lin, const Triple<Scalar>& ang) : linear(lin), angular(ang) {}
  /// Six numbers that lie one behind the other.
  [[gnu::always_inline]] explicit TriplePair(const Scalar* x) : linear(x), angular(x + 3) {}
  /// The same as of Triple::settled, where x[6] may be read, too.
  [[gnu::always_inline]] static TriplePair settled(const Scalar* x)
  {
    return {Triple<Scalar>::settled(x), Triple<Scalar>::settled(x + 3)};
  }

  [[gnu::always_inline]] TriplePair& operator+=(const TriplePair& other)
  {
    linear += other.linear;
    angular += other.angular;
    return *this;
  }
  [[gnu::always_inline]] TriplePair& operator-=(const TriplePair& other)
  {
    linear = linear - other.linear;
    angular = angular - other.angular;
    return *this;
  }
  [[gnu::always_inline]] friend TriplePair operator*(const TriplePair& a, const Scalar& s)
  {
    return {a.linear * s, a.angular * s};
  }
  [[gnu::always_inline]] friend Scalar dot(const TriplePair& a, const TriplePair& b)
  {
    return sum(a.linear * b.linear + a.angular * b.angular);
  }
  [[gnu::always_inline]] void put(Scalar* x) const
  {
    linear.put(x);
    angular.put(x + 3);
  }
  [[gnu::always_inline]] decltype(auto) operator()(int i) const { return i < 3 ? linear(i) : angular(i - 3); }
};

}  // namespace iim::detail
