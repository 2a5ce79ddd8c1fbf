// Drives that couple joints: motors on the inlet whose belts, tendons or bevel gears turn several joints at once.
#pragma once

#include <iim/errors.hpp>
#include <iim/subsystem.hpp>
#include <iim/subsystem/compound.hpp>
#include <iim/subsystem/joint.hpp>
#include <iim/subsystem/motor_arm.hpp>

#include <array>
#include <cstddef>
#include <string>

namespace iim {

/// A mechanism driven through constant transmissions. Motor j is carried by frame `carrier[j]` (−1: the inlet) and its
/// rotor turns relative to that at row j of `transmission` times q̇_i. Inputs: torques of the motors on their rotors, so
/// that B̄_i = (0; transmissionᵀ). Motor::gear_ratio is not read.
///
/// As for a MotorArm the rotors' axial inertia is part of the drive, and their mass and transverse inertia are too if
/// a mass is given.
template <class M, int n_motors>
struct Driven : M {
  using Scalar = typename M::Scalar;
  static_assert(
      !requires(const M& m) { m.rotors(); },
      "Driven replaces the rotors and inputs of a mechanism that has its own; give all of them to one Driven");

  static constexpr int n_i = M::n_i;
  static constexpr int n_u = n_motors;
  static constexpr auto count = static_cast<std::size_t>(n_motors);
  using Coordinates = Eigen::Matrix<Scalar, n_i, 1>;

  std::array<Motor<Scalar>, count> motor{};
  std::array<int, count> carrier = [] {
    std::array<int, count> inlet{};
    inlet.fill(-1);
    return inlet;
  }();
  Eigen::Matrix<Scalar, n_motors, n_i> transmission = Eigen::Matrix<Scalar, n_motors, n_i>::Zero();

  void prepare(const std::string& owner)
  {
    M::prepare(owner);
    if (!detail::all_finite(transmission)) {
      detail::refuse({owner, ": transmission must be finite, got ", detail::to_text(transmission)});
    }
    for (std::size_t j = 0; j < count; ++j) {
      const std::string name = owner + ": rotor " + std::to_string(j);
      motor[j].prepare(name);
      bool turns = false;
      for (int d = 0; d < n_i; ++d) {
        const Scalar& ratio = transmission(static_cast<Index>(j), d);
        turns = turns || ratio < Scalar(0) || ratio > Scalar(0);
      }
      if (!turns) { detail::refuse({name, " turns with no joint: its row of transmission is zero"}); }
      if (carrier[j] < -1 || carrier[j] >= M::n_frames) {
        detail::refuse({name, " is carried by frame ", std::to_string(carrier[j]), ", but frames are −1 … ",
                        std::to_string(M::n_frames - 1)});
      }
    }
  }

  std::array<CarriedBody<Scalar>, count + detail::own_body_count<M>()> own_bodies() const
  {
    std::array<CarriedBody<Scalar>, count + detail::own_body_count<M>()> all;
    for (std::size_t j = 0; j < count; ++j) { all[j] = {carrier[j], motor[j].body()}; }
    if constexpr (detail::own_body_count<M>() > 0) {
      std::size_t at = count;
      for (const CarriedBody<Scalar>& carried : M::own_bodies()) { all[at++] = carried; }
    }
    return all;
  }

  std::array<Rotor<Scalar, n_i>, count> rotors() const
  {
    std::array<Rotor<Scalar, n_i>, count> all;
    for (std::size_t j = 0; j < count; ++j) {
      all[j] = {carrier[j], motor[j].axis, motor[j].axial_inertia, transmission.row(static_cast<Index>(j)),
                !motor[j].armature};
    }
    return all;
  }

  Eigen::Matrix<Scalar, n_i, n_u> Bbar(const Coordinates&) const { return transmission.transpose(); }

  template <class T>
  auto cast() const
  {
    const M& mechanism = *this;
    Driven<decltype(mechanism.template cast<T>()), n_motors> other{mechanism.template cast<T>()};
    for (std::size_t j = 0; j < count; ++j) { other.motor[j] = motor[j].template cast<T>(); }
    other.carrier = carrier;
    other.transmission = transmission.template cast<T>();
    return other;
  }
};

/// Two links in a row, both motors on the inlet; the second reaches its link by a belt or tendon that runs over a
/// pulley on the first axis.
template <class Scalar>
using BeltDrive = Compound<Driven<HingeRow<Scalar, 2>, 2>>;
/// Two hinges with both motors on both of them: bevel gears at a wrist or hip. (The same type: what differs is the
/// transmission.)
template <class Scalar>
using DifferentialDrive = Compound<Driven<HingeRow<Scalar, 2>, 2>>;

/// Rates of the rotors (rows) per rate of the hinges (columns) for parallel hinges. The pulley on the first axis is
/// free of the first link: it turns by q_0 + pulley·q_1 relative to the inlet, with `pulley` the radius at the second
/// link over the radius on the first axis; each motor turns its pulley through a gear.
template <class Scalar>
Eigen::Matrix<Scalar, 2, 2> belt_transmission(const Scalar& first_gear, const Scalar& second_gear,
                                              const Scalar& pulley = Scalar(1))
{
  Eigen::Matrix<Scalar, 2, 2> G;
  G << first_gear, Scalar(0), second_gear, second_gear * pulley;
  return G;
}

/// The sum of the two motors' angles turns the first hinge, their difference the second.
template <class Scalar>
Eigen::Matrix<Scalar, 2, 2> differential_transmission(const Scalar& first_gear, const Scalar& second_gear)
{
  Eigen::Matrix<Scalar, 2, 2> G;
  G << first_gear, second_gear, first_gear, -second_gear;
  return G;
}

static_assert(Subsystem<DifferentialDrive<double>>);

}  // namespace iim
