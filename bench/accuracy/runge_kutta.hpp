// The classical Runge–Kutta method on q̈₀.
#pragma once

#include "../common/pool.hpp"

#include <iim/iim.hpp>

#include <array>

namespace bench {

/// Steps of a tree without inputs, y = (q, q̇). Refers to the tree.
template <class TreeType, iim::Update update = iim::Update::projected>
class RungeKutta {
public:
  using Scalar = typename TreeType::Scalar;
  using Vector = iim::VectorX<Scalar>;

  explicit RungeKutta(const TreeType& tree) : tree_(&tree), workspace_(tree)
  {
    k_.fill(Vector(tree.n_q() + tree.n_v()));
    moved_ = step_ = k_.front();
  }

  /// What a step of length h adds to y is step() then. False if an acceleration could not be computed.
  bool operator()(const Vector& y, const Scalar& h)
  {
    bool ok = rate(y, k_[0]);
    moved_ = y + h / 2 * k_[0];
    ok = rate(moved_, k_[1]) && ok;
    moved_ = y + h / 2 * k_[1];
    ok = rate(moved_, k_[2]) && ok;
    moved_ = y + h * k_[2];
    ok = rate(moved_, k_[3]) && ok;
    step_ = h / 6 * (k_[0] + Scalar(2) * (k_[1] + k_[2]) + k_[3]);
    return ok;
  }

  const Vector& step() const { return step_; }

private:
  bool rate(const Vector& y, Vector& k)
  {
    const auto q = y.head(tree_->n_q());
    const auto qd = y.tail(tree_->n_v());
    const auto fd = iim::forward_dynamics(q, qd, workspace_);
    k.tail(tree_->n_v()) = fd.qdd0();
    auto rates = k.head(tree_->n_q());
    iim::coordinate_rate(*tree_, q, qd, rates);
    return fd.ok();
  }

  const TreeType* tree_;
  iim::Workspace<TreeType, update> workspace_;
  std::array<Vector, 4> k_;
  Vector moved_, step_;
};

}  // namespace bench
