// A matrix for the reference: every operation gives a new matrix, no expression templates, nothing clever.
#pragma once

#include <Eigen/Core>

#include <cassert>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace iim::reference {

using Index = Eigen::Index;

/// Dense matrix; a vector has one column. Zero when made.
template <class T>
class Dense {
public:
  Dense() = default;
  Dense(Index rows, Index cols = 1) : rows_(rows), cols_(cols), at_(static_cast<std::size_t>(rows * cols), T(0)) {}

  /// A copy of any Eigen matrix.
  template <class Derived>
  Dense(const Eigen::MatrixBase<Derived>& m) : Dense(m.rows(), m.cols())
  {
    for (Index i = 0; i < rows_; ++i) {
      for (Index j = 0; j < cols_; ++j) { (*this)(i, j) = T(m.derived().coeff(i, j)); }
    }
  }

  static Dense identity(Index n)
  {
    Dense one(n, n);
    for (Index i = 0; i < n; ++i) { one(i, i) = T(1); }
    return one;
  }

  Index rows() const { return rows_; }
  Index cols() const { return cols_; }
  T& operator()(Index i, Index j = 0) { return at_[place(i, j)]; }
  const T& operator()(Index i, Index j = 0) const { return at_[place(i, j)]; }

  Dense block(Index i, Index j, Index rows, Index cols) const
  {
    Dense part(rows, cols);
    for (Index r = 0; r < rows; ++r) {
      for (Index c = 0; c < cols; ++c) { part(r, c) = (*this)(i + r, j + c); }
    }
    return part;
  }
  Dense rows(Index first, Index count) const { return block(first, 0, count, cols_); }
  Dense head(Index count) const { return rows(0, count); }
  Dense tail(Index count) const { return rows(rows_ - count, count); }

  void set(Index i, Index j, const Dense& part)
  {
    for (Index r = 0; r < part.rows(); ++r) {
      for (Index c = 0; c < part.cols(); ++c) { (*this)(i + r, j + c) = part(r, c); }
    }
  }

  Dense transpose() const
  {
    Dense t(cols_, rows_);
    for (Index i = 0; i < rows_; ++i) {
      for (Index j = 0; j < cols_; ++j) { t(j, i) = (*this)(i, j); }
    }
    return t;
  }

  Dense& operator+=(const Dense& b)
  {
    assert(rows_ == b.rows_ && cols_ == b.cols_);
    for (std::size_t k = 0; k < at_.size(); ++k) { at_[k] += b.at_[k]; }
    return *this;
  }
  Dense& operator*=(const T& s)
  {
    for (T& x : at_) { x *= s; }
    return *this;
  }
  Dense& operator-=(const Dense& b) { return *this += T(-1) * b; }
  friend Dense operator+(Dense a, const Dense& b) { return a += b; }
  friend Dense operator-(Dense a, const Dense& b) { return a -= b; }
  friend Dense operator*(const T& s, Dense a) { return a *= s; }
  friend Dense operator-(Dense a) { return a *= T(-1); }

  friend Dense operator*(const Dense& a, const Dense& b)
  {
    assert(a.cols_ == b.rows_);
    Dense product(a.rows_, b.cols_);
    for (Index i = 0; i < a.rows_; ++i) {
      for (Index k = 0; k < a.cols_; ++k) {
        if (a(i, k) == T(0)) { continue; }
        for (Index j = 0; j < b.cols_; ++j) { product(i, j) += a(i, k) * b(k, j); }
      }
    }
    return product;
  }

  T squared_norm() const
  {
    T sum(0);
    for (const T& x : at_) { sum += x * x; }
    return sum;
  }
  T norm() const
  {
    using std::sqrt;
    return sqrt(squared_norm());
  }

private:
  std::size_t place(Index i, Index j) const
  {
    assert(i >= 0 && i < rows_ && j >= 0 && j < cols_);
    return static_cast<std::size_t>(i * cols_ + j);
  }

  Index rows_ = 0;
  Index cols_ = 0;
  std::vector<T> at_;
};

template <class T>
T dot(const Dense<T>& a, const Dense<T>& b)
{
  return (a.transpose() * b)(0, 0);
}

/// a above b.
template <class T>
Dense<T> stacked(const Dense<T>& a, const Dense<T>& b)
{
  Dense<T> s(a.rows() + b.rows(), a.cols());
  s.set(0, 0, a);
  s.set(a.rows(), 0, b);
  return s;
}

/// a beside b.
template <class T>
Dense<T> beside(const Dense<T>& a, const Dense<T>& b)
{
  Dense<T> s(a.rows(), a.cols() + b.cols());
  s.set(0, 0, a);
  s.set(0, a.cols(), b);
  return s;
}

/// The paper's tilde: tilde(a) b = a × b.
template <class T>
Dense<T> tilde(const Dense<T>& a)
{
  Dense<T> m(3, 3);
  m(0, 1) = -a(2), m(0, 2) = a(1);
  m(1, 0) = a(2), m(1, 2) = -a(0);
  m(2, 0) = -a(1), m(2, 1) = a(0);
  return m;
}

/// A⁻¹B by Gaussian elimination with row pivots.
template <class T>
Dense<T> solve(Dense<T> A, Dense<T> B)
{
  using std::abs;
  const Index n = A.rows();
  for (Index k = 0; k < n; ++k) {
    Index pivot = k;
    for (Index i = k + 1; i < n; ++i) {
      if (abs(A(i, k)) > abs(A(pivot, k))) { pivot = i; }
    }
    for (Index j = 0; j < n; ++j) { std::swap(A(k, j), A(pivot, j)); }
    for (Index j = 0; j < B.cols(); ++j) { std::swap(B(k, j), B(pivot, j)); }
    for (Index i = 0; i < n; ++i) {
      if (i == k) { continue; }
      const T factor = A(i, k) / A(k, k);
      for (Index j = k; j < n; ++j) { A(i, j) -= factor * A(k, j); }
      for (Index j = 0; j < B.cols(); ++j) { B(i, j) -= factor * B(k, j); }
    }
  }
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < B.cols(); ++j) { B(i, j) /= A(i, i); }
  }
  return B;
}

template <class T>
Dense<T> inverse(const Dense<T>& A)
{
  return solve(A, Dense<T>::identity(A.rows()));
}

/// Smallest pivot of A = L D Lᵀ: positive exactly if A is positive definite.
template <class T>
T smallest_pivot(Dense<T> A)
{
  T smallest = A.rows() > 0 ? A(0, 0) : T(1);
  for (Index k = 0; k < A.rows(); ++k) {
    if (A(k, k) < smallest) { smallest = A(k, k); }
    for (Index i = k + 1; i < A.rows(); ++i) {
      const T factor = A(i, k) / A(k, k);
      for (Index j = k; j < A.rows(); ++j) { A(i, j) -= factor * A(k, j); }
    }
  }
  return smallest;
}

}  // namespace iim::reference
