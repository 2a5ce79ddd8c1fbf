// Unit forces on a body that is far heavier than what carries it, in square-root form.
//
// The columns of B̂ that a force on such a body has are small, and Hᵀ w or Sᵀ p would give them as small differences of
// what light bodies do. As z of the body's own rows, N_bᵀ z = w, the force goes through Q like any other z, whose part
// z₁ in the rows that a subsystem eliminates is its share of β (31), (50): q̈ = T⁻¹ z₁ − W y. For this Q is kept
// (row_tape.hpp) where something heavy lies outward, and done again on unit columns. A wrench on a load of 10⁶ kg at
// links of 1 kg: 2 ε, without this 2e4. The pass of an arm of seven takes 6 % longer with such a load, and the wrench 2
// µs.
#pragma once

#include <iim/numerics/array.hpp>
#include <iim/pass/heavy_frames.hpp>
#include <iim/square_root/root_rows.hpp>
#include <iim/square_root/row_tape.hpp>
#include <iim/square_root/square_root.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace iim::detail {

/// A load of 1 on velocity d of a subsystem with one frame as a wrench w on that, S_e·w = 1 for e = d and 0 for others,
/// and −w on its inlet.
template <class Scalar>
struct OpposedWrenches {
  Index frame, inlet;
  Vector6<Scalar> on_frame, on_inlet;  ///< at their coupling points
};
/// The load of W on the inlet, W S = 1, is a difference of what acts on the bodies beyond. Where light ones further
/// inward move freely along it (HeavyFrames::is_between), these two go through Q instead, as wrenches of inputs do. (A
/// base of 10⁻⁶ of the limb that hangs on it by a universal joint: the column of the next motor 10⁷ ε without this.)
/// S: columns, one after the other.
template <class Workspace>
[[gnu::cold]] OpposedWrenches<typename Workspace::Scalar> opposed_wrenches(const Node& node,
                                                                           const typename Workspace::Scalar* S, int n_i,
                                                                           int d, const Workspace& ws)
{
  using std::sqrt;
  using Scalar = typename Workspace::Scalar;
  const auto column = [S](int e) -> Vector6<Scalar> { return Eigen::Map<const Vector6<Scalar>>(S + 6 * e); };
  OpposedWrenches<Scalar> wrenches{node.frame, node.inlet, column(d), {}};
  Vector6<Scalar>& w = wrenches.on_frame;
  std::array<Vector6<Scalar>, 6> others;  // orthonormal
  int count = 0;
  for (int e = 0; e < n_i; ++e) {
    if (e == d) { continue; }
    Vector6<Scalar> other = column(e);
    for (int k = 0; k < count; ++k) {
      other -= others[static_cast<std::size_t>(k)] * others[static_cast<std::size_t>(k)].dot(other);
    }
    other = other * Scalar(Scalar(1) / Scalar(sqrt(other.squaredNorm())));
    w -= other * other.dot(w);
    others[static_cast<std::size_t>(count++)] = other;
  }
  w = w * Scalar(Scalar(1) / w.dot(column(d)));
  const FrameState<Scalar>& inlet = ws.frame(node.inlet);
  Vector3<Scalar> r = inlet.r;
  add(r, times(inlet.R, ws.tree().placement(node.index).p));
  wrenches.on_inlet = -shift_wrench(r, w);
  return wrenches;
}

/// Unit columns beside the rows of a body, one for each, and what Q makes of them from subsystem to subsystem.
template <class Scalar>
class UnitRows {
public:
  /// Allocates if a frame of the tree is heavy.
  [[gnu::cold]] explicit UnitRows(const TreeData<Scalar>& tree) : tree_(&tree)
  {
    if (!HeavyFrames<Scalar>(tree).any()) { return; }
    z_1_.resize(static_cast<std::size_t>(tree.max_path_v()));
    Index frames = 1;
    for (const Node& node : tree.nodes()) { frames = std::max(frames, tree.end_of_frames(node.index) - node.frame); }
    row_.resize(static_cast<std::size_t>((RootInertia<Scalar>::most + 6) * (frames + 2) +
                                         2 * RootInertia<Scalar>::most_within + 12));
    spare_ = row_;
  }

  bool are_needed() const { return !z_1_.empty(); }

  /// z₁ of the subsystems on the path to a heavy frame, for 1 in each of the rows of its body. The workspace holds the
  /// pass.
  template <class Workspace>
  void carry_inward(const Workspace& ws, Index frame)
  {
    const auto most = static_cast<Index>(row_.size());
    for (RootRow<Scalar>& n : z_1_) { n.setZero(); }  // those beyond a free frame stay so
    for (RootRow<Scalar>& n : row_) { n.setZero(); }
    for (int k = 0; k < ws.frame_body(frame).rows; ++k) { at(k)(k) = Scalar(1); }
    for (std::size_t position = 0; frame >= 0;) {
      const Node& node = tree_->node(tree_->owner(frame));
      const RowTape<Scalar>& on_frame = ws.frame_tape(frame);
      on_frame.replay(position, row_.data(), most, spare_.data());
      const Index own = tree_->velocities(node.index);
      const RowTape<Scalar>& tape = own > 0 ? ws.tape(node.index) : on_frame;
      if (own > 0) {
        tape.replay(0, row_.data(), most, spare_.data());
        std::copy_n(&at(tape.tops), own, z_1_.begin() + node.path_v);
      }
      const Arrival& arrival = tape.arrival;
      if (arrival.count < 0) { return; }
      std::copy_n(&at(arrival.from), arrival.count, spare_.begin());
      std::copy_n(&at(arrival.within_from), arrival.within, spare_.begin() + arrival.count);
      for (RootRow<Scalar>& n : row_) { n.setZero(); }
      std::copy_n(spare_.begin(), arrival.count, &at(arrival.to));
      for (Index k = 0; k < arrival.within; ++k) {
        at(k == 0 ? arrival.within_first : arrival.within_next + k - 1) =
            spare_[static_cast<std::size_t>(arrival.count + k)];
      }
      position = arrival.position;
      frame = node.inlet;
    }
  }

  /// z₁ at a path position under z in the rows of the body.
  Scalar share(Index position, const RootRow<Scalar>& z) const
  {
    return dot_of_six(z_1_[static_cast<std::size_t>(position)], z);
  }

private:
  RootRow<Scalar>& at(Index place) { return row_[static_cast<std::size_t>(place)]; }

  const TreeData<Scalar>* tree_;
  Array<RootRow<Scalar>> row_, spare_;
  Array<RootRow<Scalar>> z_1_;  // by path position
};

}  // namespace iim::detail
