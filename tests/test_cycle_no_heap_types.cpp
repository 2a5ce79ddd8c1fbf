// PROGRAM: tests_no_heap
// Nothing in the cycle allocates, frees or throws with subsystems that iterate, have springs, or several frames; nor in
// implicit steps, or in what an integrator calls.
#include "cycle.hpp"

#include "../examples/legged_machine.hpp"

#include <iim/subsystem/flexible_link.hpp>

#include <limits>

namespace test_cycle_no_heap_types {

using namespace iim;
using namespace iim::test;

namespace {

using Vec3 = Vector3<double>;
using Beam = FlexibleLink<Revolute<double>, 1, 1, 0>;
using Parts = Assembly<FloatingBase<double>, ElasticMotorArm<double>, FourBar<double>, ParallelAnkle<double>, Beam>;

/// A leg of the legged machine, and a flexible link.
Parts robot()
{
  const Body<double> link = legged::body(2, {0.02, 0.01, -0.1}, {0.04, 0.04, 0.02});
  Parts parts;
  parts.add("torso", {}, FloatingBase<double>{link})
      .add("hip", {.parent = "torso", .p = {0, 0.1, -0.1}}, legged::hip(Vec3::UnitX(), link))
      .add("knee", {.parent = "hip", .p = {0, 0, -0.1}}, legged::knee())
      .add("ankle", {.parent = "knee", .p = {0, 0, -0.3}, .outlet = 2}, legged::ankle());
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
