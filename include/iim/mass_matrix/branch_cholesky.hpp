// M = LᵀL for a matrix with the branch sparsity of a tree, and triangular solves, in path positions.
//
// Eliminating from the tips to the world makes L as sparse as M is (Featherstone 2005, "Efficient factorization of the
// joint-space inertia matrix for branched kinematic trees"): row v of L is non-zero only on v's path.
//
//     l_vv² = M_vv − Σ l_tv²,   l_va = (M_va − Σ l_tv l_ta) / l_vv     sums over the velocities t beyond v
//     M x = b:   y_v = (b_v − Σ l_tv y_t) / l_vv  inward,   x_v = (y_v − Σ_a l_va x_a) / l_vv  outward
//
// Limb by limb, a few rows at a time: rows of one limb are contiguous and every path is a few limbs, so all inner loops
// are dense. A tree that is one limb makes it a dense Cholesky factorisation.
#pragma once

#include <iim/inversion/branches.hpp>
#include <iim/numerics/array.hpp>
#include <iim/spatial.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace iim::detail {

/// One factorisation at a time. Construction allocates; nothing after it does.
template <class Scalar>
class BranchCholesky {
public:
  static constexpr int lanes = lane_count<Scalar>;

  explicit BranchCholesky(const Limbs& limbs)
      : limbs_(limbs), stride_(padded<Scalar>(limbs.depth())), inverse_(limbs.n_v()),
        end_(static_cast<std::size_t>(limbs.size()), 0)
  {
  }

  const Limbs& limbs() const { return limbs_; }

  /// Replaces M by L. Column v of `M` is row v by path position, padded to lanes; what stands behind position v is
  /// overwritten. Returns the velocity at which M turned out not to be positive definite, −1: none.
  ///
  /// A pivot below ε M_vv counts as zero: M_vv itself is not known better than that.
  Index factorise(MatrixX<Scalar>& M)
  {
    L_ = M.data();
    for (Index limb = limbs_.size() - 1; limb >= 0; --limb) {
      const Limb& own = limbs_[limb];
      for (Index end = own.end; end > own.begin; end -= panel) {
        const Index begin = std::max(own.begin, end - panel);
        for (Index a = end - 1; a >= begin; --a) {
          if (!finish_row(own, a, end)) { return own.v + (a - own.begin); }
        }
        limbs_.for_each_run(limb, 0, begin, [&](Index first, Index v, Index count) {
          Index k = 0;
          for (; k + tile <= count; k += tile) { update_rows<tile>(own, begin, end, first + k, v + k); }
          for (; k < count; ++k) { update_rows<1>(own, begin, end, first + k, v + k); }
        });
      }
    }
    return -1;
  }

  /// Before a solve: no right-hand side is known to have non-zeros.
  void begin_solve() { std::fill(end_.begin(), end_.end(), Index(0)); }

  /// A right-hand side has non-zeros on v's path, v included.
  void reach(Index v)
  {
    Index position = 0;
    for (Index limb = limbs_.limb_of_velocity(v); limb >= 0; limb = limbs_[limb].parent) {
      const Limb& own = limbs_[limb];
      position = position == 0 ? own.begin + (v - own.v) + 1 : own.end;
      Index& end = end_[static_cast<std::size_t>(limb)];
      if (end >= position) { return; }
      end = position;
    }
  }

  /// Solves for `width` right-hand sides, X(v, j) at X[v·width + j]. All of X must be zero but for the paths given to
  /// `reach`. Rows that no right-hand side moves stay zero.
  template <int width>
  void solve(Scalar* X)
  {
    for (Index limb = limbs_.size() - 1; limb >= 0; --limb) {
      const Limb& own = limbs_[limb];
      Index end = end_[static_cast<std::size_t>(limb)];
      for (; end - tile >= own.begin; end -= tile) { inward_rows<width, tile>(limb, end, X); }
      for (; end > own.begin; --end) { inward_rows<width, 1>(limb, end, X); }
    }
    for (Index limb = 0; limb < limbs_.size(); ++limb) {
      const Limb& own = limbs_[limb];
      // A limb moves with its parent, and is then a parent that moves.
      if (own.parent >= 0 && end_[static_cast<std::size_t>(own.parent)] > 0) {
        end_[static_cast<std::size_t>(limb)] = 1;
      }
      if (end_[static_cast<std::size_t>(limb)] == 0) { continue; }
      end_[static_cast<std::size_t>(limb)] = 1;
      Index begin = own.begin;
      for (; begin + tile <= own.end; begin += tile) { outward_rows<width, tile>(limb, begin, X); }
      for (; begin < own.end; ++begin) { outward_rows<width, 1>(limb, begin, X); }
    }
  }

private:
  static constexpr int panel = 8;  ///< rows that update their ancestors together
  static constexpr int tile = 4;   ///< rows that share one load of another row
  template <int width>
  using Columns = Eigen::Array<Scalar, width, 1>;

  Scalar* row(Index v) const { return L_ + v * stride_; }

  /// Row at path position a of a limb: what the rows behind it up to `end` subtract, then its own pivot.
  bool finish_row(const Limb& own, Index a, Index end)
  {
    using std::sqrt;
    Scalar* target = row(own.v + (a - own.begin));
    const Scalar* below = target + stride_;
    const Index count = end - 1 - a;
    Scalar pivot = target[a];
    const Scalar unit = Eigen::NumTraits<Scalar>::epsilon() * pivot;
    for (Index t = 0; t < count; ++t) { pivot -= below[t * stride_ + a] * below[t * stride_ + a]; }
    if (!ScalarTraits<Scalar>::is_positive(pivot - unit)) { return false; }
    const Scalar root = sqrt(pivot);
    const Scalar inverse = Scalar(1) / root;
    inverse_(own.v + (a - own.begin)) = inverse;
    for (Index c = 0; c < a; c += lanes) {
      Strip<Scalar> sum = load(target + c);
      for (Index t = 0; t < count; ++t) { sum -= load(below + t * stride_ + c) * below[t * stride_ + a]; }
      const Strip<Scalar> scaled = sum * inverse;
      store(target + c, scaled);
    }
    target[a] = root;
    return true;
  }

  /// `count` ancestor rows, the first at path position a: less the products with the panel's rows begin … end.
  template <int count>
  void update_rows(const Limb& own, Index begin, Index end, Index a, Index v)
  {
    const Scalar* below = row(own.v + (begin - own.begin));
    const Index rows = end - begin;
    Scalar* target = row(v);
    for (Index c = 0; c < a + count; c += lanes) {
      std::array<Strip<Scalar>, count> sum;
      for (int i = 0; i < count; ++i) { sum[at(i)] = load(target + i * stride_ + c); }
      const Scalar* l = below;
      for (Index t = 0; t < rows; ++t, l += stride_) {
        const Strip<Scalar> other = load(l + c);
        for (int i = 0; i < count; ++i) { sum[at(i)] -= other * l[a + i]; }
      }
      for (int i = 0; i < count; ++i) { store(target + i * stride_ + c, sum[at(i)]); }
    }
  }

  /// y in the `count` rows before path position `end`, and what they subtract from all rows before them.
  template <int width, int count>
  void inward_rows(Index limb, Index end, Scalar* X)
  {
    using Map = Eigen::Map<Columns<width>>;
    const Limb& own = limbs_[limb];
    const Index begin = end - count;
    const Index v = own.v + (begin - own.begin);
    std::array<Columns<width>, count> y;
    std::array<const Scalar*, count> l;
    for (int i = count - 1; i >= 0; --i) {
      l[at(i)] = row(v + i);
      y[at(i)] = Map(X + (v + i) * width);
      for (int t = i + 1; t < count; ++t) { y[at(i)] -= y[at(t)] * l[at(t)][begin + i]; }
      y[at(i)] *= inverse_(v + i);
      Map(X + (v + i) * width) = y[at(i)];
    }
    limbs_.for_each_run(limb, 0, begin, [&](Index a, Index first, Index run) {
      for (Index k = 0; k < run; ++k) {
        Columns<width> b = Map(X + (first + k) * width);
        for (int i = 0; i < count; ++i) { b -= y[at(i)] * l[at(i)][a + k]; }
        Map(X + (first + k) * width) = b;
      }
    });
  }

  /// x in `count` rows from path position `begin` on.
  template <int width, int count>
  void outward_rows(Index limb, Index begin, Scalar* X)
  {
    using Map = Eigen::Map<Columns<width>>;
    const Limb& own = limbs_[limb];
    const Index v = own.v + (begin - own.begin);
    std::array<Columns<width>, count> x;
    std::array<const Scalar*, count> l;
    for (int i = 0; i < count; ++i) {
      l[at(i)] = row(v + i);
      x[at(i)] = Map(X + (v + i) * width);
    }
    limbs_.for_each_run(limb, 0, begin, [&](Index a, Index first, Index run) {
      for (Index k = 0; k < run; ++k) {
        const Columns<width> known = Map(X + (first + k) * width);
        for (int i = 0; i < count; ++i) { x[at(i)] -= known * l[at(i)][a + k]; }
      }
    });
    for (int i = 0; i < count; ++i) {
      for (int t = 0; t < i; ++t) { x[at(i)] -= x[at(t)] * l[at(i)][begin + t]; }
      x[at(i)] *= inverse_(v + i);
      Map(X + (v + i) * width) = x[at(i)];
    }
  }

  Limbs limbs_;
  Index stride_;
  Scalar* L_ = nullptr;
  VectorX<Scalar> inverse_;  // 1 / l_vv
  Array<Index> end_;         // of a limb: path position behind its last non-zero right-hand side
};

}  // namespace iim::detail
