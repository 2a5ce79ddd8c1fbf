// REQUIRES: urdf
// Reads a robot from a URDF file and prints its tree, q̈₀ and B̂ at rest in the reference position.
//
//     load_urdf [file.urdf] [fixed | floating]
#include <iim/iim.hpp>
#include <iim/urdf.hpp>

#include <exception>
#include <iostream>
#include <string>

#ifndef IIM_EXAMPLES_DIR
#define IIM_EXAMPLES_DIR "examples"
#endif

namespace {

template <class Tree>
void print(const iim::UrdfRobot<double>& robot, const Tree& tree)
{
  std::cout << "robot '" << robot.name << "': " << tree.size() << " subsystems, n = " << tree.n_v()
            << ", m = " << tree.n_motors() << "\n\n";
  for (iim::Index i = 0; i < tree.size(); ++i) {
    std::string indent(2, ' ');
    for (iim::Index k = tree.node(i).parent; k >= 0; k = tree.node(k).parent) { indent += "  "; }
    std::cout << indent << tree.name(i) << "  (q" << tree.node(i).q << ")\n";
  }
  std::cout << "\nother links and frames:";
  for (const auto& [name, frame] : tree.named_frames()) {
    if (frame.subsystem < 0) {
      std::cout << "  " << name << " on the world";
    } else if (tree.name(frame.subsystem) != name) {
      std::cout << "  " << name << " on " << tree.name(frame.subsystem);
    }
  }
  std::cout << "\n\n";
}

void run(const std::string& path, iim::Base base)
{
  const auto robot = iim::load_urdf<double>(path, base);
  for (const std::string& warning : robot.warnings) { std::cerr << "warning: " << warning << "\n"; }
  const auto tree = robot.tree();
  print(robot, tree);

  const iim::VectorX<double> q = iim::neutral(tree);
  const iim::VectorX<double> qd = iim::VectorX<double>::Zero(tree.n_v());

  const iim::Inputs inputs(tree);  // all motors; add_force("a link's name") for contacts
  iim::Workspace ws(tree);
  iim::ImplicitInversion iwim(tree, inputs);
  const auto dynamics = iwim(q, qd, ws);
  if (!dynamics.ok()) { throw iim::ModelError(describe(dynamics, tree)); }
  const Eigen::IOFormat rows(4, 0, "  ", "\n", "  ");
  std::cout << "q̈₀ =\n" << dynamics.qdd0.format(rows) << "\n\nB̂ =\n" << dynamics.Bhat.format(rows) << "\n";
}

}  // namespace

int main(int argc, char** argv)
{
  const std::string path = argc > 1 ? argv[1] : IIM_EXAMPLES_DIR "/robots/arm7.urdf";
  const std::string base = argc > 2 ? argv[2] : "fixed";
  if (base != "fixed" && base != "floating") {
    std::cerr << "usage: load_urdf [file.urdf] [fixed | floating]\n";
    return 2;
  }
  try {
    run(path, base == "floating" ? iim::Base::floating : iim::Base::fixed);
  } catch (const std::exception& error) {
    std::cerr << "load_urdf: " << error.what() << "\n";
    return 1;
  }
  return 0;
}
