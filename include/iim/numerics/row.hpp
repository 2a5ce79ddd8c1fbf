// A few numbers in a row, with which one step of a loop computes.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <type_traits>

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

/// n numbers, a power of two; operations number by number. What Eigen::Array is, too, but its layers are compiled for
/// each expression (a thousand functions of a controller, some 5 % of its compile time), and of registers compilers do
/// not inline them (2× for B̂ of several states).
template <class Scalar, int n>
class Row {
  static_assert(n > 0 && (n & (n - 1)) == 0, "a row is of 1, 2, 4, 8 … numbers");
  static constexpr int side = std::min(register_lanes<Scalar>, n);
  static constexpr int parts = n / side;
  using Part = typename PartOf<Scalar, side>::Type;

public:
  static constexpr int size = n;

  static Row Zero()
  {
    Row row;
    row.setZero();
    return row;
  }
  [[gnu::always_inline]] void setZero()
  {
#pragma GCC unroll 8
    for (std::size_t k = 0; k < parts; ++k) {
      if constexpr (side > 1) {
        part_[k] = Part{};
      } else {
        part_[k] = Scalar(0);
      }
    }
  }
  [[gnu::always_inline]] static Row load(const Scalar* from)
  {
    Row row;
#pragma GCC unroll 8
    for (std::size_t k = 0; k < parts; ++k) { get(from + k * side, row.part_[k]); }
    return row;
  }
  [[gnu::always_inline]] void store(Scalar* to) const
  {
#pragma GCC unroll 8
    for (std::size_t k = 0; k < parts; ++k) { put(part_[k], to + k * side); }
  }
  /// Tuned for some processors, g++ reads what several operations use again for each of them.
  [[gnu::always_inline]] void hold()
  {
    if constexpr (side > 1) {
#pragma GCC unroll 8
      for (std::size_t k = 0; k < parts; ++k) { hold_register(part_[k]); }
    }
  }
  Scalar* data() { return reinterpret_cast<Scalar*>(part_.data()); }
  const Scalar* data() const { return reinterpret_cast<const Scalar*>(part_.data()); }
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
#pragma GCC unroll 8
    for (std::size_t k = 0; k < parts; ++k) { row.part_[k] = a.part_[k] + b.part_[k]; }
    return row;
  }
  [[gnu::always_inline]] friend inline Row operator-(const Row& a, const Row& b)
  {
    IIM_CONTRACT
    Row row;
#pragma GCC unroll 8
    for (std::size_t k = 0; k < parts; ++k) { row.part_[k] = a.part_[k] - b.part_[k]; }
    return row;
  }
  [[gnu::always_inline]] friend inline Row operator*(const Row& a, const Scalar& b)
  {
    IIM_CONTRACT
    Row row;
#pragma GCC unroll 8
    for (std::size_t k = 0; k < parts; ++k) { row.part_[k] = a.part_[k] * b; }
    return row;
  }
#undef IIM_CONTRACT
  [[gnu::always_inline]] friend inline Row operator*(const Scalar& b, const Row& a) { return a * b; }
  [[gnu::always_inline]] friend inline Row operator-(const Row& a) { return a * Scalar(-1); }
  [[gnu::always_inline]] Row& operator+=(const Row& b) { return *this = *this + b; }
  [[gnu::always_inline]] Row& operator-=(const Row& b) { return *this = *this - b; }

private:
  [[gnu::always_inline]] static void get(const Scalar* from, Part& part)
  {
    if constexpr (side > 1) {
      std::memcpy(&part, from, sizeof(Part));
    } else {
      part = *from;
    }
  }
  [[gnu::always_inline]] static void put(const Part& part, Scalar* to)
  {
    if constexpr (side > 1) {
      std::memcpy(to, &part, sizeof(Part));
    } else {
      *to = part;
    }
  }

  std::array<Part, static_cast<std::size_t>(parts)> part_;
};

}  // namespace iim::detail
