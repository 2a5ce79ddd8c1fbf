// Results that small pivots went into, looked at again: whether they hold, and q̈ made better.
//
// A pivot D with roundings ε·scale (roundings.hpp) is a difference of which no digit may be left. How wrong it is, the
// scale alone does not tell but within a factor of a hundred; but what the equations of motion leave of accelerations
// (motion_residual.hpp) does. For loads on all joints, and on free bodies as well, it is what M⁻¹ is wrong by.
// For h it is an iterative refinement of q̈, which takes away most of the roundings that it has of the forces by which a
// load is held.
//
// What is wrong is not to hide behind what moves more: robots that do not move each other are judged apart, and besides
// each velocity against what loads move it by. (Without, a hand of 1 g hid that an arm under 10⁷ kg was wrong by 90 %.)
//
// M⁻¹ is looked at only where a pivot is below 2¹³ ε of its scale (q̈ wherever a pivot is mended, too). In double that
// takes loads of 10⁹ times a robot's weight; other states pay 1 % of the pass at most. (Before pivots were mended under
// loads as well, which most then are (weak_pivot.hpp), float, seven links, loads of 10³ to 10⁷ kg, 32000 states: 22474
// come back, none off by more than 0.4 %. With a pivot below 192 ε of its scale as zero 17683 did, 67 of them off by
// more than 1 %.)
#pragma once

#include <iim/body.hpp>
#include <iim/numerics/array.hpp>
#include <iim/pass/bodies_beyond.hpp>
#include <iim/pass/heavy_loads.hpp>
#include <iim/pass/motion_residual.hpp>
#include <iim/pass/roundings.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/tree_data.hpp>
#include <iim/update.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace iim::detail {

/// Whether |x| < limit.
template <class Scalar>
bool is_below(const Scalar& x, const Scalar& limit)
{
  return ScalarTraits<Scalar>::is_positive(limit - x) && ScalarTraits<Scalar>::is_positive(limit + x);
}
template <class Scalar>
bool is_below_or_zero(const Scalar& x, const Scalar& limit)
{
  return is_below(x, limit) || (is_finite(x) && x == Scalar(0));  // with -ffast-math NaN could be 0
}

/// Whether passes do so: in matrix form, of one state. (Of several, a small pivot has them computed one by one.)
template <class Data>
inline constexpr bool looks_again = Data::update != Update::square_root && !is_several<typename Data::Scalar>;
/// Whether q̈ is tried to be made better where heavy bodies are held: in square-root form, of one state.
template <class Data>
inline constexpr bool refines_root = Data::update == Update::square_root && !is_several<typename Data::Scalar>;
/// Whether q̈ is made better, where pivots are mended at least.
template <class Data>
inline constexpr bool refines = looks_again<Data> || mends<Data> || refines_root<Data>;

/// Which pivots were small in a pass, what was applied to the frames, and room for the second look.
template <class Scalar>
class SecondLook {
public:
  /// of_free: is_heavier.
  [[gnu::cold]] void allocate(const TreeData<Scalar>& tree, bool of_free)
  {
    members_.resize(at(tree.size()));
    reach_.resize(at(tree.n_v()));
    off_.resize(at(tree.n_v()));
    unit_.resize(at(tree.n_v()), Scalar(1));
    small_.reserve(at(tree.size()));
    touched_.reserve(at(tree.n_frames()));
    is_touched_.resize(at(tree.n_frames()), false);
    applied_.resize(at(tree.n_frames()));
    for (const int times : {16, 32, 128}) {
      if (is_heavier(tree, times, of_free)) { heavy_ = times; }
    }
    Index most = 0;
    for (const Node& node : tree.nodes()) { most = std::max(most, tree.velocities(node.index)); }
    residual_.allocate(tree.n_frames(), tree.n_v(), most);
  }
  /// Where there is anything heavy, which it is for.
  [[gnu::cold]] void find_planes(const TreeData<Scalar>& tree, const Array<TypeFacts<Scalar>>& facts)
  {
    if (has_heavy()) { residual_.find_planes(tree, facts); }
  }
  /// Before a pass.
  void clear()
  {
    has_mended_ = false;
    small_.clear();
    for (const Index frame : touched_) { is_touched_[at(frame)] = false; }
    touched_.clear();
  }
  bool is_needed() const { return !small_.empty(); }
  bool is_needed_for_acceleration() const { return has_mended_ || is_needed(); }
  /// Whether a body is 16 times as heavy as one further inward.
  bool has_heavy() const { return heavy_ > 0; }
  /// q̈ is not made better: in square-root form, where free bodies are light (outweigh_free).
  void leave_heavy() { heavy_ = 0; }

  void note_small_pivot(Index subsystem) { small_.push_back(subsystem); }
  /// M̄_R and W of a pivot, `left` of `scale`, are better than A is: by them q̈ is made better, where a body is far
  /// heavier than one that carries it; if it is 32 times as heavy, of several states 128 times, whatever is left.
  /// (Elsewhere q̈ loses little by this: links of 1 mm between links of 1 m 20 ε, and by δq̈ 60 more. Arms of seven links
  /// under 10 and 100 times their mass: q̈₀ is off by up to 144 and 870 ε where a pivot is mended and this is not done,
  /// by 10 and 20 where it is; passes take up to 37 % longer.)
  void note_mended_pivot(const Scalar& left, const Scalar& scale)
  {
    const int least = heavy_ < (is_several<Scalar> ? 128 : 32) ? 64 : 4;
    if (heavy_ > 0 && !ScalarTraits<Scalar>::is_positive(Scalar(least) * left - scale)) { has_mended_ = true; }
  }
  /// wrench: about the frame's coupling point, world axes.
  void note_applied(Index frame, const Vector6<Scalar>& wrench)
  {
    if (is_touched_[at(frame)]) {
      applied_[at(frame)] += wrench;
    } else {
      applied_[at(frame)] = wrench;
      is_touched_[at(frame)] = true;
      touched_.push_back(frame);
    }
  }

  /// Whether anything is applied to a frame in this pass.
  bool is_touched(Index frame) const { return is_touched_[at(frame)]; }

  /// After the inward loop. A subsystem whose M̄_R is not right; −1 if all are.
  template <class Data>
  [[gnu::cold, gnu::noinline]] Index wrong_pivot(bool springs, Data& ws)
  {
    residual_.choose_axes(ws);
    find_robots(ws);
    set_least_reach(ws);
    // A light free body is moved by loads on it, and on its joints, so much that nothing is seen of other errors: the
    // first time these are not loaded, the second the body is not.
    for (const Index time : {1, 2, 3}) {
      for (const Node& node : ws.tree().nodes()) {
        const bool is_free = ws.bodies_beyond().part(node.index).is_free;
        const bool moves = time >= (is_free ? 3 : is_on_free(node, ws) ? 2 : 1);
        for (Index v = node.v; v < node.v + ws.tree().velocities(node.index); ++v) {
          // Not all of one size: with 1 and −1 roundings cancelled for 55 of 20000 machines that have no M⁻¹.
          const double size = 1 + static_cast<double>((7 * v + 5 * time) % 8) / 8;
          residual_.load(v) = Scalar(!moves ? 0 : v / time % 2 == 0 ? size : -size) * unit_[at(v)];
        }
        Member& own = members_[at(node.index)];
        own.is_judged = moves || time > 1;
        own.by_each = moves && (time == 1 || !ws.bodies_beyond().part(own.first).is_free);
      }
      residual_.stand_still();
      residual_.compute(false, false, springs, ws, [](auto&&) {});
      residual_.add_change();
      residual_.compute(false, false, springs, ws, [](auto&&) {});
      if (!robots_hold(256, Scalar(1.0 / 4), ws)) { return worst(springs, ws); }
      note_moves(ws);
    }
    return moves_hold(ws) ? -1 : worst(springs, ws);
  }

  /// After the outward loop: q̈ += δq̈, and V̇ with it. Where pivots are small twice, and false if the first δq̈ is not
  /// small, or the second not much smaller; where they are mended, once. velocity, gravity, springs: of the scene. (A
  /// load that motors hold still has q̈ of roundings alone. With 1 and 16 times these instead of 64 a quarter to a half
  /// and nine tenths of such states in float come back; the error of all stays within 16 times what roundings of u do
  /// to q̈. Where nothing drives the robot, q̈₀ of that size is wrong: under 10⁹ times the links, axes through two
  /// points, float, 49 of 64 states are refused so that came back, off by up to 220 %; of loads to 10⁷ none.)
  template <class Data>
  [[gnu::cold, gnu::noinline]] bool refine(bool velocity, bool gravity, bool springs, Data& ws)
  {
    if constexpr (looks_again<Data>) {
      if (is_needed()) {
        find_robots(ws);
        for (Member& member : members_) { member.is_judged = true; }
      }
    }
    take(ws);
    const auto apply = wrenches();
    if (is_needed()) {
      if constexpr (looks_again<Data>) {
        if (!refine_twice(velocity, gravity, springs, ws, apply)) { return false; }
      }
    } else {
      residual_.template compute<false>(velocity, gravity, springs, ws, apply);
      residual_.add_change();
      for (Index v = 0; v < ws.tree().n_v(); ++v) {
        if (!is_finite(residual_.x(v))) { return true; }  // near overflow q̈ stays as it is
      }
    }
    residual_.put(ws);
    return true;
  }

  /// The same in square-root form, whose q̈ seldom needs it: only if δq̈ is not small, and a second one, which is of the
  /// residual's roundings alone, is. (Seven links of any axes under 10³ to 10¹² times their mass, 600 states each: q̈₀
  /// is off by 35 to 68 ε at most, by 110 to 1900 without; five links of which four turn about parallel axes, under 10⁷
  /// times: 9, 10⁶. Thin rods that turn about themselves lose by it: of 600 such arms under 10³ times their mass q̈₀ of
  /// 1 % has 300 ε instead of 140, with loads of 10 times 265 instead of 39 if δq̈ of 16 ε counted there, too.)
  template <class Data>
  [[gnu::cold, gnu::noinline]] void refine_root(bool velocity, bool gravity, Data& ws)
  {
    take(ws);
    set_units(ws);
    Scalar all, first, second;                                   // the largest of them
    const auto are_finite = [&](const auto& of, Scalar& most) {  // near overflow q̈ stays as it is
      most = Scalar(0);
      for (Index v = 0; v < ws.tree().n_v(); ++v) {
        if (!is_finite(of(v))) { return false; }
        most = larger(most, Scalar(magnitude(of(v)) * unit_[at(v)]));
      }
      return true;
    };
    const auto x = [&](Index v) { return residual_.x(v); };
    const auto change = [&](Index v) { return residual_.change(v); };
    residual_.template compute<false>(velocity, gravity, false, ws, wrenches());
    if (!are_finite(x, all) || !are_finite(change, first)) { return; }
    const Scalar small = all * (Scalar(heavy_ < 128 ? 1024 : 16) * Eigen::NumTraits<Scalar>::epsilon());
    if (is_below_or_zero(first, small)) { return; }
    residual_.add_change();
    residual_.template compute<false>(velocity, gravity, false, ws, wrenches());
    if (are_finite(change, second) && is_below_or_zero(second, Scalar(first * Scalar(0.25)))) { residual_.put(ws); }
  }

  /// After refine: the first of the small pivots in the robot that is wrong.
  Index first() const
  {
    for (const Index i : small_) {
      if (is_in_wrong_robot(i)) { return i; }
    }
    return wrong_;
  }

private:
  /// What a pass has found, to residual_.
  template <class Data>
  void take(Data& ws)
  {
    for (Index v = 0; v < ws.tree().n_v(); ++v) { residual_.load(v) = ws.load()(v); }
    residual_.choose_axes(ws);
    residual_.take(ws);
  }
  /// Of what is applied to frames.
  auto wrenches() const
  {
    return [this](auto&& f) {
      for (const Index frame : touched_) { f(frame, applied_[at(frame)]); }
    };
  }

  /// False if δq̈ does not say that q̈ is right.
  template <class Data, class Apply>
  bool refine_twice(bool velocity, bool gravity, bool springs, Data& ws, Apply&& apply)
  {
    bool driven = !touched_.empty();
    for (Index v = 0; v < ws.tree().n_v(); ++v) { driven |= !(residual_.load(v) == Scalar(0)); }
    for (const int smaller : {16, 256}) {
      residual_.compute(velocity, gravity, springs, ws, apply);
      const bool with_roundings = driven || smaller == 16;
      if (!robots_hold(smaller, Scalar(with_roundings ? 64 : 0), ws)) { return false; }
      residual_.add_change();
    }
    return true;
  }

  /// A subsystem, as one of those that can move each other.
  struct Member {
    Index first = 0;                      ///< of these
    bool is_judged = true;                ///< whether its δx counts
    bool by_each = true;                  ///< and is compared with what this velocity alone is moved by
    Scalar x = Scalar(0), roundings = x;  ///< if it is the first: of all, the largest acceleration, and roundings
  };

  /// Of the small pivots in the robot that is wrong, the first whose sum over what it moves is far from M̄_R; else the
  /// first.
  template <class Data>
  Index worst(bool springs, Data& ws)
  {
    for (const Index i : small_) {
      if (!is_in_wrong_robot(i)) { continue; }
      for (int d = 0; d < ws.bodies_beyond().part(i).n_i; ++d) {
        const Scalar off = ws.bodies_beyond().unit_of(ws.tree().node(i), d, springs, ws) - Scalar(1);
        if (!is_below(off, Scalar(1.0 / 64))) { return i; }
      }
    }
    return first();
  }

  bool is_in_wrong_robot(Index i) const { return members_[at(i)].first == members_[at(wrong_)].first; }

  /// A free body within a tree moves with what is before it, but does not move it.
  template <class Data>
  void find_robots(Data& ws)
  {
    for (const Node& node : ws.tree().nodes()) {
      const bool begins = node.parent < 0 || ws.bodies_beyond().part(node.index).is_free;
      members_[at(node.index)].first = begins ? Index(node.index) : members_[at(node.parent)].first;
    }
    set_units(ws);
  }
  /// So that accelerations of all velocities can be compared, whatever the units of coordinates are: how much each
  /// moves a frame, or turns a rotor.
  template <class Data>
  void set_units(Data& ws)
  {
    using std::sqrt;
    for (const Node& node : ws.tree().nodes()) {
      const auto& part = ws.bodies_beyond().part(node.index);
      for (int d = 0; d < part.n_i && !part.is_free; ++d) {
        Scalar square(0);
        for (int k = 0; k < part.n_frames; ++k) { square = larger(square, dot(part.column(k, d), part.column(k, d))); }
        if (!ScalarTraits<Scalar>::is_positive(square)) {
          ws.bodies_beyond().for_each_rotor(node.index, [&](const auto&, const Scalar* ratio) {
            square = larger(square, Scalar(ratio[d] * ratio[d]));
          });
        }
        unit_[at(node.v + d)] = ScalarTraits<Scalar>::is_positive(square) ? Scalar(sqrt(square)) : Scalar(1);
      }
    }
  }
  /// The inlet held, a load of 1 moves a joint by M̄_R⁻¹, and by no less where that can move, too. (1: of unit_.)
  template <class Data>
  void set_least_reach(Data& ws)
  {
    for (const Node& node : ws.tree().nodes()) {
      const auto& part = ws.bodies_beyond().part(node.index);
      for (int d = 0; d < part.n_i; ++d) {
        Scalar& reach = reach_[at(node.v + d)];
        reach = Scalar(0);
        off_[at(node.v + d)] = Scalar(0);
        for (int e = 0; !part.is_free && e < part.n_i; ++e) {
          reach += part.C[e * part.n_i + d] * part.C[e * part.n_i + d];
        }
        reach *= unit_[at(node.v + d)];
      }
    }
  }

  template <class Data>
  void note_moves(const Data& ws)
  {
    for_each_judged(ws, [&](Index v, const Member& own, Member&) {
      if (!own.by_each) { return; }
      reach_[at(v)] = larger(reach_[at(v)], magnitude(residual_.x(v)));
      off_[at(v)] = larger(off_[at(v)], Scalar(magnitude(residual_.change(v)) - roundings(v, Scalar(1.0 / 4))));
    });
  }
  /// Whether each δx but for roundings is small against what the loads have moved this velocity by. (1/32, before
  /// pivots were mended under loads: of seven rods under 10⁵ kg, a hand of 1 g on the load, 91 % come back, none of
  /// their rows of B̂ off by more than 3.2 %; with 1/64 80 %, 1.6 %, with 1/16 96 %, 6.2 %.) On a free body it is told
  /// but of joints farther out.
  template <class Data>
  bool moves_hold(const Data& ws)
  {
    bool hold = true;
    for_each_judged(ws, [&](Index v, const Member& own, const Member&) {
      if (!is_below_or_zero(off_[at(v)], Scalar(reach_[at(v)] * Scalar(1.0 / 32)))) { hold = note_wrong(own); }
    });
    return hold;
  }
  /// Whether of each robot δx is less than its largest x / smaller, or than `uncertain` times the roundings in it.
  template <class Data>
  bool robots_hold(int smaller, const Scalar& uncertain, const Data& ws)
  {
    for (Member& robot : members_) { robot.x = robot.roundings = Scalar(0); }
    for_each_judged(ws, [&](Index v, const Member&, Member& robot) {
      robot.x = larger(robot.x, Scalar(magnitude(residual_.x(v)) * unit_[at(v)]));
      robot.roundings = larger(robot.roundings, Scalar(roundings(v, uncertain) * unit_[at(v)]));
    });
    bool hold = true;
    for_each_judged(ws, [&](Index v, const Member& own, const Member& robot) {
      const Scalar limit = larger(Scalar(robot.x / Scalar(smaller)), robot.roundings);
      if (!is_below_or_zero(Scalar(residual_.change(v) * unit_[at(v)]), limit)) { hold = note_wrong(own); }
    });
    return hold;
  }
  bool note_wrong(const Member& member)
  {
    wrong_ = static_cast<Index>(&member - members_.data());
    return false;
  }
  /// f(velocity, its subsystem, the first of the robot).
  template <class Data, class F>
  void for_each_judged(const Data& ws, F&& f)
  {
    for (const Node& node : ws.tree().nodes()) {
      Member& own = members_[at(node.index)];
      for (Index v = node.v; own.is_judged && v < node.v + ws.tree().velocities(node.index); ++v) {
        f(v, own, members_[at(own.first)]);
      }
    }
  }
  Scalar roundings(Index v, const Scalar& times) const
  {
    return residual_.unseen(v) * (times * Eigen::NumTraits<Scalar>::epsilon());
  }

  int heavy_ = 0;  // 16, 32 or 128: a body is that many times as heavy as one further inward
  bool has_mended_ = false;
  Array<Index> small_;    // subsystems
  Array<Index> touched_;  // frames that something is applied to
  Array<bool> is_touched_;
  Array<Vector6<Scalar>> applied_;  // to frames
  Index wrong_ = 0;                 // a subsystem of which something does not hold
  Array<Member> members_;           // of subsystems
  Array<Scalar> reach_, off_;       // of velocities: the largest x and δx
  Array<Scalar> unit_;              // of velocities
  MotionResidual<Scalar> residual_;
};

}  // namespace iim::detail
