// Trees of subsystems: topology and types read at run time (DynamicTree) or standing in the type (StaticTree).
//
// The recursions know neither: they are written once, against `outward` (parents before children), `inward` (children
// before parents) and a node that says where a subsystem's numbers are. In a static tree these are constants.
#pragma once

#include <iim/assembly.hpp>
#include <iim/body.hpp>
#include <iim/errors.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>

#include <array>
#include <map>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
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
  std::size_t slot = 0;   ///< which of that type (dynamic trees)
};

/// A frame by name: which frame of the tree, and where on it.
template <class Scalar>
struct FrameReference {
  Index subsystem = -1;
  Index frame = -1;  ///< −1: the world
  Placement<Scalar> at;
};

namespace detail {

/// What both kinds of tree keep: names, placements, bodies, numbers of coordinates.
template <class Scalar_>
class TreeData {
public:
  using Scalar = Scalar_;

  Index size() const { return static_cast<Index>(nodes_.size()); }  ///< number of subsystems
  Index n_q() const { return n_q_; }                                ///< number of coordinates
  Index n_v() const { return n_v_; }                                ///< number of velocities, the paper's n
  Index n_motors() const { return n_u_; }                           ///< number of motor inputs
  Index n_frames() const { return static_cast<Index>(frame_mass_.size()); }
  Index max_path_v() const { return max_path_v_; }  ///< longest path from the world, in velocities
  Index n_bbar() const { return n_bbar_; }

  const Vector3<Scalar>& gravity() const { return gravity_; }  ///< world axes [m/s²]
  const std::vector<Node>& nodes() const { return nodes_; }
  const Node& node(Index i) const { return nodes_[static_cast<std::size_t>(i)]; }
  const std::string& name(Index i) const { return names_[static_cast<std::size_t>(i)]; }
  const Placement<Scalar>& placement(Index i) const { return placements_[static_cast<std::size_t>(i)]; }
  bool placement_turns(Index i) const { return turns_[static_cast<std::size_t>(i)] != 0; }
  /// Whether the axes of subsystem i are made orthogonal again: at every 16th of a path.
  bool straightens(Index i) const { return depth_[static_cast<std::size_t>(i)] % 16 == 15; }
  const FrameMass<Scalar>& frame_mass(Index frame) const { return frame_mass_[static_cast<std::size_t>(frame)]; }
  const FrameMass<Scalar>& inlet_mass(Index i) const { return inlet_mass_[static_cast<std::size_t>(i)]; }
  /// Subsystem that owns a frame.
  Index owner(Index frame) const { return owner_[static_cast<std::size_t>(frame)]; }

  /// Number of the subsystem of that name. Throws ModelError if there is none.
  Index index(const std::string& name) const
  {
    for (Index i = 0; i < size(); ++i) {
      if (this->name(i) == name) { return i; }
    }
    throw ModelError("there is no subsystem '" + name + "'");
  }

  /// Frame of that name: a subsystem's first frame, or one given by Assembly::add_frame. Throws ModelError.
  const FrameReference<Scalar>& frame(const std::string& name) const
  {
    const auto found = named_frames_.find(name);
    if (found == named_frames_.end()) { throw ModelError("there is no subsystem or frame '" + name + "'"); }
    return found->second;
  }

  const std::map<std::string, FrameReference<Scalar>>& named_frames() const { return named_frames_; }

protected:
  template <class AssemblyType>
  explicit TreeData(const AssemblyType& assembly, const std::vector<typename AssemblyType::NamedPart>& parts)
      : gravity_(assembly.gravity())
  {
    for (const auto& part : parts) {
      std::visit([&](const auto& s) { append(part, s); }, part.part);
    }
    close_subtrees();
    for (const auto& frame : assembly.named_frames()) {
      FrameReference<Scalar> reference{-1, -1, {frame.on.R, frame.on.p}};
      if (frame.on.parent != "world") {
        reference.subsystem = index(frame.on.parent);
        reference.frame = node(reference.subsystem).frame + frame.on.outlet;
      }
      named_frames_[frame.name] = reference;
    }
  }

  std::vector<Node> nodes_;

private:
  template <class Part, class S>
  void append(const Part& part, const S& s)
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
    n_q_ += S::n_q;
    n_v_ += S::n_i;
    n_u_ += S::n_u;
    n_bbar_ += S::n_i * S::n_u;
    node.v_end = n_v_;
    node.subtree_end = node.index + 1;
    max_path_v_ = std::max(max_path_v_, node.path_v + S::n_i);
    nodes_.push_back(node);

    names_.push_back(part.name);
    placements_.push_back({part.on.R, part.on.p});
    turns_.push_back(part.on.R != Matrix3<Scalar>::Identity());
    depth_.push_back(part.parent < 0 ? 0 : depth_[static_cast<std::size_t>(part.parent)] + 1);
    inlet_mass_.emplace_back();
    for (int k = 0; k < S::n_frames; ++k) {
      frame_mass_.emplace_back();
      owner_.push_back(node.index);
    }
    for (const CarriedBody<Scalar>& carried : s.bodies()) {
      // Where a type's prepare() does not look. A rotor's inertia may stand here without its mass.
      validate_inertia(carried.body, "subsystem '" + part.name + "'");
      FrameMass<Scalar>& mass = carried.frame < 0 ? inlet_mass_.back()
                                                  : frame_mass_[static_cast<std::size_t>(node.frame + carried.frame)];
      mass.add(carried.body);
    }
    named_frames_[part.name] = {node.index, node.frame, {}};
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

  Vector3<Scalar> gravity_;
  Index n_q_ = 0;
  Index n_v_ = 0;
  Index n_u_ = 0;
  Index n_bbar_ = 0;
  Index max_path_v_ = 0;
  std::vector<std::string> names_;
  std::vector<Placement<Scalar>> placements_;
  std::vector<char> turns_;
  std::vector<Index> depth_;  // number of ancestors
  std::vector<FrameMass<Scalar>> frame_mass_;
  std::vector<FrameMass<Scalar>> inlet_mass_;
  std::vector<Index> owner_;
  std::map<std::string, FrameReference<Scalar>> named_frames_;
};

}  // namespace detail

/// A tree whose topology, and which of the types S… each subsystem has, are read from an Assembly at run time.
/// Constant after construction: one tree may be shared by all threads.
template <class... S>
class DynamicTree : public detail::TreeData<typename Assembly<S...>::Scalar> {
  using Base = detail::TreeData<typename Assembly<S...>::Scalar>;

public:
  using typename Base::Scalar;
  using Parts = Assembly<S...>;

  /// Throws ModelError for whatever is wrong with the assembly (Assembly::sorted).
  explicit DynamicTree(const Parts& assembly) : DynamicTree(assembly, assembly.sorted()) {}

  /// One Data<S> per subsystem, contiguous per type.
  template <template <class> class Data>
  class Storage {
  public:
    explicit Storage(const DynamicTree& tree) : data_(std::vector<Data<S>>(tree.template subsystems<S>().size())...) {}
    template <class T>
    Data<T>& at(const Node& node)
    {
      return std::get<std::vector<Data<T>>>(data_)[node.slot];
    }
    template <class T>
    const Data<T>& at(const Node& node) const
    {
      return std::get<std::vector<Data<T>>>(data_)[node.slot];
    }

  private:
    std::tuple<std::vector<Data<S>>...> data_;
  };

  /// Calls f(node, subsystem) for every subsystem, parents before children.
  template <class F>
  void outward(F&& f) const
  {
    for (const Node& node : this->nodes_) { dispatch(node, f); }
  }

  /// Calls f(node, subsystem) for every subsystem, children before parents.
  template <class F>
  void inward(F&& f) const
  {
    for (auto node = this->nodes_.rbegin(); node != this->nodes_.rend(); ++node) { dispatch(*node, f); }
  }

  /// Calls f(node, subsystem) for subsystem i.
  template <class F>
  void visit(Index i, F&& f) const
  {
    dispatch(this->node(i), f);
  }

  /// All subsystems of one type.
  template <class T>
  const std::vector<T>& subsystems() const
  {
    return std::get<std::vector<T>>(subsystems_);
  }

private:
  DynamicTree(const Parts& assembly, const std::vector<typename Parts::NamedPart>& parts) : Base(assembly, parts)
  {
    for (std::size_t k = 0; k < parts.size(); ++k) {
      Node& node = this->nodes_[k];
      node.type = static_cast<int>(parts[k].part.index());
      std::visit(
          [&]<class T>(const T& s) {
            auto& same = std::get<std::vector<T>>(subsystems_);
            node.slot = same.size();
            same.push_back(s);
          },
          parts[k].part);
    }
  }

  template <class F>
  void dispatch(const Node& node, F& f) const
  {
    [&]<std::size_t... K>(std::index_sequence<K...>) {
      (void)((node.type == static_cast<int>(K) && (f(node, std::get<K>(subsystems_)[node.slot]), true)) || ...);
    }(std::index_sequence_for<S...>{});
  }

  std::tuple<std::vector<S>...> subsystems_;
};

/// Position of a subsystem in a StaticTree: its parent's place in the list (−1: the world), its type, the outlet.
template <int Parent, class S, int Outlet = 0>
struct On {
  static constexpr int parent = Parent;
  static constexpr int outlet = Outlet;
  using Subsystem = S;
};

/// A tree whose topology and types stand in the C++ type: On<parent, type>…, depth first. The numbers (placements,
/// masses, names) come from an Assembly of the same shape.
template <class... Nodes>
class StaticTree : public detail::TreeData<typename std::tuple_element_t<0, std::tuple<Nodes...>>::Subsystem::Scalar> {
  using Base = detail::TreeData<typename std::tuple_element_t<0, std::tuple<Nodes...>>::Subsystem::Scalar>;
  static constexpr int n_nodes = sizeof...(Nodes);
  static constexpr std::array<int, n_nodes> parents{Nodes::parent...};
  static constexpr std::array<int, n_nodes> outlets{Nodes::outlet...};
  static constexpr std::array<int, n_nodes> sizes_q{Nodes::Subsystem::n_q...};
  static constexpr std::array<int, n_nodes> sizes_v{Nodes::Subsystem::n_i...};
  static constexpr std::array<int, n_nodes> sizes_u{Nodes::Subsystem::n_u...};
  static constexpr std::array<int, n_nodes> sizes_frames{Nodes::Subsystem::n_frames...};

  static constexpr bool is_depth_first()
  {
    for (int i = 0; i < n_nodes; ++i) {
      if (parents[static_cast<std::size_t>(i)] >= i || parents[static_cast<std::size_t>(i)] < -1) { return false; }
      // The parent is the previous node or an ancestor of it.
      int ancestor = i - 1;
      while (ancestor >= 0 && ancestor != parents[static_cast<std::size_t>(i)]) {
        ancestor = parents[static_cast<std::size_t>(ancestor)];
      }
      if (ancestor != parents[static_cast<std::size_t>(i)]) { return false; }
    }
    return true;
  }
  static_assert(is_depth_first(), "the subsystems of a StaticTree must be listed depth first, parents before children");

  static constexpr Index sum(const std::array<int, n_nodes>& sizes, int end)
  {
    Index total = 0;
    for (int k = 0; k < end; ++k) { total += sizes[static_cast<std::size_t>(k)]; }
    return total;
  }
  static constexpr int subtree_end_of(int i)
  {
    int end = i + 1;
    while (end < n_nodes) {
      int ancestor = end;
      while (ancestor > i) { ancestor = parents[static_cast<std::size_t>(ancestor)]; }
      if (ancestor != i) { break; }
      ++end;
    }
    return end;
  }

public:
  using typename Base::Scalar;
  template <int I>
  using Type = typename std::tuple_element_t<I, std::tuple<Nodes...>>::Subsystem;

  /// A Node whose members are constants.
  template <int I>
  struct StaticNode {
    static constexpr std::size_t at = static_cast<std::size_t>(I);
    static constexpr Index index = I;
    static constexpr Index parent = parents[at];
    static constexpr Index frame = sum(sizes_frames, I);
    static constexpr Index q = sum(sizes_q, I);
    static constexpr Index v = sum(sizes_v, I);
    static constexpr Index u = sum(sizes_u, I);
    static constexpr Index bbar = [] {
      Index total = 0;
      for (std::size_t k = 0; k < at; ++k) { total += sizes_v[k] * sizes_u[k]; }
      return total;
    }();
    static constexpr Index inlet = [] {
      if constexpr (parents[at] < 0) {
        return Index(-1);
      } else {
        return sum(sizes_frames, parents[at]) + outlets[at];
      }
    }();
    static constexpr Index path_v = [] {
      Index total = 0;
      for (int k = parents[at]; k >= 0; k = parents[static_cast<std::size_t>(k)]) {
        total += sizes_v[static_cast<std::size_t>(k)];
      }
      return total;
    }();
    static constexpr Index subtree_end = subtree_end_of(I);
    static constexpr Index v_end = sum(sizes_v, subtree_end_of(I));
  };

  /// Throws ModelError if the assembly is wrong in itself or has another shape than this type.
  template <class... S>
  explicit StaticTree(const Assembly<S...>& assembly) : StaticTree(assembly, assembly.sorted())
  {
  }

  /// One Data<S> per subsystem.
  template <template <class> class Data>
  class Storage {
  public:
    explicit Storage(const StaticTree&) {}
    template <class T, int I>
    Data<T>& at(const StaticNode<I>&)
    {
      return std::get<I>(data_);
    }
    template <class T, int I>
    const Data<T>& at(const StaticNode<I>&) const
    {
      return std::get<I>(data_);
    }

  private:
    std::tuple<Data<typename Nodes::Subsystem>...> data_;
  };

  template <class F>
  void outward(F&& f) const
  {
    [&]<int... I>(std::integer_sequence<int, I...>) {
      (f(StaticNode<I>{}, std::get<I>(subsystems_)), ...);
    }(std::make_integer_sequence<int, n_nodes>{});
  }

  template <class F>
  void inward(F&& f) const
  {
    [&]<int... I>(std::integer_sequence<int, I...>) {
      (f(StaticNode<n_nodes - 1 - I>{}, std::get<n_nodes - 1 - I>(subsystems_)), ...);
    }(std::make_integer_sequence<int, n_nodes>{});
  }

  template <class F>
  void visit(Index i, F&& f) const
  {
    [&]<int... I>(std::integer_sequence<int, I...>) {
      (void)((I == i && (f(StaticNode<I>{}, std::get<I>(subsystems_)), true)) || ...);
    }(std::make_integer_sequence<int, n_nodes>{});
  }

private:
  template <class Part>
  StaticTree(const auto& assembly, const std::vector<Part>& parts) : Base(assembly, parts)
  {
    if (this->size() != n_nodes) {
      throw ModelError("the assembly has " + std::to_string(this->size()) + " subsystems, the StaticTree " +
                       std::to_string(n_nodes));
    }
    [&]<int... I>(std::integer_sequence<int, I...>) {
      (take(std::get<I>(subsystems_), StaticNode<I>{}, parts[static_cast<std::size_t>(I)]), ...);
    }(std::make_integer_sequence<int, n_nodes>{});
  }

  template <class S, class N, class Part>
  void take(S& s, const N& expected, const Part& part)
  {
    const Node& node = this->node(N::index);
    if (node.parent != expected.parent || node.inlet != expected.inlet) {
      throw ModelError("subsystem '" + part.name + "' hangs elsewhere in the StaticTree's type than in the assembly");
    }
    if (!std::holds_alternative<S>(part.part)) {
      throw ModelError("subsystem '" + part.name + "' has another type in the StaticTree than in the assembly");
    }
    s = std::get<S>(part.part);
  }

  std::tuple<typename Nodes::Subsystem...> subsystems_;
};

}  // namespace iim
