// PROGRAM: tests_methods
// The paper's biped as a type and as read at run time.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/models.hpp>
#include <limits>

namespace test_static_tree_biped {

using namespace iim;

TEST_CASE("the biped as a type is the biped at run time", "[static]")
{
  using Arm = MotorArm<double>;
  using Biped = StaticTree<On<-1, FloatingBase<double>>,                                                        //
                           On<0, Arm>, On<1, Arm>, On<2, Arm>, On<3, Arm>, On<4, Arm>, On<5, Arm>, On<6, Arm>,  //
                           On<0, Arm>, On<8, Arm>, On<9, Arm>, On<10, Arm>, On<11, Arm>, On<12, Arm>, On<13, Arm>>;
  const auto assembly = models::biped<double>();
  const DynamicTree tree(assembly);
  const Biped biped(assembly);
  REQUIRE(biped.n_v() == 20);
  Inputs dynamic_inputs(tree);
  Inputs inputs(biped);
  for (const char* contact : models::biped_contacts) {
    dynamic_inputs.add_force(contact);
    inputs.add_force(contact);
  }
  REQUIRE(inputs.columns() == 38);
  Workspace dynamic_ws(tree);
  Workspace ws(biped);
  ImplicitInversion dynamic_method(tree, dynamic_inputs);
  ImplicitInversion method(biped, inputs);
  test::Random draw(1);
  // One text: only the compiler's contraction and order of products may differ.
  constexpr double tolerance = 64 * std::numeric_limits<double>::epsilon();
  for (int k = 0; k < 50; ++k) {
    const test::RandomState state = test::random_state(tree, 38, draw);
    const auto a = method(state.q, state.qd, ws);
    const auto b = dynamic_method(forward_dynamics(state.q, state.qd, dynamic_ws));
    REQUIRE(a.ok());
    REQUIRE(b.ok());
    CHECK((a.qdd0 - b.qdd0).norm() <= tolerance * b.qdd0.norm());
    CHECK((a.Bhat - b.Bhat).norm() <= tolerance * b.Bhat.norm());
  }
  // In one call as in two, of another scene too.
  const test::RandomState state = test::random_state(tree, 38, draw);
  constexpr Scene at_rest{.velocity = false};
  const auto c = method.operator()<at_rest>(state.q, VectorX<double>(), ws);
  const auto d = dynamic_method(forward_dynamics(state.q, VectorX<double>::Zero(20), dynamic_ws));
  REQUIRE(c.ok());
  CHECK(c.fd.scene() == at_rest);
  CHECK((c.qdd0 - d.qdd0).norm() <= tolerance * d.qdd0.norm());
  CHECK((c.Bhat - d.Bhat).norm() <= tolerance * d.Bhat.norm());
}

}  // namespace test_static_tree_biped
