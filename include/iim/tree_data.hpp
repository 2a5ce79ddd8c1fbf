// What every tree keeps, however its topology is known: numbers, names, placements and bodies of its subsystems.
#pragma once

#include <iim/assembly.hpp>
#include <iim/body.hpp>
#include <iim/errors.hpp>
#include <iim/numerics/array.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>

#include <algorithm>
#include <atomic>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <type_traits>
#include <vector>

namespace iim {

/// Where the numbers of one subsystem are. Subsystems and velocities are numbered depth first.
struct Node {
  Index index = 0;        ///< of the subsystem
  Index parent = -1;      ///< subsystem; −1: the world
  Index inlet = -1;       ///< frame that it hangs on; −1: the world
  Index frame = 0;        ///< its first frame
  Index q = 0;            ///< its first coordinate
  Index v = 0;            ///< its first velocity
  Index u = 0;            ///< its first motor
  Index bbar = 0;         ///< its B̄ block in Workspace::Bbar
  Index path_v = 0;       ///< number of velocities of its ancestors
  Index subtree_end = 0;  ///< first subsystem after its subtree
  Index v_end = 0;        ///< first velocity after its subtree
  int type = 0;           ///< which type of subsystem (dynamic trees)
  std::size_t slot = 0;   ///< which of that type
};

/// A frame by name: which frame of the tree, and where on it.
template <class Scalar>
struct FrameReference {
  Index subsystem = -1;
  Index frame = -1;  ///< −1: the world
  Placement<Scalar> at;
};

/// A point of a frame, in its axes [m], where a function asks for one: a vector, three numbers, or {} for its origin.
template <class Scalar>
struct FramePoint {
  Vector3<Scalar> at = Vector3<Scalar>::Zero();

  FramePoint() = default;
  /// Throws ModelError unless it has three numbers.
  template <class Vector>
  FramePoint(const Eigen::MatrixBase<Vector>& point)
  {
    EIGEN_STATIC_ASSERT_VECTOR_ONLY(Vector)
    if (point.size() != 3) {
      detail::refuse({"a point of a frame must have 3 coordinates, got ", std::to_string(point.size())});
    }
    at = point;
  }
  FramePoint(const Scalar& x, const Scalar& y, const Scalar& z) : at(x, y, z) {}
};

namespace detail {

/// Another number each time, in the whole program.
inline std::uint64_t next_id()
{
  static std::atomic<std::uint64_t> last{0};
  return ++last;
}

/// What both kinds of tree keep: names, placements, bodies, numbers of coordinates.
template <class Scalar_>
class TreeData {
public:
  using Scalar = Scalar_;

  TreeData(const TreeData&) = default;
  TreeData(TreeData&&) = default;
  /// Nothing is assigned to a tree: workspaces, inputs and methods keep numbers of it.
  TreeData& operator=(const TreeData&) = delete;

  Index size() const { return static_cast<Index>(nodes_.size()); }  ///< number of subsystems
  Index n_q() const { return n_q_; }                                ///< number of coordinates
  Index n_v() const { return n_v_; }                                ///< number of velocities, the paper's n
  Index n_motors() const { return n_u_; }                           ///< number of motor inputs
  Index n_frames() const { return static_cast<Index>(frame_mass_.size()); }
  Index max_path_v() const { return max_path_v_; }  ///< longest path from the world, in velocities
  Index n_bbar() const { return n_bbar_; }

  /// Another number than that of any robot made otherwise than by copying this.
  std::uint64_t id() const { return id_; }

  const Vector3<Scalar>& gravity() const { return gravity_; }  ///< world axes [m/s²]
  const std::vector<Node>& nodes() const { return nodes_; }
  const Node& node(Index i) const
  {
    assert(i >= 0 && i < size() && "no such subsystem");
    return nodes_[static_cast<std::size_t>(i)];
  }
  /// That of the subsystem of that name. Throws ModelError if there is none.
  const Node& node(const std::string& name) const { return node(index(name)); }
  /// Subsystems by depth, the deepest first; those of one depth last to first.
  const Array<Index>& deepest_first() const { return deepest_first_; }
  /// How many velocities and motors subsystem i has.
  Index velocities(Index i) const { return (i + 1 < size() ? node(i + 1).v : n_v_) - node(i).v; }
  Index motors(Index i) const { return (i + 1 < size() ? node(i + 1).u : n_u_) - node(i).u; }
  /// Behind the last of its frames, which begin at Node::frame.
  Index end_of_frames(Index i) const { return i + 1 < size() ? node(i + 1).frame : n_frames(); }
  /// Of −1, the subsystem of a status that is about none: "(no subsystem)".
  const std::string& name(Index i) const
  {
    assert(i >= -1 && i < size() && "no such subsystem");
    static const std::string none = "(no subsystem)";
    return i < 0 ? none : names_[static_cast<std::size_t>(i)];
  }
  const Placement<Scalar>& placement(Index i) const { return placements_[static_cast<std::size_t>(i)]; }
  bool placement_turns(Index i) const { return turns_[static_cast<std::size_t>(i)] != 0; }
  /// Whether the axes of the frames of subsystem i are made orthogonal again: at every eighth of a path, but not its
  /// end; of several states, whose inertias are turned to the world's axes before pivots are formed, at every third.
  /// (Seven joints, placements that turn, B̂ of several states: median and worst 2.5, 12 ε; at every 16th 5.0, 27. 6 to
  /// 24 skew joints, one state: over 16 ε for 0.8 % of states; at every 16th 2.3 %. Several states of a chain of seven
  /// take 3 % longer.)
  bool straightens(Index i) const
  {
    constexpr Index period = is_several<Scalar> ? 3 : 8;
    return depth(i) % period == period - 1 && (is_several<Scalar> || node(i).subtree_end > i + 1);
  }
  /// Number of ancestors.
  Index depth(Index i) const { return depth_[static_cast<std::size_t>(i)]; }
  const FrameMass<Scalar>& frame_mass(Index frame) const { return frame_mass_[static_cast<std::size_t>(frame)]; }
  const FrameMass<Scalar>& inlet_mass(Index i) const { return inlet_mass_[static_cast<std::size_t>(i)]; }
  /// Subsystem that owns a frame.
  Index owner(Index frame) const { return owner_[static_cast<std::size_t>(frame)]; }

  /// Whether all subsystems have the numbers that they have in `other`.
  template <class T>
  [[gnu::cold]] bool is_shaped_as(const TreeData<T>& other) const
  {
    bool same = size() == other.size() && n_frames() == other.n_frames() && n_q() == other.n_q() &&
                n_v() == other.n_v() && n_motors() == other.n_motors() && n_bbar() == other.n_bbar();
    for (Index i = 0; same && i < size(); ++i) {
      const Node &a = node(i), &b = other.node(i);
      same = a.inlet == b.inlet && a.frame == b.frame && a.q == b.q && a.v == b.v && a.u == b.u && a.bbar == b.bbar;
    }
    return same;
  }

  /// Number of the subsystem of that name. Throws ModelError if there is none.
  Index index(const std::string& name) const
  {
    for (Index i = 0; i < size(); ++i) {
      if (this->name(i) == name) { return i; }
    }
    const auto frame = named_frames_.find(name);
    if (frame == named_frames_.end() || frame->second.subsystem < 0) { refuse({"there is no subsystem '", name, "'"}); }
    refuse({"'", name, "' is no subsystem, but a frame on '", this->name(frame->second.subsystem), "' (tree.frame)"});
  }

  /// Frame of that name: a subsystem's first frame, one given by Assembly::add_frame, or a FixedLink's. Throws
  /// ModelError.
  const FrameReference<Scalar>& frame(const std::string& name) const
  {
    const auto found = named_frames_.find(name);
    if (found != named_frames_.end()) { return found->second; }
    throw ModelError(name == "world" ? "the world is no frame of the robot"
                                     : "there is no subsystem or frame '" + name + "'");
  }

  const std::map<std::string, FrameReference<Scalar>>& named_frames() const { return named_frames_; }

protected:
  template <class AssemblyType>
  [[gnu::cold]] explicit TreeData(const AssemblyType& assembly, const typename AssemblyType::Merged& merged)
      : gravity_(assembly.gravity())
  {
    for (const auto& part : merged.parts) {
      visit_part(part.part, [&]<class S>(const S& s) {
        static_assert(S::n_i > 0 || rotor_count<S>() == 0, "a rotor turns with a subsystem's velocities");
        static_assert(S::n_i > 0 || S::n_u == 0, "motors act on a subsystem's velocities");
        append(part, {S::n_q, S::n_i, S::n_u, S::n_frames});
        if constexpr (has_unit_column<S>()) { check_unit(part.name, "own_twist", s.own_twist()); }
        if constexpr (is_free<S>() && (S::n_u > 0 || has_internal_force<S>())) {
          Index carrier = part.parent;
          while (carrier >= 0 && node(carrier).v_end == node(carrier).v) {  // stands still on the next
            carrier = node(carrier).parent;
          }
          if (carrier >= 0) {
            refuse({"subsystem '", part.name, "': a free one with motors or internal forces on '",
                    names_[static_cast<std::size_t>(part.parent)], "' instead of the world"});
          }
        }
        for (const CarriedBody<Scalar>& carried : s.bodies()) {
          if (follows_frame<S>() && carried.frame < 0) {
            refuse({"subsystem '", part.name, "': a body on the inlet does not follow the frame (about_frame)"});
          }
          check_frame(part.name, "body", carried.frame, S::n_frames);
          carry(carried);
        }
        if constexpr (requires { s.rotors(); }) {
          for (const auto& rotor : s.rotors()) {
            check_frame(part.name, "rotor", rotor.frame, S::n_frames);
            check_rotor(part.name, rotor);
          }
        }
        if constexpr (is_free<S>()) { frame_mass_.back().set_about(s.bodies()[0].body.com); }
      });
    }
    close_subtrees();
    sort_by_depth();
    for (const auto& frame : merged.frames) { named_frames_[frame.name] = frame_on(frame.on); }
    for (const auto& frame : assembly.named_frames()) {
      named_frames_[frame.name] = frame_on(assembly.on_part(frame.name, frame.on));
    }
  }

  std::vector<Node> nodes_;

private:
  struct Sizes {
    int n_q, n_i, n_u, n_frames;
  };

  // Not by type of the subsystem: this is the same for all, and what it would cost is compile time.
  template <class Part>
  [[gnu::cold]] void append(const Part& part, const Sizes& s)
  {
    Node node;
    node.index = size();
    node.parent = part.parent;
    node.frame = n_frames();
    node.q = n_q_;
    node.v = n_v_;
    node.u = n_u_;
    node.bbar = n_bbar_;
    if (part.parent >= 0) {
      const Node& parent = this->node(part.parent);
      node.inlet = parent.frame + part.on.outlet;
      node.path_v = parent.path_v + (parent.v_end - parent.v);  // v_end is the parent's own until close_subtrees
    }
    n_q_ += s.n_q;
    n_v_ += s.n_i;
    n_u_ += s.n_u;
    n_bbar_ += s.n_i * s.n_u;
    node.v_end = n_v_;
    node.subtree_end = node.index + 1;
    max_path_v_ = std::max(max_path_v_, node.path_v + s.n_i);
    nodes_.push_back(node);

    names_.push_back(part.name);
    placements_.push_back({without_noise(part.on.R), part.on.p});
    turns_.push_back(placements_.back().R != Matrix3<Scalar>::Identity());
    depth_.push_back(part.parent < 0 ? 0 : depth(part.parent) + 1);
    inlet_mass_.emplace_back();
    for (int k = 0; k < s.n_frames; ++k) {
      frame_mass_.emplace_back();
      owner_.push_back(node.index);
    }
    named_frames_[part.name] = {node.index, node.frame, {}};
  }

  /// A rotation without what its own roundings are larger than: of a quarter turn 6e-17 is left of cos π/2, in float a
  /// subnormal number where two of these meet, which takes a hundred times as long (pass of a quadruped in float: half
  /// the time without).
  [[gnu::cold]] static Matrix3<Scalar> without_noise(Matrix3<Scalar> R)
  {
    using std::abs;
    if constexpr (std::is_floating_point_v<Scalar> || is_several<Scalar>) {  // or lanes of them
      for (Scalar& x : R.reshaped()) {
        if (abs(x) <= Eigen::NumTraits<Scalar>::epsilon() / Scalar(2)) { x = Scalar(0); }
      }
    }
    return R;
  }

  /// on: a part, or a FixedLink that is a frame already.
  [[gnu::cold]] FrameReference<Scalar> frame_on(const Attachment<Scalar>& on) const
  {
    if (on.parent == "world") { return {-1, -1, {on.R, on.p}}; }
    const FrameReference<Scalar>& parent = frame(on.parent);
    return {parent.subsystem, parent.frame + on.outlet, parent.at * Placement<Scalar>{on.R, on.p}};
  }

  static void check_frame(const std::string& name, const char* what, int frame, int n_frames)
  {
    if (frame < -1 || frame >= n_frames) {
      refuse({"subsystem '", name, "' has a ", what, " on frame ", std::to_string(frame), " of ",
              std::to_string(n_frames)});
    }
  }

  // Once more, as a type's prepare() may not look.

  template <class Rotor>
  [[gnu::cold]] static void check_rotor(const std::string& name, const Rotor& rotor)
  {
    const std::string part = "subsystem '" + name + "': a rotor's ";
    if (!(rotor.inertia >= Scalar(0)) || !is_finite(rotor.inertia)) {
      refuse({part, "inertia must be finite and not negative, got ", to_text(rotor.inertia)});
    }
    if (!all_finite(rotor.ratio)) { refuse({part, "ratios must be finite, got ", to_text(rotor.ratio)}); }
    if (!rotor.coupled) { return; }
    check_unit(name, "a rotor's axis", rotor.axis);
  }
  template <class Vector>
  [[gnu::cold]] static void check_unit(const std::string& name, const char* what, const Vector& x)
  {
    double square = 0;
    for (Index i = 0; i < x.size(); ++i) { square += to_double(x(i)) * to_double(x(i)); }
    if (!(std::abs(square - 1) < 2e-6)) {
      refuse({"subsystem '", name, "': ", what, " must be a unit vector, got ", to_text(x)});
    }
  }

  /// On the last subsystem.
  void carry(const CarriedBody<Scalar>& carried)
  {
    const std::string owner = "subsystem '" + names_.back() + "'";
    // Zero: a rotor's inertia may stand here without its mass.
    if (!(carried.body.mass >= Scalar(0)) || !is_finite(carried.body.mass)) {
      refuse({owner, ": mass must be finite and not negative, got ", to_text(carried.body.mass), " kg"});
    }
    validate_inertia(carried.body, owner);
    FrameMass<Scalar>& mass = carried.frame < 0
                                  ? inlet_mass_.back()
                                  : frame_mass_[static_cast<std::size_t>(nodes_.back().frame + carried.frame)];
    mass.add(carried.body);
  }

  void close_subtrees()
  {
    for (auto node = nodes_.rbegin(); node != nodes_.rend(); ++node) {
      if (node->parent >= 0) {
        Node& parent = nodes_[static_cast<std::size_t>(node->parent)];
        parent.subtree_end = std::max(parent.subtree_end, node->subtree_end);
        parent.v_end = std::max(parent.v_end, node->v_end);
      }
    }
  }

  [[gnu::cold]] void sort_by_depth()
  {
    Array<Index> end(depth_.size());  // of the subsystems of each depth in deepest_first_
    for (const Index depth : depth_) { ++end[static_cast<std::size_t>(depth)]; }
    for (std::size_t depth = end.size(); depth-- > 1;) { end[depth - 1] += end[depth]; }
    deepest_first_.resize(depth_.size());
    for (Index i = 0; i < size(); ++i) {
      deepest_first_[static_cast<std::size_t>(--end[static_cast<std::size_t>(depth(i))])] = i;
    }
  }

  std::uint64_t id_ = next_id();
  Vector3<Scalar> gravity_;
  Index n_q_ = 0;
  Index n_v_ = 0;
  Index n_u_ = 0;
  Index n_bbar_ = 0;
  Index max_path_v_ = 0;
  Array<std::string> names_;
  Array<Placement<Scalar>> placements_;
  Array<char> turns_;
  Array<Index> depth_;
  Array<Index> deepest_first_;
  Array<FrameMass<Scalar>> frame_mass_;
  Array<FrameMass<Scalar>> inlet_mass_;
  Array<Index> owner_;
  std::map<std::string, FrameReference<Scalar>> named_frames_;
};

}  // namespace detail

}  // namespace iim
