// Which bodies are far heavier than what carries them: unit_rows.hpp.
#pragma once

#include <iim/body.hpp>
#include <iim/numerics/array.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/tree_data.hpp>

#include <cstddef>
#include <utility>

namespace iim::detail {

/// Frames of a tree whose body has 256 times the mass, or moment of inertia, of a body further inward: what a force on
/// less loses is a few ε (4 for a load of 256 kg on links of 1 kg).
template <class Scalar>
class HeavyFrames {
public:
  HeavyFrames() = default;  ///< none
  [[gnu::cold]] explicit HeavyFrames(const TreeData<Scalar>& tree)
  {
    const auto of = [](const FrameMass<Scalar>& body) { return Size{body.mass, sum_of_moments(body.inertia)}; };
    Array<Size> body;  // on a frame, with what inlets carry there
    for (Index f = 0; f < tree.n_frames(); ++f) { body.push_back(of(tree.frame_mass(f))); }
    for (const Node& node : tree.nodes()) {
      if (node.inlet < 0) { continue; }
      const Size inlet = of(tree.inlet_mass(node.index));
      body[at(node.inlet)].mass += inlet.mass;
      body[at(node.inlet)].moment += inlet.moment;
    }
    Array<Size> lightest(at(tree.size()));  // of those inward of a subsystem
    Array<char> frame(body.size(), 0), subsystem(lightest.size(), 0);
    bool any = false;
    for (const Node& node : tree.nodes()) {
      if (node.inlet < 0) { continue; }
      Size& light = lightest[at(node.index)];
      light = {smaller(lightest[at(node.parent)].mass, body[at(node.inlet)].mass),
               smaller(lightest[at(node.parent)].moment, body[at(node.inlet)].moment)};
      for (Index f = node.frame; f < tree.end_of_frames(node.index); ++f) {
        const FrameMass<Scalar>& own = tree.frame_mass(f);
        if (!outweighs(own.mass, light.mass) && !outweighs(sum_of_moments(own.central_inertia), light.moment)) {
          continue;
        }
        any = true;
        frame[at(f)] = 1;
        for (Index i = node.index; i >= 0 && subsystem[at(i)] == 0; i = tree.node(i).parent) { subsystem[at(i)] = 1; }
      }
    }
    if (any) {
      frame_ = std::move(frame);
      subsystem_ = std::move(subsystem);
    }
  }

  bool any() const { return !frame_.empty(); }
  bool is_heavy(Index f) const { return any() && frame_[at(f)] != 0; }
  /// Whether subsystem i has such a frame, or one lies beyond it.
  bool carries(Index i) const { return any() && subsystem_[at(i)] != 0; }

private:
  struct Size {
    Scalar mass = Scalar(0), moment = Scalar(0);  ///< 0: none
  };

  static std::size_t at(Index k) { return static_cast<std::size_t>(k); }
  static bool is_positive(const Scalar& x) { return ScalarTraits<Scalar>::is_positive(x); }
  static bool outweighs(const Scalar& a, const Scalar& b) { return is_positive(b) && is_positive(a / Scalar(256) - b); }
  static Scalar smaller(const Scalar& a, const Scalar& b)
  {
    return is_positive(a) && (!is_positive(b) || is_positive(b - a)) ? a : b;
  }

  Array<char> frame_, subsystem_;  // empty if there are none
};

}  // namespace iim::detail
