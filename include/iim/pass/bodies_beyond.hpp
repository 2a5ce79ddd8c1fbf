// Sums over all that a subsystem carries, whatever its types: Gᵢⱼ = Σ_b aᵢᵀ I_b aⱼ + Σ_r J_r (g_r aᵢ)(g_r aⱼ) for
// accelerations a of a frame which the joints beyond it follow freely, q̈ = −W y.
//
// Body by body until A of a frame, all that this carries in one, is good enough for the sum: little of a motion that
// meets a small inertia gets far, and a subsystem's sum takes as long in a chain of any length. (Counting subsystems
// instead, 32 of them, B̂ of a limb under 10⁹ beside forty fingers had 2·10⁶ ε, if these were added first.)
//
// Of one acceleration (single_motion.hpp), or of up to eight side by side (several_motions.hpp). Types do not come into
// it: each subsystem has said once where its numbers are. (With a function of each type for any number of accelerations
// the pass of a biped without rotors took 133 ns a joint instead of 96.)
#pragma once

#include <iim/body.hpp>
#include <iim/numerics/array.hpp>
#include <iim/pass/joint_lines.hpp>
#include <iim/pass/motion_products.hpp>
#include <iim/pass/several_motions.hpp>
#include <iim/pass/single_motion.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/tree_data.hpp>
#include <iim/update.hpp>

#include <algorithm>
#include <cstddef>

namespace iim::detail {

/// Whether small pivots are mended by such sums (weak_pivot.hpp).
template <class Data>
inline constexpr bool mends = Data::update == Update::projected;
/// Whether those of several velocities, too (mended_root.hpp): of one state.
template <class Data>
inline constexpr bool mends_several = mends<Data> && !is_several<typename Data::Scalar>;

/// How many subsystems outward on a path (of unit_of: in the order of their numbers) count body by body at most.
inline constexpr Index most_one_by_one = 128;

/// Of all subsystems of a workspace, in which it has to be: what is copied or moved to still knows where they were.
template <class Scalar>
class BodiesBeyond {
public:
  /// Where the numbers of a subsystem are.
  struct Part {
    const Matrix3<Scalar>* R;
    const Vector3<Scalar>* r;
    const Scalar* S;               ///< of all frames, 6 × n_i each
    const Scalar* W;               ///< n_i × 6
    const Scalar* C;               ///< n_i × n_i
    const Scalar* qd;              ///< where there are rotors
    const OwnColumn<Scalar>* own;  ///< null: none
    int n_i, n_frames;
    bool is_free;     ///< stays where it is, whatever its inlet does
    bool has_within;  ///< rotors or springs
    std::size_t rotors_end, springs_end;

    bool is_single() const { return n_i == 1 && n_frames == 1; }
    /// Row d of W.
    [[gnu::always_inline]] TriplePair<Scalar> gain(int d) const
    {
      if (n_i == 1) [[likely]] { return TriplePair<Scalar>(W); }
      const Scalar* const w = W + d;
      return {{w[0], w[n_i], w[2 * n_i]}, {w[3 * n_i], w[4 * n_i], w[5 * n_i]}};
    }
    /// Column d of S of frame k.
    [[gnu::always_inline]] TriplePair<Scalar> column(int k, int d) const
    {
      return TriplePair<Scalar>::settled(S + 6 * (k * n_i + d));
    }
    [[gnu::always_inline]] Triple<Scalar> place() const { return Triple<Scalar>::settled(r->data()); }
  };
  struct RotorPart {
    int frame;  ///< that carries it; −1: the inlet
    Vector3<Scalar> axis;
    Scalar inertia;
    bool coupled;
    std::size_t ratio;
  };
  struct SpringPart {
    const Scalar* inertia;
    const Scalar* ratio;
  };
  /// The child of subsystem i that has the same line (joint_lines.hpp), if i's frame carries nothing else but bodies,
  /// and nothing turns within either.
  struct Coaxial {
    Index child = -1;  ///< −1: none
    Sense sense = Sense::none;

    /// What the child's load, of all of them, is along i's column.
    template <class Loads>
    Scalar load(const Loads& loads, const TreeData<Scalar>& tree) const
    {
      return in_sense(sense, Scalar(loads[tree.node(child).v]));
    }
  };
  /// Of a subsystem of which, at the state, nothing else is felt through that child; else null. `springs`: of an
  /// implicit step.
  template <class Data>
  const Coaxial* coaxial(const Node& node, bool springs, Data& ws) const
  {
    const Coaxial& next = coaxial_[static_cast<std::size_t>(node.index)];
    return next.child >= 0 && !springs && !ws.second_look().is_touched(node.frame) ? &next : nullptr;
  }
  const Part& part(Index i) const { return parts_[static_cast<std::size_t>(i)]; }
  /// f(rotor, its ratios) of each rotor of subsystem i.
  template <class F>
  void for_each_rotor(Index i, F&& f) const
  {
    for (std::size_t k = i > 0 ? part(i - 1).rotors_end : 0; k < part(i).rotors_end; ++k) {
      f(rotors_[k], ratios_.data() + rotors_[k].ratio);
    }
  }
  /// f(inertia, ratios) of each spring.
  template <class F>
  void for_each_spring(Index i, F&& f) const
  {
    for (std::size_t k = i > 0 ? part(i - 1).springs_end : 0; k < part(i).springs_end; ++k) {
      f(*springs_[k].inertia, springs_[k].ratio);
    }
  }

  void clear()
  {
    parts_.clear();
    rotors_.clear();
    ratios_.clear();
    springs_.clear();
  }
  /// The next subsystem. R: its inlet's, where it stays.
  template <class S, class State>
  void add(const S& s, const Matrix3<Scalar>& R, const State& state)
  {
    if constexpr (rotor_count<S>() > 0) {
      for (const auto& rotor : s.rotors()) {
        rotors_.push_back({rotor.frame, rotor.axis, rotor.inertia, rotor.coupled, ratios_.size()});
        ratios_.append(rotor.ratio.data(), rotor.ratio.data() + S::n_i);
      }
    }
    for (const auto& spring : state.springs) { springs_.push_back({&spring.inertia, spring.ratio.data()}); }
    const OwnColumn<Scalar>* own = nullptr;
    if constexpr (has_own_twist<S>()) { own = &state.own; }
    parts_.push_back({&R, &state.r, state.S_k[0].data(), state.W.data(), state.MbarR_inv_root.data(), state.qd.data(),
                      own, S::n_i, S::n_frames, is_free<S>(), rotor_count<S>() + spring_count<S>() > 0, rotors_.size(),
                      springs_.size()});
    most_velocities_ = std::max<std::size_t>(most_velocities_, S::n_i);
    has_several_ |= S::n_i > 0 && !(S::n_frames == 1 && has_unit_column<S>());
  }
  /// After the last. several: whether accelerations go side by side.
  void allocate(const TreeData<Scalar>& tree, bool several)
  {
    // As deep as the sums go: the tree, or what counts one by one and what hangs on that, with all that stands still.
    Index depths = 0, still = 0, most_frames = 1;
    for (const Node& node : tree.nodes()) {
      depths = std::max<Index>(depths, tree.depth(node.index) + 1);
      still += part(node.index).n_i == 0;
      most_frames = std::max<Index>(most_frames, part(node.index).n_frames);
    }
    depths = std::min<Index>(depths, most_one_by_one + still + 4);
    one_.allocate(tree);
    if (several && has_several_) { several_.allocate(depths + 1, most_frames, static_cast<Index>(most_velocities_)); }
  }

  /// Once, after allocate.
  [[gnu::cold]] void find_coaxial(const TreeData<Scalar>& tree, const JointLines<Scalar>& lines)
  {
    coaxial_.resize(parts_.size());
    const auto has_rotors = [&](Index i) { return part(i).rotors_end > (i > 0 ? part(i - 1).rotors_end : 0); };
    for (const Node& node : tree.nodes()) {
      const Index child = node.index + 1;
      if (child >= node.subtree_end || tree.node(child).subtree_end < node.subtree_end) { continue; }
      if (has_rotors(node.index) || has_rotors(child) || tree.inlet_mass(child).present) { continue; }
      const Sense sense = lines.against_inlet(child, tree);
      if (sense != Sense::none) { coaxial_[static_cast<std::size_t>(node.index)] = {child, sense}; }
    }
  }

  /// G += what hangs on subsystem `node`, whose first frame has the accelerations a, as far as is_enough(frame, its
  /// accelerations, G) says of all frames of a subsystem that A of them is good enough for what hangs on them, but for
  /// most_one_by_one subsystems outward at most. `springs`: of an implicit step. wrench: += on the frame; null: not
  /// wanted.
  template <class Lane, class Data, class Sum, class IsEnough>
  [[gnu::noinline]] void add_up_until(const IsEnough& is_enough, const Node& node, const Motions<Lane>& a, bool springs,
                                      const Data& ws, Sum& G, Motions<Lane>* wrench)
  {
    several_.add_beyond(*this, node, a, or_deep<Lane, Sum>(is_enough), springs, ws, G, wrench);
  }

  /// The same of a free subsystem, a = apart + S·rates along its axis.
  template <class Lane, class Data, class Sum, class IsEnough>
  [[gnu::noinline]] void add_beyond_free(const IsEnough& is_enough, const Node& node, const Motions<Lane>& a,
                                         const Motions<Lane>& apart, const Lane& rates, bool springs, const Data& ws,
                                         Sum& G)
  {
    several_.add_beyond_free(*this, node, a, apart, rates, or_deep<Lane, Sum>(is_enough), springs, ws, G);
  }

  /// The same of subsystem `node` itself and what hangs on it, its inlet at rest, q̈ the columns of C. wrench: on the
  /// inlet.
  template <class Lane, class Data, int n, class Sum, class IsEnough>
  [[gnu::noinline]] void add_of_velocities(const IsEnough& is_enough, const Node& node,
                                           const Eigen::Matrix<Scalar, n, n>& C, bool springs, const Data& ws, Sum& G,
                                           Motions<Lane>& wrench)
  {
    several_.add_of_velocities(*this, node, C, or_deep<Lane, Sum>(is_enough), springs, ws, G, wrench);
  }

  /// The same of one acceleration a, as far as is_enough(frame, its acceleration, G) says; and the wrench on the frame.
  template <class Data, class IsEnough>
  [[gnu::always_inline]] void add_up_until(const IsEnough& is_enough, const Node& node, const TriplePair<Scalar>& a,
                                           bool springs, const Data& ws, MotionSum<Scalar>& sum,
                                           TriplePair<Scalar>& wrench)
  {
    one_.start(node.frame, a);
    const Index deepest = ws.tree().depth(node.index) + most_one_by_one;
    one_.go_outward(
        *this, node,
        [&](const Node& part, Index frame, const TriplePair<Scalar>& motion, const Scalar& G) __attribute__((
            always_inline)) { return is_enough(frame, motion, G) || ws.tree().depth(part.index) > deepest; },
        springs, ws, sum);
    one_.come_back(*this, ws);
    wrench += one_.wrench(node.frame);
  }

  /// Of subsystem `node` and what hangs on it, its inlet at rest, for column d of C, M̄_R⁻¹ = C Cᵀ: 1, but for what C or
  /// W of those beyond are wrong by.
  template <class Data>
  [[gnu::noinline]] Scalar unit_of(const Node& node, int d, bool springs, const Data& ws)
  {
    const Part& part = parts_[static_cast<std::size_t>(node.index)];
    const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
    for (int e = 0; e < part.n_i; ++e) { one_.qdd(e) = part.C[d * part.n_i + e]; }
    MotionSum<Scalar> sum;
    one_.start(node.frame, {zero, zero});
    // What hangs on what hangs on a subsystem counts in one, but for most_one_by_one subsystems after it.
    const auto is_enough = [&](const Node& beyond, Index, const auto&, const auto&) {
      if (beyond.subtree_end == beyond.index + 1 || beyond.index <= node.index + most_one_by_one) { return false; }
      Index carrier = beyond.parent;  // but for what stands still on it
      while (carrier != node.index && this->part(carrier).n_i == 0) { carrier = ws.tree().node(carrier).parent; }
      return carrier != node.index;
    };
    one_.move(*this, node, {zero, zero}, is_enough, springs, ws, sum);
    one_.go_outward(*this, node, is_enough, springs, ws, sum);
    return sum.G;
  }
  /// Whether a subsystem has other inertia than on its frames.
  template <class Data>
  [[gnu::always_inline]] bool has_more(Index i, const Data& ws) const
  {
    return part(i).has_within || ws.tree().inlet_mass(i).present;
  }

private:
  /// Whether A of a frame is good enough, or so deep that it has to be.
  template <class Lane, class Sum, class IsEnough>
  static auto or_deep(const IsEnough& is_enough)
  {
    return [&is_enough](Index depth, Index frame, const Motions<Lane>& motions, const Sum& sum) {
      return is_enough(frame, motions, sum) || depth > most_one_by_one;
    };
  }

  Array<Part> parts_;
  Array<Coaxial> coaxial_;
  Array<RotorPart> rotors_;
  Array<Scalar> ratios_;
  Array<SpringPart> springs_;
  std::size_t most_velocities_ = 0;
  bool has_several_ = false;  // accelerations side by side (mended_root.hpp)
  SingleMotion<Scalar> one_;
  SeveralMotions<Scalar> several_;
};

}  // namespace iim::detail
