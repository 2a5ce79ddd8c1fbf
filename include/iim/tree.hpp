// Trees of subsystems: topology and types read at run time (DynamicTree) or standing in the type (StaticTree).
//
// The recursions know neither: they are written once, against `outward` (parents before children), `inward` (children
// before parents) and a node that says where a subsystem's numbers are. Nodes are numbers in a static tree, too: as
// constants they made a function of every node, which the instruction cache does not hold (biped, pass: 1.3 times as
// long).
#pragma once

#include <iim/assembly.hpp>
#include <iim/errors.hpp>
#include <iim/numerics/array.hpp>
#include <iim/subsystem.hpp>
#include <iim/tree_data.hpp>

#include <algorithm>
#include <array>
#include <cassert>
#include <concepts>
#include <cstddef>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
#include <variant>

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
  [[gnu::cold]] explicit DynamicTree(const Parts& assembly) : DynamicTree(assembly, assembly.merged()) {}

  /// One Data<S> per subsystem, contiguous per type.
  template <template <class> class Data>
  class Storage {
  public:
    explicit Storage(const DynamicTree& tree) : data_(detail::Array<Data<S>>(tree.template subsystems<S>().size())...)
    {
    }
    template <class T>
    Data<T>& at(const Node& node)
    {
      return std::get<detail::Array<Data<T>>>(data_)[node.slot];
    }
    template <class T>
    const Data<T>& at(const Node& node) const
    {
      return std::get<detail::Array<Data<T>>>(data_)[node.slot];
    }

  private:
    std::tuple<detail::Array<Data<S>>...> data_;
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

  /// The same, the deepest first. What comes next is then of another limb and need not wait for what comes before (pass
  /// of a biped 6 % less).
  template <class F>
  void inward_abreast(F&& f) const
  {
    for (const Index i : this->deepest_first()) { dispatch(this->node(i), f); }
  }

  /// And outward, the other way round (3 %).
  template <class F>
  void outward_abreast(F&& f) const
  {
    const detail::Array<Index>& order = this->deepest_first();
    for (auto i = order.rbegin(); i != order.rend(); ++i) { dispatch(this->node(*i), f); }
  }

  /// Calls f(node, subsystem) for subsystem i.
  template <class F>
  void visit(Index i, F&& f) const
  {
    dispatch(this->node(i), f);
  }

  /// All subsystems of one type.
  template <class T>
  const detail::Array<T>& subsystems() const
  {
    return std::get<detail::Array<T>>(subsystems_);
  }

private:
  [[gnu::cold]] DynamicTree(const Parts& assembly, const typename Parts::Merged& merged) : Base(assembly, merged)
  {
    for (std::size_t k = 0; k < merged.parts.size(); ++k) {
      const auto& part = merged.parts[k].part;
      Node& node = this->nodes_[k];
      node.type = static_cast<int>(part.index());
      detail::visit_part(part, [&]<class T>(const T& s) {
        auto& same = std::get<detail::Array<T>>(subsystems_);
        node.slot = same.size();
        same.push_back(s);
      });
    }
  }

  template <class F>
  void dispatch(const Node& node, F& f) const
  {
    [&]<std::size_t... K>(std::index_sequence<K...>) {
      (void)((node.type == static_cast<int>(K) && (f(node, std::get<K>(subsystems_)[node.slot]), true)) || ...);
    }(std::index_sequence_for<S...>{});
  }

  std::tuple<detail::Array<S>...> subsystems_;
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

  /// As TreeData::deepest_first, whose name stays free for it.
  static constexpr std::array<std::size_t, n_nodes> by_depth = [] {
    std::array<int, n_nodes> depth{};
    std::array<std::size_t, n_nodes> order{};
    for (std::size_t i = 0; i < n_nodes; ++i) {
      if (parents[i] >= 0) { depth[i] = depth[static_cast<std::size_t>(parents[i])] + 1; }
      order[i] = i;
    }
    std::sort(order.begin(), order.end(),
              [&](std::size_t a, std::size_t b) { return depth[a] != depth[b] ? depth[a] > depth[b] : a > b; });
    return order;
  }();

  template <class T>
  static constexpr std::array<bool, n_nodes> of_type{std::is_same_v<T, typename Nodes::Subsystem>...};
  template <class T>
  static constexpr std::size_t first_of()
  {
    return static_cast<std::size_t>(std::find(of_type<T>.begin(), of_type<T>.end(), true) - of_type<T>.begin());
  }
  template <class T>
  static constexpr std::size_t count_of()
  {
    return static_cast<std::size_t>(std::count(of_type<T>.begin(), of_type<T>.end(), true));
  }
  struct Nothing {};
  /// All of one type stand where it is first.
  template <template <class> class Data, std::size_t... I>
  static std::tuple<std::conditional_t<
      first_of<typename Nodes::Subsystem>() == I,
      std::array<Data<typename Nodes::Subsystem>, count_of<typename Nodes::Subsystem>()>, Nothing>...>
      of_all_types(std::index_sequence<I...>);

public:
  using typename Base::Scalar;
  template <std::size_t I>
  using Type = typename std::tuple_element_t<I, std::tuple<Nodes...>>::Subsystem;

  /// Throws ModelError if the assembly is wrong in itself or has another shape than this type: as a DynamicTree has it,
  /// or with all FixedLinks as subsystems.
  template <class... S>
  explicit StaticTree(const Assembly<S...>& assembly) : StaticTree(assembly, parts_of(assembly))
  {
  }

  /// One Data<S> per subsystem, contiguous per type.
  template <template <class> class Data>
  class Storage {
  public:
    explicit Storage(const StaticTree&) {}
    template <class T>
    Data<T>& at(const Node& node)
    {
      return std::get<first_of<T>()>(data_)[node.slot];
    }
    template <class T>
    const Data<T>& at(const Node& node) const
    {
      return std::get<first_of<T>()>(data_)[node.slot];
    }

  private:
    decltype(of_all_types<Data>(std::index_sequence_for<Nodes...>{})) data_;
  };

  template <class F>
  void outward(F&& f) const
  {
    [&]<std::size_t... I>(std::index_sequence<I...>) {
      (f(this->nodes_[I], std::get<I>(subsystems_)), ...);
    }(std::index_sequence_for<Nodes...>{});
  }

  template <class F>
  void inward(F&& f) const
  {
    [&]<std::size_t... I>(std::index_sequence<I...>) {
      (f(this->nodes_[n_nodes - 1 - I], std::get<n_nodes - 1 - I>(subsystems_)), ...);
    }(std::index_sequence_for<Nodes...>{});
  }

  template <class F>
  void inward_abreast(F&& f) const
  {
    [&]<std::size_t... I>(std::index_sequence<I...>) {
      (f(this->nodes_[by_depth[I]], std::get<by_depth[I]>(subsystems_)), ...);
    }(std::index_sequence_for<Nodes...>{});
  }

  template <class F>
  void outward_abreast(F&& f) const
  {
    [&]<std::size_t... I>(std::index_sequence<I...>) {
      (f(this->nodes_[by_depth[n_nodes - 1 - I]], std::get<by_depth[n_nodes - 1 - I]>(subsystems_)), ...);
    }(std::index_sequence_for<Nodes...>{});
  }

  template <class F>
  void visit(Index i, F&& f) const
  {
    [&]<std::size_t... I>(std::index_sequence<I...>) {
      (void)((I == static_cast<std::size_t>(i) && (f(this->nodes_[I], std::get<I>(subsystems_)), true)) || ...);
    }(std::index_sequence_for<Nodes...>{});
  }

private:
  /// FixedLinks are subsystems if the type lists all of them, and otherwise frames as in a DynamicTree.
  template <class... S>
  [[gnu::cold]] static typename Assembly<S...>::Merged parts_of(const Assembly<S...>& assembly)
  {
    return assembly.parts().size() == n_nodes ? typename Assembly<S...>::Merged{assembly.sorted(), {}}
                                              : assembly.merged();
  }

  template <class AssemblyType>
  StaticTree(const AssemblyType& assembly, const typename AssemblyType::Merged& merged) : Base(assembly, merged)
  {
    if (this->size() != n_nodes) {
      const std::size_t parts = assembly.parts().size();
      detail::refuse({"the assembly has ", std::to_string(this->size()), " subsystems",
                      (parts > merged.parts.size() ? " (with all FixedLinks " + std::to_string(parts) + ")" : ""),
                      ", the StaticTree ", std::to_string(n_nodes)});
    }
    [&]<std::size_t... I>(std::index_sequence<I...>) {
      (take<I>(merged.parts[I]), ...);
    }(std::index_sequence_for<Nodes...>{});
  }

  template <std::size_t I, class Part>
  void take(const Part& part)
  {
    using S = Type<I>;
    Node& node = this->nodes_[I];
    const bool on_outlet = node.parent < 0 || node.inlet == this->node(node.parent).frame + outlets[I];
    if (node.parent != parents[I] || !on_outlet) {
      detail::refuse({"subsystem '", part.name, "' hangs elsewhere in the StaticTree's type than in the assembly"});
    }
    if (!std::holds_alternative<S>(part.part)) {
      detail::refuse({"subsystem '", part.name, "' has another type in the StaticTree than in the assembly"});
    }
    node.slot = static_cast<std::size_t>(std::count(of_type<S>.begin(), of_type<S>.begin() + I, true));
    std::get<I>(subsystems_) = std::get<S>(part.part);
  }

  std::tuple<typename Nodes::Subsystem...> subsystems_;
};

namespace detail {
template <class T>
concept IsTree = requires { typename T::Scalar; } && std::derived_from<T, TreeData<typename T::Scalar>>;
}  // namespace detail

/// How a result of the cycle ended, in words for a log: "not positive definite: subsystem 'wrist'". Of what
/// forward_dynamics, a method, Tasks or SeveralStates return. Allocates.
template <class Result, detail::IsTree Tree>
[[gnu::cold]] std::string describe(const Result& result, const Tree& tree)
{
  const auto words = [&](Status status, Index subsystem) {
    std::string text = to_string(status);
    if (status == Status::invalid_state) {
      text += subsystem < 0
                  ? " (a step's length negative or not finite)"
                  : " (not finite, a quaternion that is not of unit length, or a linkage that cannot close or "
                    "is at a dead centre)";
    } else if (status == Status::mismatch) {
      text += " (sizes, or parts that were not made for each other; assertions say which)";
    }
    return subsystem < 0 ? text : text + ": subsystem '" + tree.name(subsystem) + "'";
  };
  if constexpr (requires { result.status(); }) {
    return words(result.status(), result.subsystem());
  } else {
    return words(result.status, result.subsystem);
  }
}

/// Coordinates of the tree at which all its subsystems are in their reference positions: zeros and unit quaternions.
/// Allocates.
template <detail::IsTree Tree>
VectorX<typename Tree::Scalar> neutral(const Tree& tree)
{
  VectorX<typename Tree::Scalar> q(tree.n_q());
  tree.outward([&]<class S>(const Node& node, const S& s) { q.template segment<S::n_q>(node.q) = neutral(s); });
  return q;
}

/// After a step of an integrator, whose sums do not keep it: all quaternions of q (n_q) are of unit length.
template <detail::IsTree Tree, class Q>
void normalize(const Tree& tree, Q&& q)
{
  assert(q.size() == tree.n_q() && "q must have n_q entries");
  tree.outward([&]<class S>(const Node& node, const S& s) {
    detail::Coordinates<S> own = q.template segment<S::n_q>(node.q);
    normalize(s, own);
    q.template segment<S::n_q>(node.q) = own;
  });
}

/// rate = dq/dt at the coordinates q (n_q) for the velocities q̇ (n_v): what an integrator adds up. q̇ itself but for
/// types like a floating base, whose quaternion it turns; of that no step keeps the length, which `normalize` divides
/// out again. A rate of another size than n_q becomes one of n_q, which allocates; a block must have it.
template <detail::IsTree Tree, class Q, class V, class Rate>
void coordinate_rate(const Tree& tree, const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd, Rate&& rate)
{
  assert(q.size() == tree.n_q() && "q must have n_q entries");
  assert(qd.size() == tree.n_v() && "qd must have n_v entries");
  if constexpr (requires { rate.resize(tree.n_q()); }) {
    if (rate.size() != tree.n_q()) { rate.resize(tree.n_q()); }
  }
  assert(rate.size() == tree.n_q() && "rate must have n_q entries");
  tree.outward([&]<class S>(const Node& node, const S& s) {
    const detail::Coordinates<S> own = q.template segment<S::n_q>(node.q);
    const detail::Velocities<S> velocity = qd.template segment<S::n_i>(node.v);
    rate.template segment<S::n_q>(node.q) = coordinate_rate(s, own, velocity);
  });
}

}  // namespace iim
