// A robot in cycles of good and bad states, contacts going on and off, with the heap and exceptions counted.
#pragma once

#include <iim/global_inverse.hpp>
#include <iim/iim.hpp>
#include <iim/models.hpp>
#include <iim/recursive_inverse.hpp>
#include <iim/unit_force.hpp>

#include "catch.hpp"
#include "heap_counter.hpp"

#include <cmath>
#include <limits>
#include <string>

namespace iim::test {

/// Requires that f neither touched the heap nor threw.
template <class F>
void in_cycle(const std::string& what, F&& f)
{
  const Calls calls = count(f);
  INFO(what);
  CHECK(calls.heap == 0);
  CHECK(calls.thrown == 0);
}

/// Robot with everything that a cycle may meet: floating base, motor-arms with rotors on their inlets, branches,
/// points. `finger`: how many times as heavy as the hand its finger is, on which a wrench acts.
inline StandardAssembly<double> robot(double finger = 1)
{
  StandardAssembly<double> assembly = models::biped<double>();
  Body<double> body;
  body.mass = 0.5;
  body.com = {0.1, 0, 0.2};
  body.inertia.diagonal() << 0.01, 0.02, 0.02;
  Attachment<double> on;
  on.parent = "torso";
  on.p = {0, 0.2, 0.3};
  assembly.add("rail", on, PrismaticLink<double>{{Vector3<double>::UnitX()}, body});
  on.parent = "rail";
  LinearMotorArm<double> slide{{Vector3<double>::UnitZ()}, body, {}};
  slide.motor.axial_inertia = 1e-4;
  slide.motor.gear_ratio = 50;
  slide.motor.mass = 0.2;
  slide.motor.transverse_inertia = 1e-4;
  assembly.add("slide", on, slide);
  on.parent = "slide";
  assembly.add("hand", on, FixedLink<double>{{}, body});
  on.parent = "hand";
  body.mass *= finger;
  body.inertia *= finger;
  assembly.add("finger", on, RevoluteLink<double>{{Vector3<double>(0.6, 0, 0.8)}, body});
  return assembly;
}

inline VectorX<double> coordinates(Index n_q, double phase)
{
  VectorX<double> q(n_q);
  for (Index k = 0; k < n_q; ++k) { q(k) = 0.4 * std::sin(phase + 1.7 * static_cast<double>(k)); }
  q.segment<4>(3).normalize();  // the torso comes first
  return q;
}

/// One method through good and bad states, contacts going on and off. `call(method, fd)` applies it.
template <class Method, class Tree, class Workspace, class Call>
void check_method(const std::string& name, const Tree& tree, Inputs<Tree>& inputs, Workspace& ws, Call&& call)
{
  const VectorX<double> q = coordinates(tree.n_q(), 0.3), other = coordinates(tree.n_q(), 1.1);
  VectorX<double> qd = coordinates(tree.n_q(), 2.2).head(tree.n_v());
  VectorX<double> bad = q;
  bad(tree.n_q() - 1) = std::numeric_limits<double>::quiet_NaN();
  Method method(tree, inputs);
  const Index all = inputs.columns();

  const auto run = [&](const VectorX<double>& at) { return call(method, forward_dynamics(at, qd, ws), at, qd); };
  const MatrixX<double> before = run(q).Bhat;
  REQUIRE(before.cols() == all);
  Status good = Status::not_finite, wrong = Status::ok, again = Status::not_finite;
  bool nan = false;
  Index fewer = 0;
  in_cycle(name, [&] {
    good = run(other).status;
    for (Index id = 0; id < inputs.blocks(); id += 2) { inputs.set_active(id, false); }
    fewer = run(q).Bhat.cols();
    const auto failed = run(bad);
    wrong = failed.status;
    nan = !(failed.Bhat(0, 0) == failed.Bhat(0, 0)) && !(failed.qdd0(0) == failed.qdd0(0));
    for (Index id = 0; id < inputs.blocks(); ++id) { inputs.set_active(id, true); }
    again = run(q).status;
  });
  INFO(name);
  CHECK(good == Status::ok);
  CHECK(fewer < all);
  CHECK(wrong == Status::invalid_state);
  CHECK(nan);
  CHECK(again == Status::ok);
  CHECK(run(q).Bhat == before);  // as if nothing had been
}

/// The robot's inputs: all motors, points on the feet, a wrench on the finger.
template <class Tree>
Inputs<Tree> robot_inputs(const Tree& tree)
{
  Inputs<Tree> inputs(tree);
  for (const char* contact : models::biped_contacts) { inputs.add_force(contact); }
  inputs.add_wrench("finger", {0.1, 0.2, 0.3}, Axes::body);
  return inputs;
}

template <class Workspace, class Tree>
void check_forward_dynamics(const Tree& tree, const Inputs<Tree>& inputs, Workspace& ws)
{
  const VectorX<double> q = coordinates(tree.n_q(), 0.7);
  const VectorX<double> qd = coordinates(tree.n_q(), 1.9).head(tree.n_v());
  const VectorX<double> u = VectorX<double>::Ones(inputs.columns());
  bool ok = false;
  in_cycle("O(n) pass, u = 0", [&] { ok = forward_dynamics(q, qd, ws).ok(); });
  CHECK(ok);
  in_cycle("O(n) pass with u", [&] { ok = forward_dynamics(q, qd, inputs, u, ws).status == Status::ok; });
  CHECK(ok);
}

/// How a method is applied to a receipt.
struct ToReceipt {
  template <class Method, class Receipt>
  auto operator()(Method& method, const Receipt& fd, const VectorX<double>&, const VectorX<double>&) const
  {
    return method(fd);
  }
};

/// ImplicitInversion with a pass of its own.
struct ToState {
  template <class Method, class Receipt>
  auto operator()(Method& method, const Receipt& fd, const VectorX<double>& q, const VectorX<double>& qd) const
  {
    return method(q, qd, const_cast<typename Receipt::Workspace&>(fd.workspace()));  // which the caller made
  }
};

/// The methods that work on what the O(n) pass left.
template <class Workspace, class Tree>
void check_workspace_methods(const Tree& tree, Inputs<Tree>& inputs, Workspace& ws)
{
  check_method<ImplicitInversion<Tree>>("implicit inversion", tree, inputs, ws, ToReceipt{});
  check_method<ImplicitInversion<Tree>>("implicit inversion and the pass in one call", tree, inputs, ws, ToState{});
  check_method<UnitForce<Tree>>("unit forces", tree, inputs, ws, ToReceipt{});
  check_method<RecursiveInverse<Tree>>("recursive inverse", tree, inputs, ws, ToReceipt{});
  check_method<GlobalInverse<Tree>>("global inverse, branch-sparse", tree, inputs, ws, ToReceipt{});
}

}  // namespace iim::test
