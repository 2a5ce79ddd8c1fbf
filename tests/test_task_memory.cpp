// PROGRAM: tests_several
// Tasks in the cycle: no allocation and no exception while tasks and inputs are switched and a bad state passes by; and
// the same rows from the other updates of M̄*.
#include <iim/iim.hpp>
#include <iim/models.hpp>
#include <iim/task.hpp>

#include "catch.hpp"
#include "heap_counter.hpp"

#include <cmath>
#include <limits>
#include <type_traits>

namespace test_task_memory {

using namespace iim;
using namespace iim::test;

namespace {

VectorX<double> some(Index size, double phase)
{
  VectorX<double> x(size);
  for (Index k = 0; k < size; ++k) { x(k) = 0.4 * std::sin(phase + 1.7 * static_cast<double>(k)); }
  return x;
}

template <class TasksType>
void add_all(TasksType& tasks)
{
  for (const char* point : models::biped_contacts) { tasks.add_point(point); }
  tasks.add_com();
  tasks.add_frame("torso", {0.1, 0.2, 0.3}, Axes::body);
  tasks.add_momentum();
}

}  // namespace

TEST_CASE("tasks neither allocate nor throw in the cycle", "[task]")
{
  const DynamicTree tree(models::biped<double>());
  Inputs inputs(tree);
  for (const char* point : models::biped_contacts) { inputs.add_force(point); }
  Tasks tasks(tree, inputs);
  add_all(tasks);
  Workspace ws(tree);
  ImplicitInversion method(tree, inputs);
  VectorX<double> q = some(tree.n_q(), 0.3);
  q.segment<4>(3).normalize();
  const VectorX<double> qd = some(tree.n_v(), 1.2);
  VectorX<double> bad = q;
  bad(9) = std::numeric_limits<double>::infinity();

  Index rows_fewer = 0, columns_fewer = 0, alone = 0;
  Status first = Status::not_finite, wrong = Status::ok, again = Status::not_finite;
  const Calls calls = count([&] {
    {
      const auto fd = forward_dynamics(q, qd, ws);
      first = tasks(fd, method(fd)).status;
    }
    for (Index id = 0; id < tasks.blocks(); id += 2) { tasks.set_active(id, false); }
    for (Index id = 1; id < inputs.blocks(); id += 2) { inputs.set_active(id, false); }
    {
      const auto fd = forward_dynamics(q, qd, ws);
      const auto rows = tasks(fd, method(fd));
      rows_fewer = rows.JB.rows();
      columns_fewer = rows.JB.cols();
    }
    {
      const auto fd = forward_dynamics(bad, qd, ws);
      wrong = tasks(fd, method(fd)).status;
    }
    for (Index id = 0; id < tasks.blocks(); ++id) { tasks.set_active(id, true); }
    for (Index id = 0; id < inputs.blocks(); ++id) { inputs.set_active(id, true); }
    {
      const auto fd = forward_dynamics(q, qd, ws);
      again = tasks(fd, method(fd)).status;
      alone = tasks(fd).J.rows();
    }
  });
#ifndef IIM_COUNTS
  WARN("heap calls are not counted in this build");
#endif
  REQUIRE(calls.heap == 0);
  REQUIRE(calls.thrown == 0);
  REQUIRE(rows_fewer == 4 * 3 + 6);
  REQUIRE(columns_fewer == inputs.columns() - 7 - 4 * 3);
  REQUIRE(first == Status::ok);
  REQUIRE(wrong == Status::invalid_state);
  REQUIRE(again == Status::ok);
  REQUIRE(alone == tasks.max_rows());
}

TEST_CASE("task rows do not depend on how M̄* is reduced", "[task]")
{
  const DynamicTree tree(models::biped<double>());
  using Tree = std::remove_const_t<decltype(tree)>;
  const Inputs inputs(tree);
  VectorX<double> q = some(tree.n_q(), 0.3);
  q.segment<4>(3).normalize();
  const VectorX<double> qd = some(tree.n_v(), 1.2);

  Tasks tasks(tree, inputs), other_tasks(tree, inputs);
  add_all(tasks);
  add_all(other_tasks);
  Workspace ws(tree);
  Workspace<Tree, Update::square_root> other_ws(tree);
  const auto rows = tasks(forward_dynamics(q, qd, ws));
  const auto other = other_tasks(forward_dynamics(q, qd, other_ws));
  REQUIRE(rows.ok());
  REQUIRE(other.ok());
  // Kinematics are the same text; q̈₀ differs by the roundings of two ways to it, on a robot with gears of 80.
  const double eps = std::numeric_limits<double>::epsilon();
  REQUIRE((rows.J - other.J).norm() <= 20 * eps * rows.J.norm());
  REQUIRE((rows.Jdot_qd - other.Jdot_qd).norm() <= 20 * eps * rows.Jdot_qd.norm());
  REQUIRE((rows.Vdot0 - other.Vdot0).norm() <= 1000 * eps * rows.Vdot0.norm());
}

TEST_CASE("a bad state leaves nothing behind in rows that are switched off", "[task]")
{
  const DynamicTree tree(models::biped<double>());
  const Inputs inputs(tree);
  VectorX<double> q = some(tree.n_q(), 0.3);
  q.segment<4>(3).normalize();
  const VectorX<double> qd = some(tree.n_v(), 1.2);
  VectorX<double> bad = q;
  bad(9) = std::numeric_limits<double>::quiet_NaN();

  Tasks tasks(tree, inputs);
  tasks.add_frame("torso");
  const auto second = tasks.add_frame("left_toe");
  Workspace ws(tree);
  ImplicitInversion method(tree, inputs);
  const auto status = [&](const VectorX<double>& state) {
    const auto fd = forward_dynamics(state, qd, ws);
    return tasks(fd, method(fd)).status;
  };
  REQUIRE(status(bad) == Status::invalid_state);
  tasks.set_active(second, false);
  REQUIRE(status(q) == Status::ok);
  REQUIRE(status(bad) == Status::invalid_state);
  REQUIRE(status(q) == Status::ok);
  tasks.set_active(second, true);
  REQUIRE(status(q) == Status::ok);
}

}  // namespace test_task_memory
