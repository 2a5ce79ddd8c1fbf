// PART OF: iim_accuracy
// REQUIRES: boost
// The reference in 80 digits, and what one ε of double in the data does to the result.
#include "accuracy.hpp"


#include <boost/multiprecision/cpp_bin_float.hpp>

#include <algorithm>
#include <limits>
#include <random>
#include <variant>

namespace bench {

namespace {

using Digits = boost::multiprecision::number<boost::multiprecision::cpp_bin_float<80>, boost::multiprecision::et_off>;
using Parts = iim::StandardAssembly<Digits>;

struct Values {
  iim::VectorX<Digits> qdd0;
  iim::MatrixX<Digits> Bhat;
  iim::Status status;
};

Values values_of(const AccuracyScene& scene, const Parts& parts, const State<Digits>& x)
{
  const Tree<Digits> tree(parts);
  const auto inputs = accuracy_inputs(scene, tree);
  iim::Workspace<Tree<Digits>, iim::Update::printed> workspace(tree);
  iim::ImplicitInversion<Tree<Digits>> method(tree, inputs);
  const auto result = method(iim::forward_dynamics(x.q, x.qd, workspace));
  return {result.qdd0, result.Bhat, result.status};
}

/// Every length, mass, inertia and gear ratio times 1 + ε ξ, every axis turned by angles ε ξ; ξ uniform in (−1, 1).
Parts perturbed(const Parts& parts, std::mt19937_64& source)
{
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const auto move = [&](auto& x) { x *= Digits(1) + Digits(std::numeric_limits<double>::epsilon() * uniform(source)); };
  const auto move_body = [&](iim::Body<Digits>& body) {
    if (body.is_massless) { return; }
    move(body.mass);
    for (int i = 0; i < 3; ++i) {
      move(body.com(i));
      for (int j = i; j < 3; ++j) {
        move(body.inertia(i, j));
        body.inertia(j, i) = body.inertia(i, j);
      }
    }
  };
  Parts other;
  for (const auto& part : parts.parts()) {
    auto on = part.on;
    for (int i = 0; i < 3; ++i) { move(on.p(i)); }
    const iim::Vector3<Digits> turn(uniform(source), uniform(source), uniform(source));
    on.R += iim::Matrix3<Digits>(iim::skew(turn) * on.R) * Digits(std::numeric_limits<double>::epsilon());
    std::visit(
        [&](auto s) {
          move_body(s.body);
          if constexpr (requires { s.motor; }) {
            move(s.motor.gear_ratio);
            move(s.motor.axial_inertia);
          }
          other.add(part.name, on, s);
        },
        part.part);
  }
  for (const auto& frame : parts.named_frames()) { other.add_frame(frame.name, frame.on); }
  other.set_gravity(parts.gravity());
  return other;
}

double relative(const iim::MatrixX<Digits>& a, const iim::MatrixX<Digits>& b)
{
  const Digits size = b.norm();
  return size > 0 ? static_cast<double>(Digits((a - b).norm() / size)) : 0.0;
}

}  // namespace

AccuracyReference accuracy_reference(const AccuracyScene& scene)
{
  AccuracyReference reference;
  const Parts parts = scene.parts.cast<Digits>();
  std::mt19937_64 source(2026);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (std::size_t k = 0; k < scene.states.size(); ++k) {
    const State<Digits> x = scene.states[k].cast<Digits>();
    const Values exact = values_of(scene, parts, x);
    if (exact.status != iim::Status::ok) {
      reference.failure = iim::to_string(exact.status);
      return reference;
    }
    reference.values.push_back({Precise(exact.qdd0), Precise(exact.Bhat)});
    if (k < 3) {
      State<Digits> moved = x;
      for (Index i = 0; i < moved.q.size(); ++i) {
        moved.q(i) *= Digits(1) + Digits(std::numeric_limits<double>::epsilon() * uniform(source));
      }
      const Values other = values_of(scene, perturbed(parts, source), moved);
      reference.Bhat_sensitivity = std::max(reference.Bhat_sensitivity, relative(other.Bhat, exact.Bhat));
      reference.qdd0_sensitivity = std::max(reference.qdd0_sensitivity, relative(other.qdd0, exact.qdd0));
    }
  }
  return reference;
}

}  // namespace bench
