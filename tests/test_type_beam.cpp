// PROGRAM: tests_types
// Flexible link as a beam: Euler and Bernoulli's frequencies and deflections, a rotating blade, a chain of fifty links.
#include "catch.hpp"
#include "type_robots.hpp"

#include <iim/law_suite.hpp>
#include <iim/subsystem/flexible_link.hpp>

#include <Eigen/Eigenvalues>

using namespace iim;
using namespace iim::test;

namespace {

/// Cantilever of 1 m, 1 kg/m, EI = 1 N m²: frequencies are the squares of the roots of cos β cosh β = −1.
template <int n>
FlexibleLink<Fixed<double>, n, 0> cantilever()
{
  FlexibleLink<Fixed<double>, n, 0> beam;
  beam.prepare("beam");
  return beam;
}

template <class Beam>
Eigen::VectorXd frequencies(const Beam& beam)
{
  const detail::Coordinates<Beam> q = detail::Coordinates<Beam>::Zero();
  const Eigen::MatrixXd M = detail::internal_inertia(beam, q).template bottomRightCorner<Beam::n_i, Beam::n_i>();
  const Eigen::MatrixXd K = beam.stiffness().asDiagonal();
  return Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd>(K, M, Eigen::EigenvaluesOnly)
      .eigenvalues()
      .cwiseSqrt();
}

/// Roots of cos β cosh β = −1, squared: Blevins, Formulas for Natural Frequency and Mode Shape, table 8-1.
const Eigen::Vector3d euler_bernoulli(1.87510407 * 1.87510407, 4.69409113 * 4.69409113, 7.85475744 * 7.85475744);

}  // namespace

TEST_CASE("Frequencies of a cantilever converge from above to those of Euler and Bernoulli")
{
  const Eigen::VectorXd f1 = frequencies(cantilever<1>()), f2 = frequencies(cantilever<2>()),
                        f3 = frequencies(cantilever<3>()), f4 = frequencies(cantilever<4>()),
                        f8 = frequencies(cantilever<8>());
  CHECK(std::abs(f1(0) / std::sqrt(20.0) - 1) < 100 * eps);  // Rayleigh's quotient of ξ²: 1 / (1/20)
  CHECK(f1(0) > f2(0));
  CHECK(f2(0) > f3(0));
  CHECK(f3(0) > f4(0));
  CHECK(f3(1) > f4(1));
  CHECK(f4(0) > euler_bernoulli(0) * (1 - 1e-8));  // the table has nine digits
  // Polynomials up to degree 9 against mode shapes of one, two and three half-waves.
  CHECK(std::abs(f8(0) / euler_bernoulli(0) - 1) < 1e-8);
  CHECK(std::abs(f8(1) / euler_bernoulli(1) - 1) < 1e-6);
  CHECK(std::abs(f8(2) / euler_bernoulli(2) - 1) < 1e-4);
  CHECK(f8(2) > euler_bernoulli(2));
}

TEST_CASE("A force on the tip bends a cantilever by FL³/3EI, a moment twists it by ML/GJ")
{
  FlexibleLink<Fixed<double>, 2, 3, 1> beam;
  beam.length = 0.7;
  beam.bending_y = 40;
  beam.bending_z = 90;
  beam.torsion = 15;
  beam.rotary_y = beam.rotary_z = 1e-3;
  Assembly<decltype(beam)> parts;
  parts.set_gravity(Vec3::Zero());
  const DynamicTree tree(parts.add("beam", {}, beam));
  Inputs inputs(tree);
  inputs.add_wrench("beam");
  Workspace ws(tree);
  Eigen::VectorXd q = Eigen::VectorXd::Zero(6), u(6);
  u << 0, 3e-6, 5e-6, 2e-6, 0, 0;
  // At rest where the spring forces K q balance the wrench: K q = Sᵀ wrench.
  const Vec3 lever(beam.length, 0, 0);
  REQUIRE(forward_dynamics(q, Eigen::VectorXd::Zero(6), ws).ok());
  Vector6<double> wrench = u;
  wrench.tail<3>() += lever.cross(u.head<3>());
  tree.visit(0, [&]<class N, class S>(const N& node, const S& s) {
    q = (ws.template node<S>(node).S_k[0].transpose() * wrench).cwiseQuotient(s.stiffness());
  });
  REQUIRE(forward_dynamics(q, Eigen::VectorXd::Zero(6), ws).ok());
  const Vec3 tip = ws.frame(0).r;
  const double cube = std::pow(beam.length, 3) / 3;
  // Second order in deflections of 1e-8 of the length is below ε.
  CHECK(std::abs(tip.y() / (3e-6 * cube / 40) - 1) < 1e-7);
  CHECK(std::abs(tip.z() / (5e-6 * cube / 90) - 1) < 1e-7);
  CHECK(std::abs(ws.frame(0).R(2, 1) / (2e-6 * beam.length / 15) - 1) < 1e-7);
  // And there it stays: accelerations are small against those of the unbalanced beam.
  const Eigen::VectorXd balanced = forward_dynamics(q, Eigen::VectorXd::Zero(6), inputs, u, ws).qdd;
  const Eigen::VectorXd loaded =
      forward_dynamics(Eigen::VectorXd::Zero(6), Eigen::VectorXd::Zero(6), inputs, u, ws).qdd;
  CHECK(balanced.norm() < 1e-6 * loaded.norm());
}

TEST_CASE("A rotating beam stiffens as published; without shortening it does not")
{
  // Flapping of a uniform beam without hub, first frequency in units of √(EI/ρAL⁴) for the rate Ω in the same units:
  // Wright, Smith, Thresher, Wang, Vibration Modes of Centrifugally Stiffened Beams, J. Appl. Mech. 49 (1982), table 2.
  const std::array<std::pair<double, double>, 6> published{
      {{0, 3.5160}, {1, 3.6816}, {2, 4.1373}, {4, 5.5850}, {8, 9.2568}, {12, 13.1702}}};
  using Beam = FlexibleLink<Revolute<double>, 0, 7>;
  for (const bool shortening : {true, false}) {
    Beam beam;
    beam.shortening = shortening;
    Assembly<Beam> parts;
    parts.set_gravity(Vec3::Zero());
    const DynamicTree tree(parts.add("blade", {}, beam));
    Workspace ws(tree);
    for (const auto& [rate, frequency] : published) {
      const auto stiffness_and_inertia = [&, rate = rate] {
        Eigen::MatrixXd K(7, 7), M;
        Eigen::VectorXd qd = Eigen::VectorXd::Zero(8);
        qd(0) = rate;
        for (Index j = 0; j < 7; ++j) {
          // −M q̈₀ is linear and cubic in the amplitudes; the hub is held by whatever torque it takes.
          const double small = 1e-4;
          Eigen::VectorXd q = Eigen::VectorXd::Zero(8), h[2];
          for (int side = 0; side < 2; ++side) {
            q(j + 1) = side == 0 ? small : -small;
            const Eigen::VectorXd qdd0 = forward_dynamics(q, qd, ws).qdd0();
            tree.visit(0, [&]<class N, class S>(const N& node, const S&) { M = ws.template node<S>(node).MbarR; });
            h[side] = -(M * qdd0);
          }
          K.col(j) = (h[0] - h[1]).tail(7) / (2 * small);
        }
        return std::pair(K, Eigen::MatrixXd(M.bottomRightCorner(7, 7)));
      };
      const auto [K, M] = stiffness_and_inertia();
      const Eigen::MatrixXd symmetric = (K + K.transpose()) / 2;
      const double found =
          std::sqrt(Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd>(symmetric, M, Eigen::EigenvaluesOnly)
                        .eigenvalues()(0));
      INFO("rate " << rate << ", found " << found << ", published " << frequency);
      if (shortening) {
        CHECK(std::abs(found - frequency) < 1e-4);  // the table's last digit, and 1e-5 for the differences
      } else {
        CHECK(std::abs(found - 3.5160) < 1e-4);
      }
    }
  }
}

TEST_CASE("A chain of fifty links with springs is a beam")
{
  // Hinges in the middle of 1/50 m of beam each, the first at the clamp with the stiffness of half a piece.
  constexpr int n = 50;
  constexpr double piece = 1.0 / n;
  using Parts = Assembly<RevoluteLink<double>>;
  Parts parts;
  parts.set_gravity(Vec3::Zero());
  for (int k = 0; k < n; ++k) {
    Body<double> body{piece, Vec3(piece / 2, 0, 0), Mat3::Zero(), false};
    body.inertia(1, 1) = body.inertia(2, 2) = piece * piece * piece / 12;
    const std::string before = k == 0 ? "world" : "link" + std::to_string(k - 1);
    parts.add("link" + std::to_string(k), {before, Mat3::Identity(), Vec3(k == 0 ? 0 : piece, 0, 0), 0},
              RevoluteLink<double>{{Vec3::UnitZ()}, body});
  }
  const DynamicTree chain(parts);
  const Eigen::MatrixXd M_inv = solve(chain, Inputs(chain), Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n)).Bhat;
  Eigen::VectorXd k = Eigen::VectorXd::Constant(n, 1 / piece);
  k(0) = 2 / piece;
  const Eigen::VectorXd root = k.cwiseSqrt();
  const Eigen::MatrixXd scaled = root.asDiagonal() * M_inv * root.asDiagonal();
  const Eigen::VectorXd f =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(scaled, Eigen::EigenvaluesOnly).eigenvalues().cwiseSqrt();
  const Eigen::VectorXd of_beam = frequencies(cantilever<8>());
  // A chain of n links errs by (mode/n)²: 1e-3 for the first two.
  CHECK(std::abs(f(0) / of_beam(0) - 1) < 1e-3);
  CHECK(std::abs(f(1) / of_beam(1) - 1) < 3e-3);
}
