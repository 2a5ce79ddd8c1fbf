// Where the inertias that frames carry are, of several states at once. Each is needed from when the first child hands
// something on until the frame's own step, and afterwards by small pivots further inward alone. Numbers of several
// states at once do not stay in the nearest memory, and what is written beside it is what they wait for; so frames take
// the places of those whose steps are done (a chain has two). Pass of several bipeds 9 % less, of chains 5 to 8 %.
#pragma once

#include <iim/node_state.hpp>
#include <iim/numerics/array.hpp>
#include <iim/tree_data.hpp>

#include <cstddef>

namespace iim::detail {

/// Gives each frame of the tree, but those that keep theirs, a place that no other needs from when the first of its
/// children hands something on until its own subsystem has, on the way inward: what is in use stays in the nearest
/// memory, and a chain of any length has two. next(): one more place. vacant: room, for which nothing is allocated
/// where it is that of all frames.
template <class Scalar, class Next>
[[gnu::cold]] void share_places(const TreeData<Scalar>& tree, const Array<char>& keeps, Array<std::size_t>& place,
                                Array<std::size_t>& vacant, Next&& next)
{
  constexpr std::size_t none = static_cast<std::size_t>(-1);
  const auto shares = [&](Index f) { return !keeps[static_cast<std::size_t>(f)]; };
  const auto place_of = [&](Index f) -> std::size_t& { return place[static_cast<std::size_t>(f)]; };
  vacant.clear();
  for (Index f = 0; f < tree.n_frames(); ++f) {
    if (shares(f)) { place_of(f) = none; }
  }
  const auto occupy = [&](Index f) {
    if (!shares(f) || place_of(f) != none) { return; }
    if (vacant.empty()) { vacant.push_back(next()); }
    place_of(f) = vacant.back();
    vacant.pop_back();
  };
  for (auto node = tree.nodes().rbegin(); node != tree.nodes().rend(); ++node) {
    const Index end = tree.end_of_frames(node->index);
    for (Index f = node->frame; f < end; ++f) { occupy(f); }
    if (node->inlet >= 0) { occupy(node->inlet); }
    for (Index f = node->frame; f < end; ++f) {
      if (shares(f)) { vacant.push_back(place_of(f)); }
    }
  }
}

/// Of all frames of a workspace.
template <class Scalar>
class SharedPlaces {
  using Frames = Array<FrameState<Scalar>>;

public:
  /// Frames beyond those of the tree, and all where `all`, keep places of their own.
  [[gnu::cold]] void allocate(const TreeData<Scalar>& tree, bool all, Frames& frames)
  {
    inertias_.resize(frames.size());
    for (FrameInertia<Scalar>& inertia : inertias_) {
      inertia.h.setZero();
      inertia.A.set_zero();
    }
    place_.resize(frames.size());
    vacant_.reserve(frames.size());
    keeps_always_.resize(frames.size(), false);
    for (std::size_t f = 0; f < frames.size(); ++f) {
      keeps_always_[f] = all || static_cast<Index>(f) >= tree.n_frames();
    }
    keeps_ = keeps_always_;
    distribute(tree, frames);
  }

  /// After frames or places are copied.
  void put(Frames& frames)
  {
    for (std::size_t f = 0; f < frames.size(); ++f) { frames[f].place = &inertias_[place_[f]]; }
  }

  /// Before the loops of a pass. What no pass has needed for a while is shared again.
  void begin(const TreeData<Scalar>& tree, Frames& frames)
  {
    lacks_ = false;
    if (!shares_less_ || ++unneeded_ < patience) { return; }
    keeps_ = keeps_always_;
    shares_less_ = false;
    distribute(tree, frames);
  }

  /// For what comes to a frame before the loop inward.
  void keep(Index frame, const TreeData<Scalar>& tree, Frames& frames)
  {
    unneeded_ = 0;
    if (has_[at(frame)]) { return; }
    keeps_[at(frame)] = shares_less_ = true;
    distribute(tree, frames);
  }

  /// Whether the inertia of a frame is there after its own step. If not, the pass lacks it.
  bool has(Index frame)
  {
    unneeded_ = 0;
    if (has_[at(frame)]) { return true; }
    keeps_[at(frame)] = lacks_ = true;
    return false;
  }

  /// After the loop inward: whether it has to be done again, with places of their own for what was lacking.
  bool mends_lack(const TreeData<Scalar>& tree, Frames& frames)
  {
    if (!lacks_) { return false; }
    lacks_ = false;
    shares_less_ = true;
    distribute(tree, frames);
    return true;
  }

private:
  static constexpr int patience = 64;  ///< passes

  /// Shared are the places of frames that keep none.
  [[gnu::cold]] void distribute(const TreeData<Scalar>& tree, Frames& frames)
  {
    has_ = keeps_;
    for (std::size_t f = 0; f < place_.size(); ++f) { place_[f] = f; }
    std::size_t next = 0;
    share_places(tree, keeps_, place_, vacant_, [&] {
      while (keeps_[next]) { ++next; }
      return next++;
    });
    put(frames);
  }

  Array<FrameInertia<Scalar>> inertias_;
  Array<std::size_t> place_, vacant_;       // of frames; those that no frame is in, while they are given
  Array<char> has_, keeps_, keeps_always_;  // whether a frame has a place of its own; from the next loop on; always
  bool shares_less_ = false;                // than at first
  bool lacks_ = false;
  int unneeded_ = 0;  // passes since that was needed
};

}  // namespace iim::detail
