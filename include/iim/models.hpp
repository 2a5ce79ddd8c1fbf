// The models of the paper's study, Sect. 5: n-link chain, binary tree of links, biped.
#pragma once

#include <iim/iim.hpp>

#include <array>
#include <string>

namespace iim::models {

/// The link of which chain and tree consist: 1 kg, 1 m along −z, centre half way, diag(0.1, 0.1, 0.01) kg m².
template <class Scalar>
RevoluteLink<Scalar> link()
{
  RevoluteLink<Scalar> link;
  link.joint.axis = Vector3<Scalar>::UnitY();
  link.body.mass = Scalar(1);
  link.body.com = Vector3<Scalar>(Scalar(0), Scalar(0), -Scalar(1) / Scalar(2));
  link.body.inertia.diagonal() << Scalar(1) / Scalar(10), Scalar(1) / Scalar(10), Scalar(1) / Scalar(100);
  return link;
}

/// Pendulum of n equal links (Sect. 5.1), all joints about y. Subsystems "link0" … from the world outward.
template <class Scalar>
StandardAssembly<Scalar> chain(Index n)
{
  StandardAssembly<Scalar> assembly;
  for (Index i = 0; i < n; ++i) {
    Attachment<Scalar> on;
    if (i > 0) {
      on.parent = "link" + std::to_string(i - 1);
      on.p.z() = Scalar(-1);
    }
    assembly.add("link" + std::to_string(i), on, link<Scalar>());
  }
  return assembly;
}

/// Complete binary tree of n equal links (Sect. 5.2): link i hangs on the tip of link (i − 1)/2.
/// Left links turn about y and right links about x, so that brothers do not coincide.
template <class Scalar>
StandardAssembly<Scalar> binary_tree(Index n)
{
  StandardAssembly<Scalar> assembly;
  for (Index i = 0; i < n; ++i) {
    Attachment<Scalar> on;
    RevoluteLink<Scalar> part = link<Scalar>();
    if (i > 0) {
      on.parent = "link" + std::to_string((i - 1) / 2);
      on.p.z() = Scalar(-1);
      if (i % 2 == 0) { part.joint.axis = Vector3<Scalar>::UnitX(); }
    }
    assembly.add("link" + std::to_string(i), on, part);
  }
  return assembly;
}

/// Whether the biped's joints carry the rotors of their motors.
enum class Motors { geared, ideal };

/// Bipedal robot in the manner of Sect. 5.3: floating torso, two legs of seven motor-arms, 20 degrees of freedom, four
/// contact points per foot ("left_heel_outer", …), with the 14 motors 38 inputs. The dimensions are ours.
/// Motors::ideal: gear ratio 1 and no rotors, so that inputs are joint torques.
template <class Scalar>
[[gnu::cold]] StandardAssembly<Scalar> biped(Motors motors = Motors::geared)
{
  struct Segment {
    const char* name;
    int axis;
    double p[3], mass, com[3], inertia[3];
  };
  // Lengths for the left leg; y changes sign on the right.
  static constexpr std::array<Segment, 7> leg{{
      {"hip_yaw", 2, {0, 0.1, -0.1}, 0.5, {0, 0, -0.02}, {1e-3, 1e-3, 8e-4}},
      {"hip_roll", 0, {0, 0, -0.04}, 0.8, {0, 0, -0.03}, {1.5e-3, 1.5e-3, 1e-3}},
      {"hip_pitch", 1, {0, 0, -0.04}, 3.0, {0.01, 0.01, -0.16}, {0.04, 0.04, 6e-3}},
      {"knee", 1, {0, 0, -0.36}, 2.0, {5e-3, 0, -0.15}, {0.025, 0.025, 3e-3}},
      {"ankle_pitch", 1, {0, 0, -0.34}, 0.4, {0, 0, -0.01}, {5e-4, 5e-4, 4e-4}},
      {"ankle_roll", 0, {0, 0, -0.02}, 0.9, {0.03, 0, -0.04}, {1.2e-3, 3e-3, 3.5e-3}},
      {"toe", 1, {0.13, 0, -0.06}, 0.3, {0.03, 0, -5e-3}, {2e-4, 3e-4, 4e-4}},
  }};
  const auto vector = [](const double(&x)[3], double side) {
    return Vector3<Scalar>(Scalar(x[0]), Scalar(side * x[1]), Scalar(x[2]));
  };

  StandardAssembly<Scalar> assembly;
  FloatingBase<Scalar> torso;
  torso.body.mass = Scalar(10);
  torso.body.inertia.diagonal() << Scalar(0.1), Scalar(0.1), Scalar(0.05);
  assembly.add("torso", {}, torso);
  for (const double side : {1.0, -1.0}) {
    const std::string prefix = side > 0 ? "left_" : "right_";
    std::string parent = "torso";
    for (const Segment& segment : leg) {
      MotorArm<Scalar> arm;
      arm.joint.axis = Vector3<Scalar>::Unit(segment.axis);
      arm.body.mass = Scalar(segment.mass);
      arm.body.com = vector(segment.com, side);
      arm.body.inertia.diagonal() << Scalar(segment.inertia[0]), Scalar(segment.inertia[1]), Scalar(segment.inertia[2]);
      arm.motor.axis = arm.joint.axis;
      if (motors == Motors::geared) {
        arm.motor.gear_ratio = Scalar(80);
        arm.motor.axial_inertia = Scalar(1.5e-5);
      }
      Attachment<Scalar> on;
      on.parent = parent;
      on.p = vector(segment.p, side);
      parent = prefix + segment.name;
      assembly.add(parent, on, arm);
    }
    for (const double edge : {1.0, -1.0}) {
      const std::string name = edge > 0 ? "outer" : "inner";
      Attachment<Scalar> heel;
      heel.parent = prefix + "ankle_roll";
      heel.p = Vector3<Scalar>(Scalar(-0.07), Scalar(side * edge * 0.04), Scalar(-0.07));
      assembly.add_frame(prefix + "heel_" + name, heel);
      Attachment<Scalar> toe;
      toe.parent = prefix + "toe";
      toe.p = Vector3<Scalar>(Scalar(0.06), Scalar(side * edge * 0.04), Scalar(-0.01));
      assembly.add_frame(prefix + "toe_" + name, toe);
    }
  }
  return assembly;
}

/// Names of the biped's contact points, left foot first.
inline constexpr std::array<const char*, 8> biped_contacts{"left_heel_outer", "left_heel_inner",  "left_toe_outer",
                                                           "left_toe_inner",  "right_heel_outer", "right_heel_inner",
                                                           "right_toe_outer", "right_toe_inner"};

}  // namespace iim::models
