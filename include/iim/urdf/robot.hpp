// What a robot from a URDF file is made with, and what comes of it.
#pragma once

#include <iim/errors.hpp>
#include <iim/iim.hpp>

#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace iim {

/// What holds the root link: the world, or nothing.
enum class Base { fixed, floating };

/// A joint that <mimic> ties to another one: an error, or a joint like any other.
enum class Mimic { reject, independent };

/// The motor of a joint, as in Motor; without an axis of its own the rotor is coaxial with the joint.
template <class Scalar>
struct UrdfMotor {
  Scalar gear_ratio = Scalar(1);
  Scalar axial_inertia = Scalar(0);               ///< rotor about its axis [kg m²]
  std::optional<Vector3<Scalar>> axis{};          ///< rotor axis, unit vector in joint axes
  Scalar mass = Scalar(0);                        ///< [kg]; zero: contained in the parent link
  Vector3<Scalar> com = Vector3<Scalar>::Zero();  ///< joint axes, from the joint [m]
  Scalar transverse_inertia = Scalar(0);          ///< [kg m²]
  bool armature = false;                          ///< as in Motor

  template <class T>
  UrdfMotor<T> cast() const
  {
    UrdfMotor<T> motor{T(gear_ratio),          T(axial_inertia),      {},      T(mass),
                       com.template cast<T>(), T(transverse_inertia), armature};
    if (axis) { motor.axis = axis->template cast<T>(); }
    return motor;
  }
};

/// A frame to be named on a link, whether that link moves or is merged.
template <class Scalar>
struct UrdfFrame {
  std::string name;
  std::string link;
  Placement<Scalar> at{};
};

/// What a URDF file does not say, and what of it is read.
template <class Scalar>
struct UrdfOptions {
  Base base = Base::fixed;
  Placement<Scalar> at{};                             ///< of the root link in the world (Base::fixed)
  std::map<std::string, UrdfMotor<Scalar>> motors{};  ///< by joint; each takes the place of the joint's <transmission>
  bool transmissions = true;                          ///< false: <transmission> elements are not read
  /// Whether the links' inertias contain the rotors' axial inertia (CAD with the motors mounted). If so it is taken out
  /// of the link that carries the motor, since a MotorArm brings it along.
  bool rotors_in_links = false;
  Mimic mimic = Mimic::reject;
  std::vector<UrdfFrame<Scalar>> frames{};

  template <class T>
  UrdfOptions<T> cast() const
  {
    UrdfOptions<T> options{base, at.template cast<T>(), {}, transmissions, rotors_in_links, mimic, {}};
    for (const auto& [joint, motor] : motors) { options.motors.emplace(joint, motor.template cast<T>()); }
    for (const auto& frame : frames) {
      options.frames.push_back({frame.name, frame.link, frame.at.template cast<T>()});
    }
    return options;
  }
};

/// A joint that moves.
struct UrdfJoint {
  std::string name;
  std::string link;                                         ///< that it moves: the subsystem's name
  double lower = -std::numeric_limits<double>::infinity();  ///< [rad, m]
  double upper = std::numeric_limits<double>::infinity();
  double velocity = std::numeric_limits<double>::infinity();  ///< greatest speed [rad/s, m/s]
  double effort = std::numeric_limits<double>::infinity();    ///< greatest torque or force on the joint [N m, N]
  double damping = 0;   ///< of <dynamics>, no part of the robot: for its controller, or a Sprung [N m s/rad, N s/m]
  double friction = 0;  ///< the same: static friction [N m, N]
};

/// What a URDF file says. The assembly may be added to before it becomes a tree.
template <class Scalar>
struct UrdfRobot {
  std::string name;
  StandardAssembly<Scalar> assembly;
  std::vector<UrdfJoint> joints;  ///< in the order of the coordinates
  /// Of urdfdom; transmissions that are left out; inertias that no link can have, where the merged body can or where no
  /// principal moment is negative (Body::any_moments): they are kept as they are.
  std::vector<std::string> warnings;

  auto tree() const { return DynamicTree(assembly); }

  /// Throws ModelError if no joint of that name moves.
  const UrdfJoint& joint(const std::string& joint_name) const
  {
    for (const UrdfJoint& candidate : joints) {
      if (candidate.name == joint_name) { return candidate; }
    }
    throw ModelError("robot '" + name + "' has no moving joint '" + joint_name + "'");
  }

  /// Where the numbers of a joint are in a tree made from the assembly: .q, .v, .u. Throws ModelError as joint does.
  template <class Tree>
  Node node(const Tree& tree, const std::string& joint_name) const
  {
    return tree.node(tree.index(joint(joint_name).link));
  }
};

}  // namespace iim
