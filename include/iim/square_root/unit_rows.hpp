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
#include <optional>

namespace iim::detail {

/// A load of 1 on velocity d of a subsystem with one frame as a wrench w on that, S_e·w = 1 for e = d and 0 for others,
/// and −w on its inlet. Of a joint with rotors or springs, w is what they leave of it to the bodies, S·w = S·A S/M̄_R
/// (RowTape::of_bodies), and what acts between rotors and inlet is subtracted there: in these proportions bodies and
/// rotors move alike, and nothing has to cancel. (w for a load of 1 through Q with the rotors: of a motor of 10⁻² kg
/// m², gear 100, on a base a tenth of the limb's mass that carries it by a ball, the column 10⁴ ε; with this 30.)
template <class Scalar>
struct OpposedWrenches {
  Index frame, inlet;
  Vector6<Scalar> on_frame, on_inlet;  ///< at their coupling points
  bool is_shared = false;              ///< with rotors, if the rows of the frame's body carry w
};

/// Orthonormal columns.
template <class Scalar>
class OrthonormalTwists {
public:
  /// Nothing where no more than `least` of x² is left beside those that there are.
  void add(const Vector6<Scalar>& x, const Scalar& least)
  {
    using std::sqrt;
    if (count_ == 6) { return; }
    const Vector6<Scalar> rest = beyond(beyond(x));
    const Scalar size = rest.squaredNorm();
    if (!ScalarTraits<Scalar>::is_positive(size - least * x.squaredNorm())) { return; }
    column_[static_cast<std::size_t>(count_++)] = rest * Scalar(Scalar(1) / Scalar(sqrt(size)));
  }
  Vector6<Scalar> beyond(Vector6<Scalar> x) const
  {
    for (int k = 0; k < count_; ++k) {
      const Vector6<Scalar>& q = column_[static_cast<std::size_t>(k)];
      x -= q * Scalar(q.dot(x));
    }
    return x;
  }

private:
  std::array<Vector6<Scalar>, 6> column_;
  int count_ = 0;
};

/// How the body on a frame moves without inertia if it is a rod, of five rows, at its coupling point; zero if it is
/// not.
template <class Workspace>
[[gnu::cold]] Vector6<typename Workspace::Scalar> idle_motion(Index frame, const Workspace& ws)
{
  using Scalar = typename Workspace::Scalar;
  const auto& own = ws.root(frame).own;
  Vector6<Scalar> most = Vector6<Scalar>::Zero();
  if (ws.frame_body(frame).rows != 5) { return most; }
  OrthonormalTwists<Scalar> rows;
  for (int k = 0; k < 5; ++k) {
    Vector6<Scalar> row;
    for (int i = 0; i < 6; ++i) { row(i) = own.at(i, k); }
    rows.add(row, Scalar(0));
  }
  for (int i = 0; i < 6; ++i) {
    const Vector6<Scalar> rest = rows.beyond(rows.beyond(Vector6<Scalar>::Unit(i)));
    if (ScalarTraits<Scalar>::is_positive(rest.squaredNorm() - most.squaredNorm())) { most = rest; }
  }
  return most;
}

/// From w, w·unit for a load of 1, to what rotors leave of it to the bodies: whether there are any, and rows carry what
/// is left. What the joint holds, k with k·S = 0, is added so that an inlet that is a rod does not have to carry the
/// rotors' moment along what it does without inertia.
template <class Workspace>
[[gnu::cold]] bool leave_to_bodies(const Node& node, const Vector6<typename Workspace::Scalar>& S,
                                   const Vector3<typename Workspace::Scalar>& r, const typename Workspace::Scalar& unit,
                                   const Workspace& ws, Vector6<typename Workspace::Scalar>& w)
{
  using Scalar = typename Workspace::Scalar;
  const RowTape<Scalar>& tape = ws.tape(node.index);
  if (tape.of_bodies == Scalar(1) || !ScalarTraits<Scalar>::is_positive(tape.of_bodies)) { return false; }
  Vector6<Scalar> k = Vector6<Scalar>::Zero();
  const Vector6<Scalar> on_inlet = idle_motion(node.inlet, ws), still = shift_twist(r, on_inlet);
  const Scalar turned = tape.of_rotors.dot(on_inlet.template tail<3>());
  if (!(turned == Scalar(0))) {
    OrthonormalTwists<Scalar> held;
    held.add(S, Scalar(0));
    held.add(idle_motion(node.frame, ws), Scalar(1e-6));
    k = held.beyond(held.beyond(still));
    const Scalar size = k.dot(still);
    if (!ScalarTraits<Scalar>::is_positive(size - Scalar(1e-3) * still.squaredNorm())) { return false; }
    k = k * Scalar(turned / size);
  }
  w = w * Scalar(unit * tape.of_bodies) - k;
  return true;
}

/// The load of W on the inlet, W S = 1, is a difference of what acts on the bodies beyond. Where light ones further
/// inward move freely along it (HeavyFrames::is_between), these two go through Q instead, as wrenches of inputs do. (A
/// base of 10⁻⁶ of the limb that hangs on it by a universal joint: the column of the next motor 10⁷ ε without this.)
/// None where the frame does not move along velocity d apart from the others, as for that of a rotor within.
/// S: columns, one after the other. r: from the inlet's coupling point to its own.
template <class Workspace>
[[gnu::cold]] std::optional<OpposedWrenches<typename Workspace::Scalar>> opposed_wrenches(
    const Node& node, const typename Workspace::Scalar* S, int n_i, int d, const Vector3<typename Workspace::Scalar>& r,
    const Workspace& ws)
{
  using Scalar = typename Workspace::Scalar;
  const auto column = [S](int e) -> Vector6<Scalar> { return Eigen::Map<const Vector6<Scalar>>(S + 6 * e); };
  OpposedWrenches<Scalar> wrenches{node.frame, node.inlet, column(d), {}, false};
  Vector6<Scalar>& w = wrenches.on_frame;
  OrthonormalTwists<Scalar> others;
  for (int e = 0; e < n_i; ++e) {
    if (e != d) { others.add(column(e), Scalar(0)); }
  }
  w = others.beyond(others.beyond(w));
  const Scalar apart = w.squaredNorm() - Scalar(1e-6) * column(d).squaredNorm();
  if (!ScalarTraits<Scalar>::is_positive(apart)) { return std::nullopt; }
  // Nor along what a rod does without inertia: its rows carry the wrench then. But not at any price.
  for (const Index frame : {node.frame, node.inlet}) {
    const Vector6<Scalar> still = idle_motion(frame, ws);
    others.add(frame == node.frame ? still : shift_twist(r, still), Scalar(1e-6));
  }
  const Vector6<Scalar> carried = others.beyond(w);
  const Scalar left = carried.squaredNorm() - Scalar(1e-3) * w.squaredNorm();
  if (ScalarTraits<Scalar>::is_positive(left)) { w = carried; }
  const Scalar unit = Scalar(1) / w.dot(column(d));
  if (n_i == 1 && ScalarTraits<Scalar>::is_positive(left)) {
    wrenches.is_shared = leave_to_bodies(node, column(0), r, unit, ws, w);
  }
  if (!wrenches.is_shared) { w = w * unit; }
  wrenches.on_inlet = -shift_wrench(r, w);
  if (wrenches.is_shared) { wrenches.on_inlet.template tail<3>() -= ws.tape(node.index).of_rotors; }
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
  /// pass. shared: the wrenches are what the rotors of the frame's own joint leave of a load on it (OpposedWrenches).
  template <class Workspace>
  void carry_inward(const Workspace& ws, Index frame, bool shared)
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
      const bool follow = shared && own == 1 && !(tape.of_bodies == Scalar(1));  // rotors have their part of the load
      if (follow) { z_1_[static_cast<std::size_t>(node.path_v)] *= Scalar(1) / tape.of_bodies; }
      shared = false;
      const Arrival& arrival = tape.arrival;
      if (arrival.count < 0) { return; }
      std::copy_n(&at(arrival.from), arrival.count, spare_.begin());
      std::copy_n(&at(arrival.within_from), arrival.within, spare_.begin() + arrival.count);
      if (follow) {
        std::fill_n(spare_.begin() + arrival.count, arrival.within, RootRow<Scalar>(RootRow<Scalar>::Zero()));
      }
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
