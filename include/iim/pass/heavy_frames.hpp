// Which bodies are far heavier than what carries them, and which joints lie between two such: unit_rows.hpp.
#pragma once

#include <iim/body.hpp>
#include <iim/numerics/array.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/tree_data.hpp>

#include <algorithm>
#include <cstddef>
#include <utility>

namespace iim::detail {

/// Frames of a tree whose body has 256 times the mass, or moment of inertia, of a body further inward: what a force on
/// less loses is a few ε (4 for a load of 256 kg on links of 1 kg). Beyond a joint of several velocities that hangs on
/// what such a joint, or a free frame, carries, those that with all beyond them have 8 times what the latter has: it
/// moves almost freely, and what its lightness makes of roundings is lost (6000 ε for a base of 10⁻³).
template <class Scalar>
class HeavyFrames {
public:
  HeavyFrames() = default;  ///< none
  [[gnu::cold]] explicit HeavyFrames(const TreeData<Scalar>& tree)
  {
    const auto of = [](const FrameMass<Scalar>& body) { return Size{body.mass, sum_of_moments(body.inertia)}; };
    Array<Size> body;  // on a frame, with what inlets carry there
    body.reserve(at(tree.n_frames()));
    for (Index f = 0; f < tree.n_frames(); ++f) { body.push_back(of(tree.frame_mass(f))); }
    for (const Node& node : tree.nodes()) {
      if (node.inlet < 0) { continue; }
      const Size inlet = of(tree.inlet_mass(node.index));
      body[at(node.inlet)].add(inlet);
    }
    const auto is_loose = [&](const Node& node) {
      return node.parent >= 0 && tree.velocities(node.index) > 1 && tree.velocities(node.parent) > 1;
    };
    const bool any_loose = std::any_of(tree.nodes().begin(), tree.nodes().end(), is_loose);
    Array<Size> beyond(any_loose ? at(tree.size()) : 0);  // of a subsystem and all that it carries
    for (Index i = tree.size(); any_loose && i-- > 0;) {
      for (Index f = tree.node(i).frame; f < tree.end_of_frames(i); ++f) { beyond[at(i)].add(central(tree, f)); }
      if (tree.node(i).parent >= 0) { beyond[at(tree.node(i).parent)].add(beyond[at(i)]); }
    }
    Array<Size> lightest(at(tree.size()));  // of those inward of a subsystem
    Array<Size> loose(beyond.size());       // of those that can move along a joint of several velocities
    Array<char> frame(body.size(), 0), subsystem(lightest.size(), 0);
    bool any = false;
    for (const Node& node : tree.nodes()) {
      if (node.inlet < 0) { continue; }
      Size& light = lightest[at(node.index)];
      light = smaller(lightest[at(node.parent)], body[at(node.inlet)]);
      if (any_loose) {
        loose[at(node.index)] = loose[at(node.parent)];
        if (is_loose(node)) { loose[at(node.index)] = smaller(loose[at(node.parent)], body[at(node.inlet)]); }
      }
      for (Index f = node.frame; f < tree.end_of_frames(node.index); ++f) {
        const bool is_heavy = outweighs(central(tree, f), light, 256),
                   moves_loose = any_loose && outweighs(beyond[at(node.index)], loose[at(node.index)], 8);
        if (!is_heavy && !moves_loose) { continue; }
        any = true;
        frame[at(f)] = 1;
        for (Index i = node.index; i >= 0 && subsystem[at(i)] == 0; i = tree.node(i).parent) { subsystem[at(i)] = 1; }
      }
    }
    if (any) {
      for (const Node& node : tree.nodes()) {
        between_.push_back(any_loose && is_between(node, frame, loose[at(node.index)], tree) ? 1 : 0);
      }
      frame_ = std::move(frame);
      subsystem_ = std::move(subsystem);
    }
  }

  bool any() const { return !frame_.empty(); }
  bool is_heavy(Index f) const { return any() && frame_[at(f)] != 0; }
  /// Whether subsystem i has such a frame, or one lies beyond it.
  bool carries(Index i) const { return any() && subsystem_[at(i)] != 0; }

  /// Whether a load on subsystem i, of one frame, acts between two such frames beyond such a joint: the load of W that
  /// reaches this acts along none of its velocities, but by roundings.
  bool is_between(Index i) const { return any() && between_[at(i)] != 0; }

private:
  struct Size {
    Scalar mass = Scalar(0), moment = Scalar(0);  ///< 0: none
    void add(const Size& other)
    {
      mass += other.mass;
      moment += other.moment;
    }
  };
  static Size central(const TreeData<Scalar>& tree, Index f)
  {
    return {tree.frame_mass(f).mass, sum_of_moments(tree.frame_mass(f).central_inertia)};
  }

  static bool is_positive(const Scalar& x) { return ScalarTraits<Scalar>::is_positive(x); }
  static bool outweighs(const Size& a, const Size& b, int times)
  {
    const auto more = [&](const Scalar& x, const Scalar& y) {
      return is_positive(y) && is_positive(x / Scalar(times) - y);
    };
    return more(a.mass, b.mass) || more(a.moment, b.moment);
  }
  static Size smaller(const Size& a, const Size& b) { return {smaller(a.mass, b.mass), smaller(a.moment, b.moment)}; }
  static Scalar smaller(const Scalar& a, const Scalar& b)
  {
    return is_positive(a) && (!is_positive(b) || is_positive(b - a)) ? a : b;
  }

  [[gnu::cold]] static bool is_between(const Node& node, const Array<char>& heavy, const Size& loose,
                                       const TreeData<Scalar>& tree)
  {
    const bool one_frame = tree.end_of_frames(node.index) == node.frame + 1;
    if (node.inlet < 0 || tree.velocities(node.index) == 0 || !one_frame) { return false; }
    return heavy[at(node.frame)] != 0 && heavy[at(node.inlet)] != 0 &&
           (is_positive(loose.mass) || is_positive(loose.moment));
  }

  Array<char> frame_, subsystem_, between_;  // empty if there are none
};

}  // namespace iim::detail
