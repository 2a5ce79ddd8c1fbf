// REQUIRES: urdf json
// PROGRAM: tests_methods
// The robots of IIM_SHARED_DIR/robots: every file loads, and those with golden values agree with them.
#include "golden.hpp"

#include <iim/iim.hpp>
#include <iim/urdf.hpp>

#include <filesystem>
#include <map>
#include <string>

namespace test_golden_urdf {

using namespace iim;
using namespace iim::test;

namespace {

const std::string robots = std::string(IIM_SHARED_DIR) + "/robots";

/// Nothing, with a message, where the folder is absent.
bool have_robots()
{
  if (std::filesystem::is_directory(robots)) { return true; }
  WARN("skipped: there is no " << robots);
  return false;
}

GoldenError error_of_file(const std::string& name, Base base, const Golden& golden)
{
  UrdfOptions<double> options;
  options.base = base;
  options.mimic = Mimic::independent;  // as the reference has it
  const auto robot = load_urdf<double>(robots + "/" + name + ".urdf", options);
  const auto tree = robot.tree();
  Inputs inputs(tree);
  // Contacts at the origins of the merged feet: "LF_FOOT_0" is the link "LF_FOOT".
  for (const GoldenContact& contact : golden.contacts) {
    inputs.add_force(contact.name.substr(0, contact.name.size() - 2));
  }
  ImplicitInversion method(tree, inputs);
  return golden_error<Update::projected>(method, tree, golden);
}

}  // namespace

TEST_CASE("robots read from their URDF files agree with the golden values")
{
  if (!have_robots()) { return; }
  for (const auto& [name, base] : std::map<std::string, Base>{{"panda", Base::fixed}, {"anymal", Base::floating}}) {
    const auto golden = read_golden(name);
    if (!golden) { continue; }
    const GoldenError error = error_of_file(name, base, *golden);
    INFO(name << ": " << error);
    CHECK(error.qdd0 <= few);
    CHECK(error.Bhat <= few);
    CHECK(error.columns <= few);
  }
}

TEST_CASE("every robot of the folder loads on a fixed and on a floating base")
{
  if (!have_robots()) { return; }
  const std::map<std::string, Index> joints{{"anymal", 12}, {"panda", 9}, {"solo12", 12}, {"ur5", 6}};
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(robots)) {
    if (entry.path().extension() != ".urdf") { continue; }
    ++files;
    const std::string name = entry.path().stem().string();
    INFO(name);
    UrdfOptions<double> options;
    options.mimic = Mimic::independent;
    const auto fixed = load_urdf<double>(entry.path().string(), options).tree();
    options.base = Base::floating;
    const auto floating = load_urdf<double>(entry.path().string(), options).tree();
    CHECK(floating.n_v() == fixed.n_v() + 6);
    CHECK(floating.n_q() == fixed.n_q() + 7);
    CHECK(floating.n_motors() == fixed.n_motors());
    if (joints.contains(name)) { CHECK(fixed.n_v() == joints.at(name)); }
  }
  CHECK(files >= 4);
}

}  // namespace test_golden_urdf
