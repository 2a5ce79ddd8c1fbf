// PROGRAM: tests_types
// Flexible link: the laws, and the rigid link that it is when held straight.
#include "catch.hpp"
#include "type_robots.hpp"

#include <iim/law_suite.hpp>
#include <iim/subsystem/flexible_link.hpp>
#include <iim/subsystem/joint_more.hpp>

using namespace iim;
using namespace iim::test;

namespace {

using Flexible = FlexibleLink<Revolute<double>, 2, 1, 1>;

Flexible random_beam(Random& random)
{
  Flexible beam;
  beam.joint.axis = random.unit();
  beam.length = 0.8;
  beam.mass_per_length = 1.5;
  beam.bending_y = 30;
  beam.bending_z = 50;
  beam.torsion = 20;
  beam.rotary_y = 1e-3;
  beam.rotary_z = 2e-3;
  beam.damping = 0.01;
  return beam;
}

}  // namespace

TEST_CASE("A flexible link obeys the laws, with large deflections and shortening")
{
  Random random(71);
  LawOptions<Flexible> options;
  options.range = 0.3;
  options.explicit_part = 1e-6;
  const LawReport report = check_laws(random_beam(random), options);
  INFO(report.text());
  CHECK(report.ok());
  CHECK(report.laws.size() == 13);
}

TEST_CASE("So does one on a joint that slides, whose motion is given about its own origin")
{
  FlexibleLink<Planar<double>, 1, 1> beam;
  beam.rotary_y = 1e-3;
  beam.rotary_z = 2e-3;
  const LawReport report = check_laws(beam);
  INFO(report.text());
  CHECK(report.ok());
}

TEST_CASE("A beam held straight is a rigid link")
{
  Random random(72);
  for (int k = 0; k < 20; ++k) {
    Flexible beam = random_beam(random);
    Body<double> rod{beam.mass_per_length * beam.length, Vec3(beam.length / 2, 0, 0), Mat3::Zero(), false};
    const double across = rod.mass * beam.length * beam.length / 12;
    rod.inertia.diagonal() << beam.length * (beam.rotary_y + beam.rotary_z), beam.length * beam.rotary_y + across,
        beam.length * beam.rotary_z + across;
    using Parts = Assembly<Flexible, RevoluteLink<double>>;
    const RevoluteLink<double> base{{random.unit()}, random.body()}, load{{random.unit()}, random.body()};
    const Attachment<double> on = random_attachment(random, "base"), load_on = random_attachment(random, "link");
    const auto flexible = [&](double damping) {
      beam.damping = damping;
      Parts parts;
      return DynamicTree(parts.add("base", {}, base).add("link", on, beam).add("load", load_on, load));
    };
    Parts parts;
    parts.add("base", {}, base).add("link", on, RevoluteLink<double>{beam.joint, rod});
    const DynamicTree rigid(parts.add("load", {"link", load_on.R, load_on.p + Vec3(beam.length, 0, 0), 0}, load));
    const auto free = flexible(0), damped = flexible(1);
    const RandomState state = random_state(rigid, 0, random, 2);
    Eigen::VectorXd q = Eigen::VectorXd::Zero(7), qd = q;
    q << state.q.head(2), Eigen::Vector4d::Zero(), state.q(2);
    qd << state.qd.head(2), Eigen::Vector4d::Zero(), state.qd(2);
    // What a generalised force on each amplitude does: that of the damper at unit rate, over its stiffness.
    Workspace ws(free), damped_ws(damped);
    Eigen::MatrixXd effect(7, 4);
    beam.prepare("beam");
    for (Index j = 0; j < 4; ++j) {
      const Eigen::VectorXd rate = Eigen::VectorXd::Unit(7, 2 + j);
      effect.col(j) = (forward_dynamics(q, rate, ws).qdd0() - forward_dynamics(q, rate, damped_ws).qdd0()) /
                      beam.stiffness()(1 + j);
    }
    const auto inputs_of = [](const auto& tree) {
      Inputs inputs(tree);
      inputs.add_wrench("load");
      return inputs;
    };
    const Answer x = solve(free, inputs_of(free), q, qd), y = solve(rigid, inputs_of(rigid), state.q, state.qd);
    Eigen::MatrixXd held(7, 10), expected(3, 10);
    held << x.qdd0, x.Bhat;
    expected << y.qdd0, y.Bhat;
    held -= Eigen::MatrixXd(effect * effect.middleRows(2, 4).partialPivLu().solve(held.middleRows(2, 4)));
    Eigen::MatrixXd rows(3, 10);
    rows << held.topRows(2), held.bottomRows(1);
    // Amplitudes accelerate by up to 1e5 of what is left of them.
    CHECK(relative_error(rows, expected) < 1e7 * eps);
  }
}

namespace {

/// A hinge at the coupling point with an arm: S is about that point, not about the frame's origin, which moves.
struct HingedArm {
  using Scalar = double;
  static constexpr int n_q = 1, n_i = 1;
  static constexpr MotionPattern pattern{.linear = false, .bias = false};

  Revolute<double> hinge{};
  Vec3 arm = Vec3::Zero();

  void prepare(const std::string& owner) { hinge.prepare(owner); }
  bool motion(const Mat3& R, const Eigen::Matrix<double, 1, 1>& q, const Eigen::Matrix<double, 1, 1>& qd,
              FrameMotion<double, 1>& m) const
  {
    const bool ok = hinge.motion(R, q, qd, m);
    m.r = m.R * arm;
    return ok;
  }
};

}  // namespace

TEST_CASE("And one on a joint whose frame is off the coupling point that its motion is given about")
{
  Random random(73);
  FlexibleLink<HingedArm, 1, 1> beam;
  beam.joint.hinge.axis = random.unit();
  beam.joint.arm = random.vector(0.3);
  beam.rotary_y = 1e-3;
  beam.rotary_z = 2e-3;
  const LawReport report = check_laws(beam);
  INFO(report.text());
  CHECK(report.ok());
}
