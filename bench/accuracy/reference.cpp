// PART OF: iim_accuracy
// REQUIRES: boost
// The reference in 80 digits, what errors are scaled by, and what one ε of double in the data does to the result.
#include "../common/table.hpp"
#include "digits.hpp"
#include "perturbed.hpp"

#include <iim/equations_of_motion.hpp>
#include <iim/recursive_inverse.hpp>
#include <iim/unit_force.hpp>

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <variant>

namespace bench {

namespace {

using Parts = iim::StandardAssembly<Digits>;
using DigitsTree = Tree<Digits>;
using Matrix = iim::MatrixX<Digits>;

/// The robot with rotations that are rotations to all digits: those of a file are so to 10⁻¹⁶, and a rotation off by
/// that is not the same robot in body-fixed axes as in the world's.
Parts orthonormal(const Parts& parts)
{
  const auto mend = [](auto on) {
    for (int k = 0; k < 4; ++k) {  // Newton: digits double
      const iim::Matrix3<Digits> twice = 3 * iim::Matrix3<Digits>::Identity() - on.R.transpose() * on.R;
      on.R = iim::Matrix3<Digits>(on.R * twice) / Digits(2);
    }
    return on;
  };
  Parts mended;
  for (const auto& part : parts.parts()) {
    std::visit([&](const auto& s) { mended.add(part.name, mend(part.on), s); }, part.part);
  }
  for (const auto& frame : parts.named_frames()) { mended.add_frame(frame.name, mend(frame.on)); }
  mended.set_gravity(parts.gravity());
  return mended;
}

/// The library with many digits, on one robot.
class Exact {
public:
  Exact(const AccuracyScene& scene, const Parts& parts)
      : tree(parts), inputs(accuracy_inputs(scene, tree)), none_(tree, iim::Start::empty), workspace_(tree),
        unit_force_(tree, inputs), inverse_(tree, none_), equations_(tree, inputs)
  {
  }
  Exact(const Exact&) = delete;
  Exact& operator=(const Exact&) = delete;

  auto operator()(const State<Digits>& x) { return unit_force_(iim::forward_dynamics(x.q, x.qd, workspace_)); }

  /// Good until its next use.
  iim::MotionEquations<Digits> equations(const State<Digits>& x) { return equations_(x.q, x.qd, workspace_); }

  Matrix Minv(const State<Digits>& x)
  {
    inverse_(iim::forward_dynamics(x.q, x.qd, workspace_));
    return inverse_.Minv();
  }

  const DigitsTree tree;
  const iim::Inputs<DigitsTree> inputs;

private:
  iim::Inputs<DigitsTree> none_;
  iim::Workspace<DigitsTree, iim::Update::printed> workspace_;
  iim::UnitForce<DigitsTree> unit_force_;
  iim::RecursiveInverse<DigitsTree> inverse_;
  iim::EquationsOfMotion<DigitsTree> equations_;
};

double relative(const Matrix& a, const Matrix& b)
{
  const Digits size = b.norm();
  return size > 0 ? static_cast<double>(Digits((a - b).norm() / size)) : 0.0;
}

/// Largest eigenvalue of a symmetric matrix.
Digits largest_eigenvalue(const Matrix& A)
{
  const Digits size = A.cwiseAbs().maxCoeff();
  const Eigen::MatrixXd scaled = (A / size).cast<double>();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scaled, Eigen::EigenvaluesOnly);
  return size * solver.eigenvalues().maxCoeff();
}

double root(const Digits& x) { return static_cast<double>(Digits(sqrt(x))); }

}  // namespace

AccuracyReference accuracy_reference(const AccuracyScene& scene)
{
  AccuracyReference reference;
  const Parts parts = orthonormal(scene.parts.cast<Digits>());
  Exact exact(scene, parts);
  std::mt19937_64 source(2026);
  for (std::size_t k = 0; k < scene.states.size(); ++k) {
    const State<Digits> x = scene.states[k].cast<Digits>();
    const auto result = exact(x);
    if (!result.ok()) {
      reference.failure = iim::to_string(result.status);
      return reference;
    }
    if (!result.Bhat.template cast<double>().allFinite()) {
      reference.failure = "beyond double";
      return reference;
    }
    const auto equations = exact.equations(x);
    const ExactState values{result.qdd0, result.Bhat, equations.M, equations.B};
    if (k == 0 && exact.tree.n_v() <= 64) {
      const double apart = apart_from_the_paper(scene, parts, x, values);
      // 80 digits less those that the worst mass matrix of the scenes, of condition 10²⁶, costs.
      if (!(apart < 1e-50)) {
        throw std::runtime_error(scene.name + ": the two references differ by " + text("%.1e", apart));
      }
    }
    Yardstick y;
    y.M = values.M.cast<long double>();
    y.B = values.B.cast<long double>();
    const Matrix Minv = exact.Minv(x);
    y.row.resize(Minv.rows());
    for (Index i = 0; i < Minv.rows(); ++i) { y.row(i) = root(Minv(i, i)); }
    y.column.resize(values.B.cols());
    for (Index j = 0; j < values.B.cols(); ++j) { y.column(j) = root(values.B.col(j).dot(values.Bhat.col(j))); }
    y.condition = static_cast<double>(Digits(largest_eigenvalue(values.M) * largest_eigenvalue(Minv)));
    for (int sample = 0; sample < (exact.tree.n_v() > 100 ? 1 : 2); ++sample) {
      Exact other(scene, perturbed(parts, source));
      const auto moved = other(perturbed(x, source));
      if (!moved.ok()) { continue; }
      y.Bhat_sensitivity = std::max(y.Bhat_sensitivity, relative(moved.Bhat, values.Bhat));
      y.qdd0_sensitivity = std::max(y.qdd0_sensitivity, relative(moved.qdd0, values.qdd0));
    }
    reference.values.push_back({Precise(values.qdd0), Precise(values.Bhat)});
    reference.yardsticks.push_back(std::move(y));
  }
  return reference;
}

}  // namespace bench
