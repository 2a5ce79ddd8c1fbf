// What every Scalar must do: the same robots as in double, with the Scalar's own precision.
#pragma once

#include "random_tree.hpp"

namespace iim::test {

template <class T>
struct AffineResult {
  MatrixX<T> Bhat;
  VectorX<T> qdd0;
};

/// q̈₀ and B̂ of a random robot in Scalar T.
template <class T, Update update = Update::projected>
AffineResult<T> affine(const RandomRobot& random, const RandomState& state)
{
  const DynamicTree tree(in<T>(random.assembly));
  const Inputs inputs = make_inputs(tree, random.inputs);
  Workspace<std::remove_const_t<decltype(tree)>, update> ws(tree);
  ImplicitInversion method(tree, inputs);
  const VectorX<T> q = state.q.template cast<T>(), qd = state.qd.template cast<T>();
  const auto result = method(forward_dynamics(q, qd, ws));
  if (!result.ok()) { throw ModelError("the random robot has no result in this Scalar"); }
  return {result.Bhat, result.qdd0};
}

}  // namespace iim::test
