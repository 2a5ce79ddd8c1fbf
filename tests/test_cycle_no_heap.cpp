// PROGRAM: tests_no_heap
// Nothing in the cycle allocates, frees or throws, whatever the method: trees read at run time.
#include "cycle.hpp"

#include <iim/equations_of_motion.hpp>

#include <cstdlib>
#include <type_traits>

namespace test_cycle_no_heap {

using namespace iim;
using namespace iim::test;

#ifdef IIM_COUNTS

TEST_CASE("the counters see an allocation and a throw")
{
  void* volatile memory = nullptr;
  CHECK(count([&] { memory = std::malloc(100); }).heap == 1);
  CHECK(count([&] { memory = std::realloc(memory, 200); }).heap == 1);
  CHECK(count([&] { std::free(memory); }).heap == 1);
  CHECK(count([&] { memory = std::calloc(3, 7); }).heap == 1);
  CHECK(count([&] { std::free(memory); }).heap == 1);
  CHECK(count([&] { memory = std::aligned_alloc(64, 640); }).heap == 1);
  CHECK(count([&] { std::free(memory); }).heap == 1);
  void* aligned = nullptr;
  CHECK(count([&] { (void)posix_memalign(&aligned, 64, 640); }).heap == 1);
  CHECK(count([&] { std::free(aligned); }).heap == 1);
  CHECK(count([&] { memory = ::operator new(10); }).heap == 1);
  CHECK(count([&] { ::operator delete(memory); }).heap == 1);
  Index rows = 30;
  CHECK(count([&] { MatrixX<double>(rows, rows).setZero(); }).heap >= 2);  // Eigen asks malloc, not operator new
  CHECK(count([&] {
          try {
            throw ModelError("deliberate");
          } catch (const ModelError&) {
          }
        }).thrown == 1);
}

#else

TEST_CASE("the counters are off")
{
  WARN("a sanitizer or the C library brings its own malloc: heap calls and throws are not counted in this build");
}

#endif

/// Implicit inversion in a form of one's choice.
template <class Tree>
struct Form : ImplicitInversion<Tree> {
  Form(const Tree& tree, const Inputs<Tree>& inputs, bool product)
      : ImplicitInversion<Tree>(tree, inputs, product ? 0 : inputs.max_columns() + 1)
  {
  }
};

TEST_CASE("nothing allocates or throws in the cycle")
{
  const DynamicTree tree(robot());
  using Tree = std::remove_const_t<decltype(tree)>;
  Inputs<Tree> inputs = robot_inputs(tree);
  Workspace ws(tree);
  check_forward_dynamics(tree, inputs, ws);
  check_workspace_methods(tree, inputs, ws);
  check_method<UnitForce<Tree, 1>>("unit forces one by one", tree, inputs, ws, ToReceipt{});
  check_method<GlobalInverse<Tree, Factorization::dense>>("global inverse, dense", tree, inputs, ws, ToReceipt{});
  EquationsOfMotion equations(tree, inputs);
  const VectorX<double> at = neutral(tree), rate = VectorX<double>::Ones(tree.n_v());
  Status status = Status::mismatch;
  in_cycle("equations of motion", [&] { status = equations(at, rate, ws).status; });
  CHECK(status == Status::ok);
  check_method<UnitForcePublished<Tree>>(
      "unit forces as published", tree, inputs, ws,
      [](auto& method, const auto& fd, const auto& q, const auto& qd) { return method(fd, q, qd); });
  check_method<GlobalInverse<Tree>>(
      "global inverse without the O(n) pass", tree, inputs, ws,
      [&](auto& method, const auto&, const auto& q, const auto& qd) { return method(q, qd, ws); });
}

TEST_CASE("nor in copies of methods that were made while an input was off")
{
  const DynamicTree tree(robot());
  using Tree = std::remove_const_t<decltype(tree)>;
  Inputs<Tree> inputs = robot_inputs(tree);
  Workspace ws(tree);
  const VectorX<double> q = neutral(tree), qd = VectorX<double>::Ones(tree.n_v());
  for (const bool product : {false, true}) {
    Form<Tree> method(tree, inputs, product);
    for (Index id = 0; id < inputs.blocks(); ++id) { inputs.set_active(id, false); }
    REQUIRE(method(q, qd, ws).ok());
    Form<Tree> copy = method;
    Index columns = 0;
    in_cycle("a copy", [&] {
      for (Index id = 0; id < inputs.blocks(); ++id) { inputs.set_active(id, true); }
      columns = copy(q, qd, ws).Bhat.cols();
    });
    CHECK(columns == inputs.max_columns());
  }
}

TEST_CASE("nor in workspaces that were copied, moved or assigned to")
{
  const DynamicTree tree(robot(1e5));
  using Tree = std::remove_const_t<decltype(tree)>;
  Inputs<Tree> inputs = robot_inputs(tree);
  ImplicitInversion method(tree, inputs);
  const VectorX<double> q = coordinates(tree.n_q(), 0.3), qd = VectorX<double>::Ones(tree.n_v());
  const VectorX<double> u = VectorX<double>::Ones(inputs.columns());
  Workspace first(tree), assigned(tree);
  const VectorX<double> expected = method(q, qd, first).qdd0;
  Workspace copy(first), moved(Workspace<Tree>{tree});
  assigned = copy;
  for (Workspace<Tree>* ws : {&copy, &moved, &assigned}) {
    VectorX<double> qdd0(tree.n_v());
    in_cycle("a workspace that was copied, moved or assigned to", [&] {
      (void)forward_dynamics(q, qd, inputs, u, *ws);
      qdd0 = method(q, qd, *ws).qdd0;
    });
    CHECK(qdd0 == expected);
  }
}

TEST_CASE("nor on a large robot, where libraries block their products")
{
  const Index n = 400;
  const DynamicTree tree(models::chain<double>(n));
  using Tree = std::remove_const_t<decltype(tree)>;
  Inputs<Tree> inputs(tree, Start::empty);
  for (Index i = 0; i < n; i += 8) { inputs.add_motor(tree.name(i)); }
  inputs.add_wrench(tree.name(n - 1));
  Workspace ws(tree);
  RecursiveInverse<Tree> recursive(tree, inputs);
  GlobalInverse<Tree, Factorization::dense> dense(tree, inputs);
  const VectorX<double> q = VectorX<double>::LinSpaced(n, -1, 1), qd = VectorX<double>::Ones(n);
  Status by_recursion = Status::not_finite, by_cholesky = Status::not_finite;
  in_cycle("chain of 400", [&] {
    const auto fd = forward_dynamics(q, qd, ws);
    by_recursion = recursive(fd).status;
    by_cholesky = dense(fd).status;
  });
  CHECK(by_recursion == Status::ok);
  CHECK(by_cholesky == Status::ok);
}

TEST_CASE("a matrix that is not positive definite is a status, not an exception")
{
  auto assembly = models::chain<double>(3);
  Attachment<double> on;
  on.parent = "link2";
  on.p.z() = -1;
  RevoluteLink<double> massless = models::link<double>();
  massless.body = Body<double>::massless();
  assembly.add("massless", on, massless);
  const DynamicTree tree(assembly);
  using Tree = std::remove_const_t<decltype(tree)>;
  const Inputs<Tree> inputs(tree);
  Workspace ws(tree);
  ImplicitInversion<Tree> implicit_inversion(tree, inputs);
  GlobalInverse<Tree> sparse(tree, inputs);
  GlobalInverse<Tree, Factorization::dense> dense(tree, inputs);
  const VectorX<double> q = VectorX<double>::Constant(4, 0.3), qd = VectorX<double>::Constant(4, 0.2);

  const auto is_reported = [&](const AffineDynamics<double>& result) {
    return result.status == Status::not_positive_definite && result.subsystem == 3 &&
           !(result.Bhat(0, 0) == result.Bhat(0, 0));
  };
  bool handed_on = false, found_sparse = false, found_dense = false;
  in_cycle("massless tip", [&] {
    handed_on = is_reported(implicit_inversion(forward_dynamics(q, qd, ws)));
    found_sparse = is_reported(sparse(q, qd, ws));
    found_dense = is_reported(dense(q, qd, ws));
  });
  CHECK(handed_on);
  CHECK(found_sparse);  // by Cholesky itself: no O(n) pass before it
  CHECK(found_dense);
}

}  // namespace test_cycle_no_heap
