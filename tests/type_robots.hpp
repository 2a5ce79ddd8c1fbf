// Robots around one subsystem under test, and what two of them are compared by.
#pragma once

#include "random_tree.hpp"

#include <iim/iim.hpp>

#include <cmath>
#include <string>
#include <vector>

namespace iim::test {

/// q̈₀ and B̂ of a tree at a state, by implicit inversion, with all inputs active.
struct Answer {
  Eigen::VectorXd qdd0;
  Eigen::MatrixXd Bhat;
  Status status;
};

template <class Tree>
Answer solve(const Tree& tree, const Inputs<Tree>& inputs, const Eigen::VectorXd& q, const Eigen::VectorXd& qd)
{
  Workspace ws(tree);
  ImplicitInversion<Tree> method(tree, inputs);
  const auto receipt = forward_dynamics(q, qd, ws);
  const auto result = method(receipt);
  return {result.qdd0, result.Bhat, result.status};
}

/// Where something hangs, at random.
inline Attachment<double> random_attachment(Random& random, const std::string& parent, int outlet = 0)
{
  return {parent, random.rotation(), random.vector(0.4), outlet};
}

inline double relative_error(const Eigen::MatrixXd& value, const Eigen::MatrixXd& reference)
{
  return (value - reference).norm() / reference.norm();
}

inline constexpr double eps = std::numeric_limits<double>::epsilon();

}  // namespace iim::test
