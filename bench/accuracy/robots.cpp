// PART OF: iim_accuracy
// OPTIONAL: urdf
// Robots of URDF files as scenes.
#include "robots.hpp"

#include <filesystem>

#ifdef IIM_WITH_URDF
#include <iim/urdf.hpp>
#endif

namespace bench {

#ifdef IIM_WITH_URDF

namespace {

struct File {
  const char* name;
  const char* what;
  iim::Base base;
  std::vector<std::string> points;  ///< where a force may act
};

/// Slides to where they can be; turning joints stay anywhere on the circle.
void keep_slides_within_limits(const iim::UrdfRobot<double>& robot, const Tree<double>& tree, State<double>& x)
{
  for (const iim::UrdfJoint& joint : robot.joints) {
    const iim::Node& node = robot.node(tree, joint.name);
    tree.outward([&]<class N, class S>(const N& other, const S&) {
      if constexpr (requires { S::pattern.angular; }) {
        if (other.index == node.index && !S::pattern.angular && std::isfinite(joint.upper - joint.lower)) {
          const double share = (x.q(node.q) / std::numbers::pi + 1) / 2;
          x.q(node.q) = static_cast<float>(joint.lower + share * (joint.upper - joint.lower));
        }
      }
    });
  }
}

/// Moments of inertia symmetric to the last bit: of links that were merged from several they are so up to roundings,
/// and what 80 digits make of such a matrix depends on which half they read.
iim::StandardAssembly<double> symmetric(const iim::StandardAssembly<double>& parts)
{
  iim::StandardAssembly<double> other;
  for (const auto& part : parts.parts()) {
    std::visit(
        [&](auto s) {
          s.body.inertia = (s.body.inertia + s.body.inertia.transpose()).eval() / 2;
          other.add(part.name, part.on, s);
        },
        part.part);
  }
  for (const auto& frame : parts.named_frames()) { other.add_frame(frame.name, frame.on); }
  other.set_gravity(parts.gravity());
  return other;
}

}  // namespace

std::vector<AccuracyScene> accuracy_robots(const std::string& folder, int states, std::vector<std::string>& absent)
{
  const std::vector<File> files{
      {"panda", "arm, fixed base", iim::Base::fixed, {"panda_hand_tcp"}},
      {"ur5", "arm, fixed base", iim::Base::fixed, {"ee_link"}},
      {"anymal", "quadruped", iim::Base::floating, {"LF_FOOT", "RF_FOOT", "LH_FOOT", "RH_FOOT"}},
      {"solo12", "quadruped", iim::Base::floating, {"FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"}}};
  std::vector<AccuracyScene> scenes;
  for (const File& file : files) {
    const std::filesystem::path path = std::filesystem::path(folder) / (std::string(file.name) + ".urdf");
    if (!std::filesystem::exists(path)) {
      absent.push_back(std::string(file.name) + ": there is no " + path.string());
      continue;
    }
    iim::UrdfOptions<double> options;
    options.base = file.base;
    options.mimic = iim::Mimic::independent;
    const auto robot = iim::load_urdf<double>(path.string(), options);
    AccuracyScene scene{
        std::string(file.name) + ", " + file.what, "robot", 0, symmetric(robot.assembly), file.points, {}, true};
    const Tree<double> tree(scene.parts);
    scene.parameter = static_cast<double>(tree.n_v());
    scene.states = random_states(tree, 0, states, 4711);
    for (State<double>& x : scene.states) { keep_slides_within_limits(robot, tree, x); }
    scenes.push_back(std::move(scene));
  }
  return scenes;
}

#else

std::vector<AccuracyScene> accuracy_robots(const std::string&, int, std::vector<std::string>& absent)
{
  absent.push_back("this program was built without liburdfdom (liburdfdom-dev)");
  return {};
}

#endif

}  // namespace bench
