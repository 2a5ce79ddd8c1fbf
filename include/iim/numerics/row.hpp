// A few numbers in a row, with which one step of a loop computes.
#pragma once

#include <algorithm>
#include <cstring>

#include <Eigen/Core>

namespace iim::detail {

/// Of a vector register of this processor.
#if defined(__AVX512F__)
inline constexpr int register_bytes = 64;
#elif defined(__AVX__)
inline constexpr int register_bytes = 32;
#else
inline constexpr int register_bytes = 16;
#endif

/// How many numbers a vector register holds; of those that it could, eight at most. One for other Scalars.
template <class Scalar>
inline constexpr int register_lanes = 1;
template <>
inline constexpr int register_lanes<double> = std::clamp<int>(EIGEN_MAX_STATIC_ALIGN_BYTES / sizeof(double), 1, 8);
template <>
inline constexpr int register_lanes<float> = std::clamp<int>(EIGEN_MAX_STATIC_ALIGN_BYTES / sizeof(float), 1, 8);

/// A vector register as g++ and clang know it.
template <class T, int N>
struct VectorOf {
  using Type [[gnu::vector_size(sizeof(T) * N)]] = T;
};

/// What holds N numbers: for N = 1 one of whatever type.
template <class T, int N>
struct PartOf : VectorOf<T, N> {};
template <class T>
struct PartOf<T, 1> {
  using Type = T;
};

/// Keeps numbers in a register from here on: the compiler no longer knows that they stand in memory, too.
template <class Vector>
[[gnu::always_inline]] inline void hold_register([[maybe_unused]] Vector& v)
{
#if defined(__SSE2__)
  if constexpr (sizeof(Vector) <= register_bytes) { __asm__("" : "+v"(v)); }  // Eigen may have been told of wider ones
#endif
}

template <class Scalar, int n>
class Row;

/// What a Row consists of: a register, or two rows of half its length.
template <class Scalar, int n, bool fits>
struct ContentOf : PartOf<Scalar, n> {};
template <class Scalar, int n>
struct ContentOf<Scalar, n, false> {
  struct Type {
    Row<Scalar, n / 2> lower, upper;
  };
};

/// n numbers, a power of two; operations number by number. What Eigen::Array is, too, but its layers are compiled for
/// each expression (a thousand functions of a controller, some 5 % of its compile time), and of registers compilers do
/// not inline them (2× for B̂ of several states). Halves instead of a loop over registers: little optimised (-Og), g++
/// writes such a loop out eight times in each place (five times the code of a sweep).
template <class Scalar, int n>
class Row {
  static_assert(n > 0 && (n & (n - 1)) == 0, "a row is of 1, 2, 4, 8 … numbers");
  static constexpr bool fits = n <= register_lanes<Scalar>;
  using Content = typename ContentOf<Scalar, n, fits>::Type;

public:
  static constexpr int size = n;

  [[gnu::always_inline]] static Row Zero()
  {
    Row row;
    row.setZero();
    return row;
  }
  [[gnu::always_inline]] void setZero()
  {
    if constexpr (n == 1) {
      content_ = Scalar(0);  // Scalar() need not be 0: AutoDiffScalar leaves itself as it is
    } else if constexpr (fits) {
      content_ = Content{};
    } else {
      content_.lower.setZero();
      content_.upper.setZero();
    }
  }
  [[gnu::always_inline]] static Row load(const Scalar* from)
  {
    Row row;
    if constexpr (!fits) {
      row.content_.lower = Row<Scalar, n / 2>::load(from);
      row.content_.upper = Row<Scalar, n / 2>::load(from + n / 2);
    } else if constexpr (n > 1) {
      std::memcpy(&row.content_, from, sizeof(Content));
    } else {
      row.content_ = *from;
    }
    return row;
  }
  [[gnu::always_inline]] void store(Scalar* to) const
  {
    if constexpr (!fits) {
      content_.lower.store(to);
      content_.upper.store(to + n / 2);
    } else if constexpr (n > 1) {
      std::memcpy(to, &content_, sizeof(Content));
    } else {
      *to = content_;
    }
  }
  /// Tuned for some processors, g++ reads what several operations use again for each of them.
  [[gnu::always_inline]] void hold()
  {
    if constexpr (!fits) {
      content_.lower.hold();
      content_.upper.hold();
    } else if constexpr (n > 1) {
      hold_register(content_);
    }
  }
  Scalar* data() { return reinterpret_cast<Scalar*>(&content_); }
  const Scalar* data() const { return reinterpret_cast<const Scalar*>(&content_); }
  Scalar& operator()(Eigen::Index k) { return data()[k]; }
  const Scalar& operator()(Eigen::Index k) const { return data()[k]; }

  // clang contracts over function boundaries only where it is told to.
#ifdef __clang__
#define IIM_CONTRACT _Pragma("clang fp contract(fast)")
#else
#define IIM_CONTRACT
#endif
  [[gnu::always_inline]] friend inline Row operator+(const Row& a, const Row& b)
  {
    IIM_CONTRACT
    Row row;
    if constexpr (fits) {
      row.content_ = a.content_ + b.content_;
    } else {
      row.content_.lower = a.content_.lower + b.content_.lower;
      row.content_.upper = a.content_.upper + b.content_.upper;
    }
    return row;
  }
  [[gnu::always_inline]] friend inline Row operator-(const Row& a, const Row& b)
  {
    IIM_CONTRACT
    Row row;
    if constexpr (fits) {
      row.content_ = a.content_ - b.content_;
    } else {
      row.content_.lower = a.content_.lower - b.content_.lower;
      row.content_.upper = a.content_.upper - b.content_.upper;
    }
    return row;
  }
  [[gnu::always_inline]] friend inline Row operator*(const Row& a, const Scalar& b)
  {
    IIM_CONTRACT
    Row row;
    if constexpr (fits) {
      row.content_ = a.content_ * b;
    } else {
      row.content_.lower = a.content_.lower * b;
      row.content_.upper = a.content_.upper * b;
    }
    return row;
  }
#undef IIM_CONTRACT
  [[gnu::always_inline]] friend inline Row operator*(const Scalar& b, const Row& a) { return a * b; }
  [[gnu::always_inline]] friend inline Row operator-(const Row& a) { return a * Scalar(-1); }
  [[gnu::always_inline]] Row& operator+=(const Row& b) { return *this = *this + b; }
  [[gnu::always_inline]] Row& operator-=(const Row& b) { return *this = *this - b; }

private:
  Content content_;
};

}  // namespace iim::detail
