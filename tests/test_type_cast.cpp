// PROGRAM: tests_types
// A robot that is cast to another Scalar and back is the same: cast() of a type keeps each of its parameters, none of
// which is what it is if not set.
#include "catch.hpp"
#include "type_robots.hpp"

#include <iim/subsystem/coupled_drive.hpp>
#include <iim/subsystem/elastic_motor_arm.hpp>
#include <iim/subsystem/flexible_link.hpp>
#include <iim/subsystem/four_bar.hpp>
#include <iim/subsystem/joint_more.hpp>
#include <iim/subsystem/parallel_ankle.hpp>
#include <iim/subsystem/slider_crank.hpp>
#include <iim/subsystem/sprung.hpp>

namespace test_type_cast {

using namespace iim;
using namespace iim::test;

namespace {

/// base – part – load on the last of its frames: B̂ and q̈₀ of a step.
template <class S>
void keeps_all(const std::string& name, const S& part, Random& random)
{
  CAPTURE(name);
  using Link = RevoluteLink<double>;
  Assembly<Link, S> parts;
  parts.add("base", {}, Link{{random.unit()}, random.body()});
  parts.add("part", random_attachment(random, "base"), part);
  parts.add("load", random_attachment(random, "part", S::n_frames - 1), Link{{random.unit()}, random.body()});
  parts.set_gravity(random.vector(10));
  const DynamicTree tree(parts);
  const DynamicTree there_and_back(parts.template cast<long double>().template cast<double>());
  Eigen::VectorXd q = neutral(tree), qd(tree.n_v());
  for (Index v = 0; v < tree.n_v(); ++v) { qd(v) = random.uniform(-1, 1); }
  Eigen::VectorXd rate(tree.n_q());
  coordinate_rate(tree, q, qd, rate);
  q += 0.2 * rate;
  normalize(tree, q);
  const auto results = [&](const auto& on) {
    const Inputs inputs(on);
    Workspace ws(on);
    ImplicitInversion method(on, inputs);
    const auto result = method(implicit_step(q, qd, 0.01, ws));
    REQUIRE(result.ok());
    Eigen::MatrixXd all(on.n_v(), 1 + inputs.columns());
    all << result.qdd0, result.Bhat;
    return all;
  };
  CHECK(relative_error(results(there_and_back), results(tree)) < 1e-9);
}

Plane<double> plane_of(Random& random)
{
  Plane<double> plane;
  plane.normal = random.unit();
  plane.x = plane.normal.cross(random.unit()).normalized();
  return plane;
}

template <class C>
C with_bodies(C part, Random& random)
{
  for (Body<double>& body : part.body) { body = random.body(); }
  return part;
}

}  // namespace

TEST_CASE("A robot cast to another Scalar is the same: joints, springs and drives")
{
  Random random(81);
  keeps_all("helical", HelicalLink<double>{{random.unit(), 0.3}, random.body()}, random);
  keeps_all("cylindrical", CylindricalLink<double>{{random.unit()}, random.body()}, random);
  keeps_all("universal", UniversalLink<double>{{random.unit(), random.unit()}, random.body()}, random);
  const Plane<double> plane = plane_of(random);
  keeps_all("planar", PlanarLink<double>{{plane.normal, plane.x}, random.body()}, random);
  keeps_all("spherical", SphericalLink<double>{{}, random.body()}, random);

  Motor<double> motor = random.motor(0);
  motor.mass = 0.6;
  motor.com = random.vector(0.3);
  motor.transverse_inertia = motor.axial_inertia * 0.8;
  for (const bool armature : {false, true}) {
    motor.armature = armature;
    keeps_all("motor-arm", MotorArm<double>{{random.unit()}, random.body(), motor}, random);
    keeps_all("elastic motor-arm", ElasticMotorArm<double>{{random.unit()}, random.body(), motor, 70, 2}, random);
  }
  Sprung<MotorArm<double>> sprung{{{random.unit()}, random.body(), motor}};
  sprung.stiffness << 30;
  sprung.damping << 4;
  sprung.rest << 0.7;
  keeps_all("sprung", sprung, random);

  auto drive = with_bodies(DifferentialDrive<double>{}, random);
  for (std::size_t k = 0; k < 2; ++k) {
    drive.mechanism.axis[k] = random.axis();
    drive.mechanism.offset[k] = random.vector(0.3);
    drive.mechanism.motor[k] = random.motor(0);
  }
  drive.mechanism.carrier = {-1, 0};
  drive.mechanism.transmission << 10, 7, 3, -12;
  keeps_all("drive", drive, random);
}

TEST_CASE("A robot cast to another Scalar is the same: loops and beams")
{
  Random random(82);
  keeps_all("four-bar", with_bodies(FourBar<double>{{plane_of(random), {0.5, 0.1}, 0.2, 0.45, 0.3, -1}}, random),
            random);
  keeps_all("parallelogram", with_bodies(Parallelogram<double>{{plane_of(random), {0.5, 0.1}, 0.2}}, random), random);
  keeps_all("slider-crank", with_bodies(SliderCrank<double>{{plane_of(random), 0.3, 0.6, 0.1, -1}}, random), random);
  keeps_all("lever", with_bodies(ActuatedLever<double>{{plane_of(random), {0.25, 0.1}, {0.05, 0.08}, 40}}, random),
            random);

  ParallelAnkle<double> ankle;
  ankle.mechanism.first = Vec3(0.1, 1, 0).normalized();
  ankle.mechanism.second = Vec3(1, 0, 0.2).normalized();
  for (std::size_t k = 0; k < 2; ++k) {
    auto& r = ankle.mechanism.rod[k];
    const double y = k == 0 ? 0.04 : -0.04, side = k == 0 ? 1 : -1;
    r.hinge = Vec3(0.01, y, k == 0 ? 0.25 : 0.18);
    r.axis = (Vec3::UnitY() + random.vector(0.1)).normalized();
    r.crank = 0.07 * (-side * Vec3::UnitX() + side * r.axis * r.axis.x()).normalized();
    r.foot = Vec3(-0.05 * side, y, 0.01);
    r.rod = (r.hinge + r.crank - r.foot).norm();
    r.side = side;
    r.rod_mass = 0.3;
    r.gear_ratio = 8;
    r.rotor_inertia = 5e-4;
  }
  for (std::size_t k = 0; k < 3; ++k) { ankle.body[k] = random.body(); }
  keeps_all("ankle", ankle, random);

  FlexibleLink<Revolute<double>, 2, 1, 1> beam;
  beam.joint.axis = random.unit();
  beam.length = 0.8;
  beam.mass_per_length = 1.5;
  beam.bending_y = 30;
  beam.bending_z = 50;
  beam.torsion = 20;
  beam.rotary_y = 1e-3;
  beam.rotary_z = 2e-3;
  beam.damping = 0.01;
  beam.shortening = false;
  keeps_all("beam", beam, random);
}

}  // namespace test_type_cast
