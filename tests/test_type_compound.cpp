// PROGRAM: tests_drives
// Compound: the laws, and a wrist as one subsystem against the same wrist as three.
#include "catch.hpp"
#include "type_robots.hpp"

#include <iim/law_suite.hpp>
#include <iim/subsystem/compound.hpp>

#include <cstddef>
#include <new>

using namespace iim;
using namespace iim::test;

namespace {

Wrist<double> random_wrist(Random& random)
{
  Wrist<double> wrist;
  for (std::size_t k = 0; k < 3; ++k) {
    wrist.mechanism.axis[k] = random.axis();
    wrist.mechanism.offset[k] = random.vector(0.3);
    wrist.body[k] = random.body();
  }
  return wrist;
}

}  // namespace

TEST_CASE("A compound obeys the laws")
{
  Random random(11);
  const LawReport report = check_laws(random_wrist(random));
  INFO(report.text());
  CHECK(report.ok());
}

TEST_CASE("A wrist as one subsystem is the wrist as three links")
{
  Random random(12);
  for (int k = 0; k < 100; ++k) {
    const Wrist<double> wrist = random_wrist(random);
    using Parts = Assembly<RevoluteLink<double>, Wrist<double>>;
    Parts one, three;
    const RevoluteLink<double> base{{random.unit()}, random.body()};
    const Attachment<double> on = random_attachment(random, "base");
    one.add("base", {}, base).add("part", on, wrist);
    three.add("base", {}, base);
    for (std::size_t j = 0; j < 3; ++j) {
      Attachment<double> at = on;
      if (j > 0) { at = {"part" + std::to_string(j - 1), Mat3::Identity(), wrist.mechanism.offset[j], 0}; }
      three.add("part" + std::to_string(j), at, RevoluteLink<double>{{wrist.mechanism.axis[j]}, wrist.body[j]});
    }
    // A load on the middle body.
    const RevoluteLink<double> load{{random.unit()}, random.body()};
    one.add("load", {"part", Mat3::Identity(), {0.1, 0.2, 0.3}, 1}, load);
    three.add("load", {"part1", Mat3::Identity(), {0.1, 0.2, 0.3}, 0}, load);
    one.add_frame("tip", {"part", Mat3::Identity(), {0, 0.1, 0}, 2});
    three.add_frame("tip", {"part2", Mat3::Identity(), {0, 0.1, 0}, 0});
    const DynamicTree a(one), b(three);
    // The load follows the wrist in one tree and, hanging on part1 after part2, in the other: the same order.
    Inputs inputs_a(a), inputs_b(b);
    inputs_a.add_wrench("tip");
    inputs_b.add_wrench("tip");
    inputs_a.add_force("load");
    inputs_b.add_force("load");
    RandomState state = random_state(a, 0, random, 3);
    const Answer x = solve(a, inputs_a, state.q, state.qd);
    const Answer y = solve(b, inputs_b, state.q, state.qd);
    REQUIRE(x.status == Status::ok);
    // Roundings of a few hundred operations times the condition number of M, up to 1e3.
    CHECK(relative_error(x.qdd0, y.qdd0) < 1e5 * eps);
    CHECK(relative_error(x.Bhat, y.Bhat) < 1e5 * eps);
  }
}

TEST_CASE("Hinges in a row start as hinges about z in one point")
{
  // In memory that held something else.
  alignas(Wrist<double>) std::array<std::byte, sizeof(Wrist<double>)> memory;
  memory.fill(std::byte{0xff});
  const auto* wrist = new (memory.data()) Wrist<double>;
  for (std::size_t k = 0; k < 3; ++k) {
    CHECK(wrist->mechanism.axis[k] == Vec3::UnitZ());
    CHECK(wrist->mechanism.offset[k] == Vec3::Zero());
  }
  wrist->~Wrist<double>();
}

TEST_CASE("A part on a named frame of a later body hangs on that body")
{
  Random random(13);
  const Wrist<double> wrist = random_wrist(random);
  const RevoluteLink<double> load{{random.unit()}, random.body()};
  using Parts = Assembly<RevoluteLink<double>, Wrist<double>>;
  Parts direct, by_frame;
  direct.add("part", {}, wrist).add("load", {"part", Mat3::Identity(), {0.1, 0.2, 0.3}, 2}, load);
  by_frame.add("part", {}, wrist).add_frame("palm", {"part", Mat3::Identity(), {0.1, 0, 0.3}, 2});
  by_frame.add("load", {"palm", Mat3::Identity(), {0, 0.2, 0}}, load);
  const DynamicTree a(direct), b(by_frame);
  CHECK(b.node("load").inlet == a.node("load").inlet);
  const RandomState state = random_state(a, 0, random, 3);
  const Answer x = solve(a, Inputs(a), state.q, state.qd), y = solve(b, Inputs(b), state.q, state.qd);
  REQUIRE(x.status == Status::ok);
  CHECK(relative_error(y.qdd0, x.qdd0) < 1e5 * eps);
  CHECK(relative_error(y.Bhat, x.Bhat) < 1e5 * eps);
}
