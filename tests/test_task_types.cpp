// PROGRAM: tests_mechanisms
// Task rows (3) of parts of several frames and velocities, with springs, a rotor on a moving frame, a mass on the
// inlet.
#include "mechanism.hpp"

#include <iim/equations_of_motion.hpp>
#include <iim/subsystem/coupled_drive.hpp>
#include <iim/task.hpp>

namespace test_task_types {

using namespace iim;
using namespace iim::test;

TEST_CASE("task rows on every frame of a mechanism, and its momentum", "[task]")
{
  for (std::uint64_t seed = first_seed; seed < first_seed + 20; ++seed) {
    CAPTURE(seed);
    Random random(seed);
    MechanismParts parts = mechanism_robot(random);
    for (int k = 0; k < Mechanism::n_frames; ++k) {
      parts.add_frame("f" + std::to_string(k), {"second", random.rotation(), random.vector(0.3), k});
    }
    const DynamicTree tree(parts);
    using Tree = std::remove_const_t<decltype(tree)>;
    Inputs<Tree> inputs(tree);
    Tasks<Tree> tasks(tree, inputs);
    const Index motors = inputs.columns();
    for (int k = 0; k < Mechanism::n_frames; ++k) {
      const Vec3 point = random.vector(0.3);
      inputs.add_wrench("f" + std::to_string(k), point, Axes::body);
      tasks.add_frame("f" + std::to_string(k), point, Axes::body);
    }
    const Index momentum = tasks.add_momentum();
    const RandomState state = random_state(tree, inputs.columns(), random);
    Workspace<Tree> ws(tree);
    ImplicitInversion<Tree> method(tree, inputs);
    EquationsOfMotion<Tree> equations(tree, inputs);
    const auto fd = forward_dynamics(state.q, state.qd, ws);
    const auto affine = method(fd);
    const auto rows = tasks(fd, affine);
    REQUIRE(rows.ok());

    // A wrench does the work that the point's and the frame's velocities take of it.
    const auto of_motion = equations(fd);
    REQUIRE(of_motion.ok());
    const Index frames = 6 * Mechanism::n_frames;
    CHECK(difference(rows.J.topRows(frames), of_motion.B.rightCols(frames).transpose()) < recursive_tolerance);
    const double size = (rows.J.cwiseAbs() * affine.qdd0.cwiseAbs() + rows.Jdot_qd.cwiseAbs()).norm();
    CHECK((rows.J * affine.qdd0 + rows.Jdot_qd - rows.Vdot0).norm() < recursive_tolerance * size);

    // Motors, springs and what a rotor spins up are within the robot, which floats: gravity alone changes its momentum.
    const Index at = tasks.row(momentum);
    Vector6<double> weight = Vector6<double>::Zero();
    weight.head<3>() = tasks.mass() * tree.gravity();
    CHECK((rows.Vdot0.segment<6>(at) - weight).norm() < recursive_tolerance * size);
    const Eigen::MatrixXd by_motors = rows.J.middleRows<6>(at).cwiseAbs() * affine.Bhat.leftCols(motors).cwiseAbs();
    CHECK(rows.JB.block(at, 0, 6, motors).norm() < recursive_tolerance * by_motors.norm());
  }
}

TEST_CASE("momentum of rotors on every frame of a drive", "[task]")
{
  using Drive = Compound<Driven<HingeRow<double, 3>, 3>>;
  for (std::uint64_t seed = first_seed; seed < first_seed + 20; ++seed) {
    CAPTURE(seed);
    Random random(seed);
    Drive drive;
    for (std::size_t k = 0; k < 3; ++k) {
      drive.body[k] = random.body();
      drive.mechanism.axis[k] = random.axis();
      drive.mechanism.offset[k] = random.vector(0.3);
      drive.mechanism.motor[k] = random.motor();
      drive.mechanism.motor[k].armature = false;
      drive.mechanism.carrier[k] = static_cast<int>(k) - 1;
      for (Index d = 0; d < 3; ++d) {
        drive.mechanism.transmission(static_cast<Index>(k), d) = random.uniform(-20, 20);
      }
    }
    Assembly<FloatingBase<double>, Drive> parts;
    parts.add("base", {}, FloatingBase<double>{random.body()});
    parts.add("drive", {"base", random.rotation(), random.vector(0.4)}, drive);
    const DynamicTree tree(parts);
    using Tree = std::remove_const_t<decltype(tree)>;
    const Inputs<Tree> inputs(tree);
    Tasks<Tree> tasks(tree, inputs);
    tasks.add_momentum();
    const RandomState state = random_state(tree, inputs.columns(), random, 3);
    Workspace<Tree> ws(tree);
    ImplicitInversion<Tree> method(tree, inputs);
    const auto fd = forward_dynamics(state.q, state.qd, ws);
    const auto affine = method(fd);
    const auto rows = tasks(fd, affine);
    REQUIRE(rows.ok());
    Vector6<double> weight = Vector6<double>::Zero();
    weight.head<3>() = tasks.mass() * tree.gravity();
    const double size = (rows.J.cwiseAbs() * affine.qdd0.cwiseAbs() + rows.Jdot_qd.cwiseAbs()).norm();
    CHECK((rows.Vdot0 - weight).norm() < recursive_tolerance * size);
    CHECK(rows.JB.norm() < recursive_tolerance * (rows.J.cwiseAbs() * affine.Bhat.cwiseAbs()).norm());
  }
}

}  // namespace test_task_types
