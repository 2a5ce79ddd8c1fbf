// PROGRAM: tests_types
// The law suite finds what is wrong with a type: one defect each, in the seventh digit.
#include "catch.hpp"
#include "type_robots.hpp"

#include <iim/law_suite.hpp>
#include <iim/subsystem/joint_more.hpp>

#include <algorithm>

using namespace iim;
using namespace iim::test;

namespace {

enum class Defect {
  none,
  slow_frame,
  no_bias,
  world_bound,
  asymmetric_spring,
  leak,
  light,
  unknown_spring,
  unknown_damper,
  off_centre
};

/// A sprung universal joint with a rotor, and a defect.
struct Suspect {
  using Scalar = double;
  static constexpr int n_q = 2, n_i = 2, n_u = 2, n_frames = 1;
  static constexpr MotionPattern pattern{.linear = false, .offset = false};

  Universal<double> joint{};
  Body<double> body{};
  Defect defect = Defect::none;

  void prepare(const std::string& name) { joint.prepare(name); }
  bool motion(const Mat3& R, const Eigen::Vector2d& q, const Eigen::Vector2d& qd,
              std::array<FrameMotion<double, 2>, 1>& frames) const
  {
    const bool ok = joint.motion(R, q, qd, frames[0]);
    if (defect == Defect::slow_frame) { frames[0].S *= 1 - 1e-7; }
    if (defect == Defect::no_bias) { frames[0].bias *= 1 - 1e-7; }
    if (defect == Defect::world_bound) { frames[0].S(5, 0) += 1e-7; }
    if (defect == Defect::off_centre) { frames[0].r(1) = 1e-7; }
    return ok;
  }
  std::array<CarriedBody<double>, 1> bodies() const { return {{{0, body}}}; }
  std::array<Rotor<double, 2>, 1> rotors() const { return {{{-1, Vec3::UnitZ(), 1e-3, {30, 10}, true}}}; }
  Eigen::Matrix2d Bbar(const Eigen::Vector2d&) const { return Eigen::Matrix2d::Identity(); }
  double potential(const Eigen::Vector2d& q) const { return 2 * q.squaredNorm(); }
  double dissipation(const Eigen::Vector2d&, const Eigen::Vector2d& qd) const { return 0.3 * qd.squaredNorm(); }
  Eigen::Vector2d internal_force(const Eigen::Vector2d& q, const Eigen::Vector2d& qd) const
  {
    Eigen::Vector2d force = 4 * q + 0.3 * qd;
    if (defect == Defect::asymmetric_spring) { force(0) += 1e-6 * q(1); }
    if (defect == Defect::leak) { force -= 1e-6 * qd; }
    return force;
  }
  std::array<Spring<double, 2>, 2> springs(const Eigen::Vector2d&, const Eigen::Vector2d&) const
  {
    const double k = defect == Defect::unknown_spring ? 0 : 4, d = defect == Defect::unknown_damper ? 0 : 0.3;
    return {{{{1, 0}, 4, 0.3}, {{0, 1}, k, d}}};
  }
};

std::vector<std::string> broken(const LawReport& report)
{
  std::vector<std::string> names;
  for (const LawResult& l : report.laws) {
    if (!l.ok()) { names.push_back(l.law); }
  }
  return names;
}

LawReport report_of(Defect defect)
{
  Random random(3);
  Suspect suspect{{}, random.body(), defect};
  if (defect == Defect::light) {  // a body that the rotor's motion alone moves
    suspect.body = Body<double>::massless();
  }
  return check_laws(suspect);
}

struct Checks : iim::detail::LawChecks {
  using LawChecks::negative_part;
};

}  // namespace

TEST_CASE("A sound type obeys the laws, a defective one does not")
{
  const LawReport sound = report_of(Defect::none);
  INFO(sound.text());
  CHECK(sound.ok());
  CHECK(sound.laws.size() == 13);

  CHECK(broken(report_of(Defect::asymmetric_spring)) == std::vector<std::string>{"stored energy"});
  CHECK(broken(report_of(Defect::leak)) == std::vector<std::string>{"stored energy"});
  const auto has = [](Defect defect, const std::string& law) {
    const auto names = broken(report_of(defect));
    return std::find(names.begin(), names.end(), law) != names.end();
  };
  CHECK(has(Defect::slow_frame, "velocity"));
  CHECK(has(Defect::slow_frame, "recursion"));
  CHECK(has(Defect::no_bias, "acceleration"));
  CHECK(has(Defect::no_bias, "recursion"));
  CHECK(has(Defect::world_bound, "velocity"));
  CHECK(has(Defect::world_bound, "invariance"));
  CHECK(has(Defect::light, "inertia"));
  CHECK(has(Defect::off_centre, "motion pattern"));
  CHECK(broken(report_of(Defect::unknown_spring)) == std::vector<std::string>{"springs"});
  CHECK(broken(report_of(Defect::unknown_damper)) == std::vector<std::string>{"springs"});

  LawOptions<Suspect> beyond;
  beyond.coordinates = [](const auto&) { return Eigen::Vector2d(std::numeric_limits<double>::quiet_NaN(), 0); };
  const LawReport none = check_laws(Suspect{{}, Random(3).body()}, beyond);
  CHECK(!none.ok());
  CHECK(none.text().find("invalid state") != std::string::npos);
}

TEST_CASE("The law of inertia sees how far eigenvalues are below zero")
{
  // Q diag(λ) Qᵀ with a rotation Q by no special angles
  const Eigen::Matrix3d Q = Eigen::AngleAxisd(0.7, Vec3(1, 2, -3).normalized()).toRotationMatrix();
  const auto part = [&](double a, double b, double c) {
    const Eigen::Matrix3d A = Q * Vec3(a, b, c).asDiagonal() * Q.transpose();
    return Checks::negative_part((A + A.transpose()) / 2);
  };
  CHECK(part(1, 2, 3) == 0);
  CHECK(part(1, 0, 3) < 1e-14);
  for (const double least : {1e-12, 1e-6, 0.1}) {
    INFO(least);
    const double expected = least / (3 - least);
    CHECK(part(1, 2, -least) > 0.9 * expected);
    CHECK(part(1, 2, -least) < 2.2 * expected);
  }
  CHECK(part(-1, -2, -3) > 1);
}

namespace {

/// Writes a bias that its pattern, a hinge's, says there is none of.
struct StrayBias : RevoluteLink<double> {
  bool motion(const Mat3& R, const Eigen::Matrix<double, 1, 1>& q, const Eigen::Matrix<double, 1, 1>& qd,
              std::array<FrameMotion<double, 1>, 1>& frames) const
  {
    const bool ok = RevoluteLink<double>::motion(R, q, qd, frames);
    frames[0].bias(4) = 1e-7;
    return ok;
  }
};

}  // namespace

TEST_CASE("A bias that the motion pattern denies is seen")
{
  Random random(4);
  StrayBias link;
  link.joint.axis = random.unit();
  link.body = random.body();
  CHECK(broken(check_laws(link)) == std::vector<std::string>{"motion pattern"});
}
