// PART OF: iim_types
// Links with motors, compounds, and a flexible link.
#include "measure.hpp"

#include <iim/subsystem/compound.hpp>
#include <iim/subsystem/coupled_drive.hpp>
#include <iim/subsystem/elastic_motor_arm.hpp>
#include <iim/subsystem/flexible_link.hpp>

namespace bench {

std::vector<TypeCost> costs_of_drives(bool quick)
{
  using namespace iim;
  const Vector3<double> axis = Eigen::Vector3d(1, 2, 2) / 3, other = Eigen::Vector3d(2, 1, -2) / 3;
  Motor<double> motor;
  motor.gear_ratio = 50;
  motor.axial_inertia = 1e-4;
  motor.axis = other;
  motor.mass = 0.4;
  motor.transverse_inertia = 1e-4;
  Motor<double> armature = motor;
  armature.armature = true;
  Wrist<double> wrist;
  wrist.mechanism.axis = {axis, other, axis};
  wrist.mechanism.offset[1] = wrist.mechanism.offset[2] = Eigen::Vector3d(0.1, 0.2, 0);
  wrist.body = {box(), box(), box()};
  DifferentialDrive<double> drive;
  drive.mechanism.axis = {axis, other};
  drive.mechanism.motor = {motor, motor};
  drive.mechanism.transmission = differential_transmission(20.0, 30.0);
  drive.body = {box(), box()};
  const ElasticMotorArm<double> elastic{{axis}, box(), motor, 300, 1};
  using Beam = FlexibleLink<Revolute<double>, 2, 2, 1>;
  Beam beam;
  beam.joint.axis = other;
  beam.bending_y = beam.bending_z = beam.torsion = 100;
  beam.rotary_y = beam.rotary_z = 1e-3;
  return {
      cost_of("motor-arm, armature only", MotorArm<double>{{axis}, box(), armature}, quick),
      cost_of("motor-arm with rotor", MotorArm<double>{{axis}, box(), motor}, quick),
      cost_of("elastic motor-arm", elastic, quick),
      cost_of("coupled drive, two motors", drive, quick, 1),
      cost_of("compound: wrist of three bodies", wrist, quick, 2),
      cost_of("flexible link, 2 + 2 bending, 1 torsion", beam, quick),
  };
}

}  // namespace bench
