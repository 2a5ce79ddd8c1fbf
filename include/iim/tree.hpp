// Trees of subsystems: topology and types read at run time (DynamicTree) or standing in the type (StaticTree).
//
// The recursions know neither: they are written once, against `outward` (parents before children), `inward` (children
// before parents) and a node that says where a subsystem's numbers are. In a static tree these are constants.
#pragma once

#include <iim/assembly.hpp>
#include <iim/errors.hpp>
#include <iim/subsystem.hpp>
#include <iim/tree_data.hpp>

#include <array>
#include <map>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

namespace iim {

/// A tree whose topology, and which of the types S… each subsystem has, are read from an Assembly at run time.
/// Constant after construction: one tree may be shared by all threads.
template <class... S>
class DynamicTree : public detail::TreeData<typename Assembly<S...>::Scalar> {
  using Base = detail::TreeData<typename Assembly<S...>::Scalar>;

public:
  using typename Base::Scalar;
  using Parts = Assembly<S...>;

  /// Throws ModelError for whatever is wrong with the assembly (Assembly::sorted).
  [[gnu::cold]] explicit DynamicTree(const Parts& assembly) : DynamicTree(assembly, assembly.sorted()) {}

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
  [[gnu::cold]] DynamicTree(const Parts& assembly, const std::vector<typename Parts::NamedPart>& parts) : Base(assembly, parts)
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
