// Measures a type of subsystem in chains of two and twelve of it.
#pragma once

#include "../common/statistics.hpp"
#include "types.hpp"

#include <iim/iim.hpp>

#include <chrono>
#include <cmath>
#include <random>
#include <stdexcept>
#include <utility>
#include <vector>

namespace bench {

/// A chain of one type, its states within 0.4 rad (m) of neutral, and what is to be computed in each of them.
template <class S>
class TypeChain {
public:
  using Scalar = typename S::Scalar;
  using Tree = decltype(iim::DynamicTree(std::declval<iim::Assembly<S>>()));
  using Vector = iim::VectorX<Scalar>;
  static constexpr std::size_t states = 16;

  TypeChain(const S& part, int outlet, int length)
      : tree_(chain(part, outlet, length)), inputs_(wrench(tree_)), ws_(tree_), method_(tree_, inputs_)
  {
    std::mt19937_64 bits(1);
    const auto uniform = [&](double size) { return size * (static_cast<double>(bits() >> 11) * 0x1p-52 - 1); };
    for (std::size_t k = 0; k < states; ++k) {
      Vector q(tree_.n_q()), qd(tree_.n_v());
      tree_.outward([&]<class N, class T>(const N& node, const T& s) {
        auto at = iim::neutral(s);
        for (auto& x : at) { x = x + Scalar(uniform(0.4)); }
        if constexpr (T::n_q > T::n_i) { at.template tail<4>() /= Scalar(at.template tail<4>().norm()); }
        q.template segment<T::n_q>(node.q) = at;
      });
      for (auto& x : qd) { x = Scalar(uniform(2)); }
      q_.push_back(q);
      qd_.push_back(qd);
      if (!iim::forward_dynamics(q, qd, ws_).ok()) { throw std::runtime_error("a state is out of reach"); }
    }
  }
  TypeChain(const TypeChain&) = delete;

  void qdd0()
  {
    for (std::size_t k = 0; k < states; ++k) { keep(iim::forward_dynamics(q_[k], qd_[k], ws_).qdd0()); }
  }

  /// q̈₀ and six columns.
  void six_columns()
  {
    for (std::size_t k = 0; k < states; ++k) { keep(method_(iim::forward_dynamics(q_[k], qd_[k], ws_)).Bhat); }
  }

private:
  /// So that nothing is left out as unused; a chain of fixed links has no rows.
  template <class Derived>
  void keep(const Eigen::MatrixBase<Derived>& answer)
  {
    if (answer.size() > 0) { sink_ = answer(0, 0); }
  }

  static iim::Assembly<S> chain(const S& part, int outlet, int length)
  {
    iim::Assembly<S> parts;
    const iim::Matrix3<Scalar> R =
        Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix().template cast<Scalar>();
    for (int k = 0; k < length; ++k) {
      iim::Attachment<Scalar> on{"", R, {Scalar(0.1), Scalar(0.05), Scalar(0.2)}, outlet};
      on.parent = k == 0 ? "world" : std::to_string(k - 1);
      if (k == 0) { on.outlet = 0; }
      parts.add(std::to_string(k), on, part);
    }
    parts.add_frame(
        "tip",
        {std::to_string(length - 1), iim::Matrix3<Scalar>::Identity(), {Scalar(0.1), Scalar(0), Scalar(0)}, outlet});
    return parts;
  }

  static iim::Inputs<Tree> wrench(const Tree& tree)
  {
    iim::Inputs<Tree> inputs(tree, iim::Start::empty);
    inputs.add_wrench("tip");
    return inputs;
  }

  Tree tree_;
  iim::Inputs<Tree> inputs_;
  iim::Workspace<Tree> ws_;
  iim::ImplicitInversion<Tree> method_;
  std::vector<Vector> q_, qd_;
  Scalar sink_{};
};

/// Median time of f in nanoseconds.
template <class F>
double nanoseconds(F&& f, int repetitions)
{
  std::vector<double> times;
  for (int k = 0; k < repetitions; ++k) {
    const auto begin = std::chrono::steady_clock::now();
    f();
    times.push_back(std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - begin).count());
  }
  return spread(times).median;
}

/// `part`: in double, with cast<T>(); `outlet`: of the frame that carries the next one.
template <class S>
TypeCost cost_of(const std::string& name, const S& part, bool quick, int outlet = 0)
{
  using C = decltype(part.template cast<Counted>());
  constexpr double more = 10, states = static_cast<double>(TypeChain<S>::states);
  TypeCost cost{name, S::n_i, S::n_u, {}, {}};
  {
    TypeChain<C> two(part.template cast<Counted>(), outlet, 2), twelve(part.template cast<Counted>(), outlet, 12);
    const Operations qdd0 = operations([&] { twelve.qdd0(); }) - operations([&] { two.qdd0(); });
    const Operations all = operations([&] { twelve.six_columns(); }) - operations([&] { two.six_columns(); });
    cost.qdd0.operations = qdd0 / (more * states);
    cost.column.operations = (all - qdd0) / (6 * more * states);
  }
  TypeChain<S> two(part, outlet, 2), twelve(part, outlet, 12);
  const int repetitions = quick ? 200 : 5000;
  const double qdd0 = nanoseconds([&] { twelve.qdd0(); }, repetitions) - nanoseconds([&] { two.qdd0(); }, repetitions);
  const double all =
      nanoseconds([&] { twelve.six_columns(); }, repetitions) - nanoseconds([&] { two.six_columns(); }, repetitions);
  cost.qdd0.nanoseconds = qdd0 / (more * states);
  cost.column.nanoseconds = (all - qdd0) / (6 * more * states);
  return cost;
}

/// A box of 2 kg.
inline iim::Body<double> box()
{
  return {2, Eigen::Vector3d(0.1, -0.05, 0.08), Eigen::Vector3d(0.03, 0.04, 0.05).asDiagonal(), false};
}

}  // namespace bench
