// PROGRAM: tests_no_heap
// Nothing in the cycle allocates, frees or throws with subsystems that iterate, have springs, or several frames; nor in
// implicit steps, or in what an integrator calls.
#include "cycle.hpp"

#include <iim/subsystem/elastic_motor_arm.hpp>
#include <iim/subsystem/flexible_link.hpp>
#include <iim/subsystem/four_bar.hpp>
#include <iim/subsystem/parallel_ankle.hpp>

#include <cmath>
#include <cstddef>
#include <limits>

namespace test_cycle_no_heap_types {

using namespace iim;
using namespace iim::test;

namespace {

using Vec3 = Vector3<double>;
using Beam = FlexibleLink<Revolute<double>, 1, 1, 0>;
using Parts = Assembly<FloatingBase<double>, ElasticMotorArm<double>, FourBar<double>, ParallelAnkle<double>, Beam>;

Body<double> body(double mass)
{
  Body<double> b{mass, {0.02, 0.01, -0.1}, {}};
  b.inertia = Vec3(0.02, 0.02, 0.01).asDiagonal() * mass;
  return b;
}

Parts robot()
{
  Parts parts;
  parts.add("torso", {}, FloatingBase<double>{body(10)});
  ElasticMotorArm<double> hip;
  hip.joint.axis = Vec3::UnitX();
  hip.body = body(2);
  hip.motor.gear_ratio = 50;
  hip.motor.axial_inertia = 2e-5;
  hip.motor.axis = Vec3::UnitX();
  hip.stiffness = 400;
  parts.add("hip", {.parent = "torso", .p = {0, 0.1, -0.1}}, hip);
  FourBar<double> knee;
  knee.mechanism.plane = {Vec3::UnitY(), Vec3::UnitX()};
  knee.mechanism.ground = {0.0, 0.3};
  knee.mechanism.crank = 0.05;
  knee.mechanism.rocker = 0.06;
  knee.mechanism.coupler = std::hypot(0.01, 0.3);
  for (Body<double>& bar : knee.body) { bar = body(0.3); }
  parts.add("knee", {.parent = "hip", .p = {0, 0, -0.1}}, knee);
  ParallelAnkle<double> ankle;
  for (std::size_t k = 0; k < 2; ++k) {
    PushRod<double>& rod = ankle.mechanism.rod[k];
    const double y = k == 0 ? 0.04 : -0.04;
    rod.hinge = {0.01, y, k == 0 ? 0.25 : 0.18};
    rod.crank = {-0.07, 0, 0};
    rod.foot = {-0.05, y, 0.01};
    rod.rod = (rod.hinge + rod.crank - rod.foot).norm();
    rod.side = 1;
    rod.rod_mass = 0.15;
    rod.gear_ratio = 9;
    rod.rotor_inertia = 1e-4;
    ankle.body[k + 1] = body(0.1);
  }
  ankle.body[0] = body(0.9);
  parts.add("ankle", {.parent = "knee", .p = {0, 0, -0.3}, .outlet = 2}, ankle);
  Beam beam;
  beam.length = 0.8;
  beam.mass_per_length = 1.5;
  beam.bending_y = beam.bending_z = 30;
  beam.rotary_y = beam.rotary_z = 1e-3;
  parts.add("beam", {.parent = "torso", .p = {0, -0.1, 0}}, beam);
  return parts;
}

}  // namespace

TEST_CASE("nothing allocates or throws in the cycle of elastic, closed and flexible parts")
{
  const DynamicTree tree(robot());
  Inputs inputs(tree);
  inputs.add_wrench("ankle");
  Workspace ws(tree);
  ImplicitInversion method(tree, inputs);
  VectorX<double> q = neutral(tree), bad = q, rate(tree.n_q());
  bad(tree.node("knee").q) = std::numeric_limits<double>::quiet_NaN();
  const VectorX<double> qd = VectorX<double>::Constant(tree.n_v(), 0.3), u = VectorX<double>::Ones(inputs.columns());
  Status pass, both, with_u, step, step_of_method, wrong, again;
  in_cycle("passes, implicit steps, steps of an integrator", [&] {
    pass = forward_dynamics(q, qd, ws).status();
    both = method(q, qd, ws).status;
    with_u = forward_dynamics(q, qd, inputs, u, ws).status;
    const auto fd = implicit_step(q, qd, 1e-3, ws);
    step = fd.status();
    step_of_method = method(fd).status;
    wrong = method(bad, qd, ws).status;
    coordinate_rate(tree, q, qd, rate);
    q += 1e-3 * rate;
    normalize(tree, q);
    again = method(q, qd, ws).status;
  });
  for (const Status good : {pass, both, with_u, step, step_of_method, again}) { CHECK(good == Status::ok); }
  CHECK(wrong == Status::invalid_state);
}

}  // namespace test_cycle_no_heap_types
