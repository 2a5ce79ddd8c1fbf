// From the links and joints of a URDF model to subsystems.
#pragma once

#include <iim/errors.hpp>
#include <iim/iim.hpp>
#include <iim/numerics/array.hpp>
#include <iim/urdf/file.hpp>
#include <iim/urdf/robot.hpp>

#include <urdf_model/model.h>

#include <cstddef>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace iim {

namespace detail::urdf_file {

template <class Scalar>
Vector3<Scalar> vector(const urdf::Vector3& v)
{
  return Vector3<Scalar>(Scalar(v.x), Scalar(v.y), Scalar(v.z));
}

template <class Scalar>
Placement<Scalar> placement(const urdf::Pose& pose)
{
  const urdf::Rotation& r = pose.rotation;
  return {Eigen::Quaternion<Scalar>(Scalar(r.w), Scalar(r.x), Scalar(r.y), Scalar(r.z)).toRotationMatrix(),
          vector<Scalar>(pose.position)};
}

/// One body for several that do not move relative to each other.
template <class Scalar>
Body<Scalar> merged(const std::vector<Body<Scalar>>& bodies)
{
  Body<Scalar> whole = Body<Scalar>::massless();
  for (const Body<Scalar>& body : bodies) { whole.add(body); }
  return whole;
}

/// Of a joint that the model has.
inline bool is_fixed_or_floating(const urdf::ModelInterface& model, const std::string& joint)
{
  const auto type = model.getJoint(joint)->type;
  return type == urdf::Joint::FIXED || type == urdf::Joint::FLOATING;
}

/// From links and joints to parts.
template <class Scalar>
class Builder {
public:
  Builder(const UrdfOptions<Scalar>& options, const Source& source, std::map<std::string, UrdfMotor<Scalar>> motors)
      : options_(options), source_(source), motors_(std::move(motors))
  {
  }

  void build(const urdf::ModelInterface& model, UrdfRobot<Scalar>& robot)
  {
    const urdf::Link* root = model.getRoot().get();
    if (options_.base == Base::fixed) {
      place(*root, {-1, options_.at});
    } else {
      root = own_root(*root);
      parts_.push_back({root->name, {}, nullptr, {}});
      place(*root, {0, {}});
    }
    if (parts_.empty()) {
      throw ModelError(source_.name + ": no joint of robot '" + model.getName() +
                       "' moves (Base::floating frees its root)");
    }
    check_inertias(robot.warnings);
    for (const auto& [joint, motor] : motors_) { check_motor(joint, model); }
    warn_of_massless(robot.warnings);
    if (options_.rotors_in_links) { take_out_rotors(); }
    for (const Part& part : parts_) { add(part, robot); }
    for (const auto& [link, seat] : seats_) {
      if (link != "world" && (seat.part < 0 || parts_[at(seat.part)].name != link)) {
        robot.assembly.add_frame(link, attachment(seat, {}));
      }
    }
    for (const UrdfFrame<Scalar>& frame : options_.frames) {
      const auto seat = seats_.find(frame.link);
      if (seat == seats_.end()) {
        throw ModelError("frame '" + frame.name + "': " + source_.name + " has no link '" + frame.link + "'");
      }
      robot.assembly.add_frame(frame.name, attachment(seat->second, frame.at));
    }
  }

private:
  struct Part {
    std::string name;
    Attachment<Scalar> on;
    const urdf::Joint* joint;  ///< null: floating base
    std::vector<Body<Scalar>> bodies;
    int parent = -1;
  };
  /// Where a link sits: on which part (−1: the world), and where on it.
  struct Seat {
    int part;
    Placement<Scalar> on_part;
  };

  Attachment<Scalar> attachment(const Seat& seat, const Placement<Scalar>& on_link) const
  {
    const Placement<Scalar> on_part = seat.on_part * on_link;
    return {seat.part < 0 ? "world" : parts_[at(seat.part)].name, on_part.R, on_part.p};
  }

  /// The root link, or what a root called "world" is tied to: a floating base replaces that joint.
  const urdf::Link* own_root(const urdf::Link& root) const
  {
    if (root.name != "world") { return &root; }
    if (root.inertial || root.child_joints.size() != 1 || root.child_joints[0]->type != urdf::Joint::FIXED) {
      throw ModelError(
          source_.link(root.name) +
          ": with Base::floating a root 'world' must be without inertia and hold one link by a fixed joint (a file "
          "whose world is part of it is for Base::fixed)");
    }
    return root.child_links[0].get();
  }

  struct Waiting {
    const urdf::Link* link;
    const urdf::Joint* joint;  ///< that it hangs on; null for the root
    Seat parent;
  };

  /// Depth first, brothers in urdfdom's order.
  void place(const urdf::Link& root, const Seat& seat)
  {
    std::vector<Waiting> waiting{{&root, nullptr, seat}};
    while (!waiting.empty()) {
      const Waiting next = waiting.back();
      waiting.pop_back();
      const urdf::Link& link = *next.link;
      const Seat own = next.joint != nullptr ? moved(*next.joint, next.parent) : next.parent;
      place_alone(link, own);
      for (std::size_t k = link.child_joints.size(); k-- > 0;) {
        waiting.push_back({link.child_links[k].get(), link.child_joints[k].get(), own});
      }
    }
  }

  /// Where the link on a joint sits: on a part of its own, if the joint moves.
  Seat moved(const urdf::Joint& joint, const Seat& parent)
  {
    const Placement<Scalar> origin = placement<Scalar>(joint.parent_to_joint_origin_transform);
    if (joint.type == urdf::Joint::FIXED) { return {parent.part, parent.on_part * origin}; }
    const std::string where = source_.joint(joint.name);
    if (joint.type != urdf::Joint::FLOATING) { UnitAxis<Scalar>(axis_of(joint), where); }
    if (joint.mimic && options_.mimic == Mimic::reject) {
      throw ModelError(where + ": mimics joint '" + joint.mimic->joint_name +
                       "', which a tree cannot hold (Mimic::independent drops the tie)");
    }
    parts_.push_back({joint.child_link_name, attachment(parent, origin), &joint, {}, parent.part});
    return {static_cast<int>(parts_.size()) - 1, {}};
  }

  void place_alone(const urdf::Link& link, const Seat& seat)
  {
    if (link.name == "world" && link.parent_joint) {
      throw ModelError(source_.link(link.name) + ": only the root may be called 'world'");
    }
    seats_.emplace(link.name, seat);
    if (!link.inertial) {
      if (source_.with_inertia.contains(link.name)) {
        throw ModelError(source_.link(link.name) + ": urdfdom cannot read its <inertial>");
      }
      return;
    }
    const urdf::Inertial& given = *link.inertial;
    Body<Scalar> body;
    body.mass = Scalar(given.mass);
    body.inertia << Scalar(given.ixx), Scalar(given.ixy), Scalar(given.ixz), Scalar(given.ixy), Scalar(given.iyy),
        Scalar(given.iyz), Scalar(given.ixz), Scalar(given.iyz), Scalar(given.izz);
    if (body.mass != Scalar(0) || body.inertia != Matrix3<Scalar>::Zero()) { take(body, given, link.name, seat); }
  }

  /// Unit vectors are written to a few digits in many files; what is no unit vector is left as it is.
  static Vector3<Scalar> axis_of(const urdf::Joint& joint)
  {
    const Vector3<Scalar> axis = vector<Scalar>(joint.axis);
    const Scalar length = axis.norm();
    return length > Scalar(0.999) && length < Scalar(1.001) ? Vector3<Scalar>(axis / length) : axis;
  }

  /// A flawed inertia is forgiven where the merged body is sound, as it is in many files, a small link being on a large
  /// one; and where no principal moment of it is negative.
  void take(Body<Scalar>& body, const urdf::Inertial& given, const std::string& link, const Seat& seat)
  {
    try {
      validate(body, source_.link(link));
    } catch (const ModelError& flaw) {
      if (!(body.mass >= Scalar(0))) { throw; }
      flaws_.emplace_back(seat.part, flaw.what());
    }
    if (seat.part >= 0) {
      parts_[at(seat.part)].bodies.push_back(body.placed(seat.on_part * placement<Scalar>(given.origin)));
    }
  }

  void check_inertias(std::vector<std::string>& warnings)
  {
    for (const auto& [part, flaw] : flaws_) {
      warnings.push_back(flaw);
      if (part < 0) { continue; }
      Body<Scalar> whole = merged(parts_[at(part)].bodies);
      if (is_sound(whole)) { continue; }
      whole.any_moments = true;
      if (!is_sound(whole)) { throw ModelError(flaw); }
      parts_[at(part)].bodies = {whole};
    }
  }

  /// Of joints that move no mass: M̄_R is zero there.
  void warn_of_massless(std::vector<std::string>& warnings) const
  {
    std::vector<char> has_mass(parts_.size(), 0);
    for (std::size_t i = parts_.size(); i-- > 0;) {
      const Part& part = parts_[i];
      for (const Body<Scalar>& body : part.bodies) { has_mass[i] |= !body.is_massless; }
      const auto motor = part.joint != nullptr ? motors_.find(part.joint->name) : motors_.end();
      const bool has_motor = motor != motors_.end();
      const bool on_parent = has_mass[i] != 0 || (has_motor && motor->second.mass != Scalar(0));
      if (part.parent >= 0 && on_parent) { has_mass[at(part.parent)] = 1; }
      if (has_mass[i] != 0 || (has_motor && motor->second.axial_inertia != Scalar(0))) { continue; }
      const std::string where = part.joint != nullptr ? source_.joint(part.joint->name) : source_.name;
      warnings.push_back(where + ": link '" + part.name +
                         "' and all that hangs on it are without <inertial>: no state of this robot can be computed");
    }
  }

  static bool is_sound(const Body<Scalar>& body)
  {
    try {
      validate(body, "");
      return true;
    } catch (const ModelError&) {
      return false;
    }
  }

  void check_motor(const std::string& name, const urdf::ModelInterface& model) const
  {
    const auto joint = model.getJoint(name);
    if (!joint) {
      throw ModelError(source_.name + ": a motor is given for joint '" + name + "', which does not exist");
    }
    if (is_fixed_or_floating(model, name)) {
      throw ModelError(source_.joint(name) + ": a motor is given for it, but it is " +
                       (joint->type == urdf::Joint::FIXED ? "fixed" : "floating"));
    }
  }

  Motor<Scalar> motor_of(const urdf::Joint& joint) const
  {
    const UrdfMotor<Scalar>& given = motors_.at(joint.name);
    Motor<Scalar> motor{given.gear_ratio,         given.axial_inertia, {}, given.mass, given.com,
                        given.transverse_inertia, given.armature};
    motor.axis = given.axis ? *given.axis : UnitAxis<Scalar>(axis_of(joint), "").direction;
    return motor;
  }

  void take_out_rotors()
  {
    for (const Part& part : parts_) {
      if (part.joint == nullptr || part.parent < 0 || !motors_.contains(part.joint->name)) { continue; }
      Motor<Scalar> motor = motor_of(*part.joint);
      if (motor.armature || !(motor.axial_inertia > Scalar(0))) { continue; }
      const std::string where = source_.joint(part.joint->name);
      if (motor.mass > Scalar(0)) {
        throw ModelError(where + ": with UrdfOptions::rotors_in_links the rotor's mass must be zero, got " +
                         to_text(motor.mass) + " kg");
      }
      motor.axis = part.on.R * motor.axis;
      std::vector<Body<Scalar>>& carrier = parts_[at(part.parent)].bodies;
      Body<Scalar> body = without_rotor(merged(carrier), motor);
      if (body.is_massless) { body.mass = Scalar(0), body.is_massless = false; }
      validate(body, where + ": link '" + part.on.parent + "' without the rotor's inertia");
      carrier = {body};
    }
  }

  template <class Joint>
  static RigidLink<Joint> link(const urdf::Joint& joint, const Body<Scalar>& body)
  {
    RigidLink<Joint> part;
    part.joint.axis = axis_of(joint);
    part.body = body;
    return part;
  }

  /// A MotorArm where a motor makes a difference, else a RigidLink, whose input is the joint's force.
  template <class Joint>
  void add_jointed(const Part& part, const Body<Scalar>& body, StandardAssembly<Scalar>& assembly) const
  {
    const RigidLink<Joint> plain_link = link<Joint>(*part.joint, body);
    if (motors_.contains(part.joint->name)) {
      const Motor<Scalar> motor = motor_of(*part.joint);
      if (motor.gear_ratio != Scalar(1) || motor.axial_inertia != Scalar(0) || motor.mass != Scalar(0)) {
        MotorArmOn<Joint> arm;
        arm.joint = plain_link.joint;
        arm.body = body;
        arm.motor = motor;
        arm.prepare(source_.joint(part.joint->name));
        assembly.add(part.name, part.on, arm);
        return;
      }
    }
    assembly.add(part.name, part.on, plain_link);
  }

  void add(const Part& part, UrdfRobot<Scalar>& robot) const
  {
    const Body<Scalar> body = merged(part.bodies);
    if (part.joint == nullptr || part.joint->type == urdf::Joint::FLOATING) {
      robot.assembly.add(part.name, part.on, FloatingBase<Scalar>{body});
    } else if (part.joint->type == urdf::Joint::PRISMATIC) {
      add_jointed<Prismatic<Scalar>>(part, body, robot.assembly);
    } else {
      add_jointed<Revolute<Scalar>>(part, body, robot.assembly);
    }
    if (part.joint == nullptr) { return; }
    UrdfJoint joint{part.joint->name, part.name};
    if (part.joint->limits) {
      if (part.joint->type != urdf::Joint::CONTINUOUS) {
        joint.lower = part.joint->limits->lower;
        joint.upper = part.joint->limits->upper;
      }
      joint.velocity = part.joint->limits->velocity;
      joint.effort = part.joint->limits->effort;
    }
    if (part.joint->dynamics) {
      joint.damping = part.joint->dynamics->damping;
      joint.friction = part.joint->dynamics->friction;
    }
    robot.joints.push_back(joint);
  }

  const UrdfOptions<Scalar>& options_;
  const Source& source_;
  std::map<std::string, UrdfMotor<Scalar>> motors_;
  std::vector<Part> parts_;
  std::map<std::string, Seat> seats_;
  std::vector<std::pair<int, std::string>> flaws_;  ///< part, message
};

}  // namespace detail::urdf_file

}  // namespace iim
