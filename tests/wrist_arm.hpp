// An arm of six joints, in many states of which the wrist lies nearly along the forearm.
#pragma once

#include "random_tree.hpp"

#include <iim/iim.hpp>

#include <string>

namespace iim::test {

using WristArmParts = Assembly<RevoluteLink<double>, MotorArm<double>, FloatingBase<double>>;
using WristArmTree = WristArmParts::Tree;

/// The forearm turns about the axis that the hand lies along: A is up to 500 times as large there as the pivot.
inline WristArmParts wrist_arm(Random& random)
{
  struct Link {
    Vec3 axis, p;
    double mass, com;
    Vec3 moments;
  };
  const Link links[]{{{0, 0, 1}, {0, 0, 0.15}, 0.75, -0.06, {1.5e-3, 1.5e-3, 6e-4}},
                     {{0, 1, 0}, {0, 0, 0.12}, 1, 0.2, {1e-2, 1e-2, 8e-4}},
                     {{0, 1, 0}, {0, 0, 0.41}, 0.7, 0.08, {1.4e-3, 1.4e-3, 3e-4}},
                     {{0, 0, 1}, {0, 0.01, 0.2}, 0.45, 0.05, {4.3e-4, 4.3e-4, 9e-5}},
                     {{0, 1, 0}, {0, 0, 0.1}, 0.45, 0.05, {4.3e-4, 4.3e-4, 9e-5}},
                     {{0, 0, 1}, {0, 0, 0.1}, 1, 0.06, {8e-4, 8e-4, 6e-4}}};
  WristArmParts assembly;
  std::string parent = "world";
  for (const Link& link : links) {
    Body<double> body;
    body.mass = link.mass;
    body.com = {0, 0, link.com};
    body.inertia = link.moments.asDiagonal();
    Attachment<double> on;
    on.parent = parent;
    on.p = link.p;
    if (parent == "world") { on.R = Eigen::AngleAxisd(1, random.axis()).toRotationMatrix(); }
    parent = "link " + std::to_string(assembly.parts().size());
    assembly.add(parent, on, RevoluteLink<double>{{link.axis}, body});
  }
  return assembly;
}

/// The wrist nearly stretched.
inline RandomState stretched(const WristArmTree& tree, Random& random)
{
  RandomState state = random_state(tree, 0, random);
  state.q(4) *= 0.05;
  return state;
}

}  // namespace iim::test
