// Robots from URDF files, by liburdfdom. The one header of the library that needs more than Eigen; iim.hpp leaves it
// out.
//
// Every link that a joint moves becomes the subsystem of the link's name. Links behind fixed joints are merged into the
// link that carries them, or into the world, and their names stay as frames, so that any link's name serves where a
// frame is asked for: inputs.add_force("left_foot"). The frame of a link is the one that URDF gives it, at its joint.
// Coordinates are depth first, brothers in the alphabetical order of their joints (urdfdom's).
//
// Limits, damping and friction of joints are read (UrdfJoint), and are no part of the dynamics. Not read: shapes,
// safety controllers, calibration.
#pragma once

#include <iim/errors.hpp>
#include <iim/urdf/builder.hpp>
#include <iim/urdf/file.hpp>
#include <iim/urdf/robot.hpp>

#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <type_traits>
#include <utility>

namespace iim {

/// A robot from the text of a URDF file; `name` stands for the file in messages. Throws ModelError, naming the line and
/// the item, for whatever is wrong; liburdfdom's own words are part of the message, not on stderr.
///
/// Motors come from UrdfOptions::motors and from <transmission>: <mechanicalReduction> and, beside it, <rotorInertia>
/// [kg m²] and <rotorAxis xyz> (joint axes), or Drake's <drake:gear_ratio value> and <drake:rotor_inertia value>. The
/// input of a joint without motor is the generalised force on it. Axes are made unit vectors where they are that within
/// 10⁻³.
template <class Scalar>
UrdfRobot<Scalar> parse_urdf(const std::string& text, const UrdfOptions<Scalar>& options = {},
                             const std::string& name = "URDF text")
{
  if constexpr (std::is_same_v<Scalar, float>) {  // as exact as the file: fixed joints in a row multiply rotations
    UrdfRobot<double> robot = parse_urdf<double>(text, options.template cast<double>(), name);
    return {robot.name, robot.assembly.template cast<float>(), std::move(robot.joints), std::move(robot.warnings)};
  } else {
    namespace file = detail::urdf_file;
    file::Document document;
    if (!file::parse(document, text)) {
      const auto [row, reason] = file::failure(document);
      throw ModelError(name + ":" + std::to_string(row) + ": not an XML file: " + reason);
    }
    const file::Element* root = document.RootElement();
    if (root == nullptr || std::string(root->Value()) != "robot") {
      throw ModelError(name + ": not a URDF file: its root element is " +
                       (root == nullptr ? "missing" : "<" + std::string(root->Value()) + ">") + ", not <robot>");
    }
    file::straighten(document);
    const file::Source source = file::survey(*root, name);
    UrdfRobot<Scalar> robot;
    std::map<std::string, file::Transmission> transmissions;
    if (options.transmissions) { transmissions = file::read_transmissions(*root, source, robot.warnings); }
    const auto model = file::read_model(file::text_of(document), *root, source, robot.warnings);
    robot.name = model->getName();
    std::map<std::string, UrdfMotor<Scalar>> motors = options.motors;
    for (const auto& [joint, read] : transmissions) {
      if (motors.contains(joint)) { continue; }
      if (file::is_fixed_or_floating(*model, joint)) {
        robot.warnings.push_back(source.joint(joint) + ": has a <transmission>, but no motor can turn it");
        continue;
      }
      UrdfMotor<Scalar> motor{Scalar(read.ratio), Scalar(read.rotor_inertia)};
      if (read.rotor_axis) { motor.axis = read.rotor_axis->template cast<Scalar>(); }
      motors.emplace(joint, motor);
    }
    file::Builder<Scalar>(options, source, std::move(motors)).build(*model, robot);
    return robot;
  }
}

/// A robot from a URDF file; as parse_urdf.
template <class Scalar>
UrdfRobot<Scalar> load_urdf(const std::string& path, const UrdfOptions<Scalar>& options = {})
{
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  file.peek();  // an empty file is at its end now; << would take it for one that cannot be read
  if (!file.eof() && !(file && text << file.rdbuf())) { throw ModelError("cannot read the URDF file '" + path + "'"); }
  return parse_urdf<Scalar>(text.str(), options, path);
}

/// The same with all options but the base as they are.
template <class Scalar>
UrdfRobot<Scalar> load_urdf(const std::string& path, Base base)
{
  UrdfOptions<Scalar> options;
  options.base = base;
  return load_urdf<Scalar>(path, options);
}

}  // namespace iim
