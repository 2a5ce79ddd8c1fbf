// The models of the comparison, and the neutral description of what iim has as an assembly.
#pragma once

#include "peers.hpp"

#include <iim/iim.hpp>
#include <iim/models.hpp>

#include <map>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

namespace peers {

/// Which motors are inputs.
enum class Motors { all, last };

/// Motors::last: that of the last joint only. `contacts`: names of frames of the assembly.
struct Case {
  std::string name;
  iim::StandardAssembly<double> assembly;
  Motors motors = Motors::all;
  std::vector<std::string> contacts{};
};

/// Neutral description of an assembly of rigid links, floating bases and motor-arms without rotors.
/// Throws std::invalid_argument for what the other libraries do not have.
inline Model describe(const Case& scene)
{
  Model model;
  model.name = scene.name;
  model.gravity = scene.assembly.gravity();
  std::map<std::string, int> index;
  for (const auto& part : scene.assembly.sorted()) {
    Joint joint;
    joint.name = part.name;
    joint.parent = part.parent;
    joint.R = part.on.R;
    joint.p = part.on.p;
    joint.axis.setZero();
    joint.q = model.n_q;
    joint.v = model.n_v;
    std::visit(
        [&]<class S>(const S& s) {
          if constexpr (std::is_same_v<S, iim::FloatingBase<double>>) {
            joint.kind = JointKind::floating;
          } else if constexpr (S::n_i == 1) {
            joint.kind = S::pattern.angular ? JointKind::revolute : JointKind::prismatic;
            joint.axis = s.joint.axis;
            if constexpr (requires { s.motor; }) {
              if (s.motor.gear_ratio != 1 || s.motor.axial_inertia != 0 || s.motor.mass != 0) {
                throw std::invalid_argument("'" + part.name + "': a motor with a rotor has no common description");
              }
            }
          } else {
            throw std::invalid_argument("'" + part.name + "': a fixed link must be merged before");
          }
          joint.mass = s.body.mass;
          joint.com = s.body.com;
          joint.inertia = s.body.inertia;
          model.n_q += S::n_q;
          model.n_v += S::n_i;
        },
        part.part);
    index[part.name] = static_cast<int>(model.joints.size());
    model.joints.push_back(joint);
  }
  for (const Joint& joint : model.joints) {
    const bool last = &joint == &model.joints.back();
    if (joint.kind != JointKind::floating && (scene.motors == Motors::all || last)) { model.motors.push_back(joint.v); }
  }
  for (const auto& frame : scene.assembly.named_frames()) {
    for (const std::string& name : scene.contacts) {
      if (frame.name == name) { model.contacts.push_back({name, index.at(frame.on.parent), frame.on.p}); }
    }
  }
  if (model.contacts.size() != scene.contacts.size()) {
    throw std::invalid_argument(scene.name + ": a contact is missing");
  }
  return model;
}

/// Seven-axis arm of our own dimensions, about those of a 18 kg lightweight arm: roll and pitch joints in turn.
inline iim::StandardAssembly<double> seven_axis_arm()
{
  const double lengths[7] = {0.33, 0.0, 0.32, 0.08, 0.38, 0.09, 0.11};
  const double masses[7] = {3.1, 2.9, 3.2, 2.6, 2.3, 1.6, 0.9};
  iim::StandardAssembly<double> assembly;
  double reach = 0;
  for (int k = 0; k < 7; ++k) {
    iim::RevoluteLink<double> link;
    link.joint.axis = k % 2 == 0 ? Vector3d::UnitZ() : Vector3d::UnitY();
    link.body.mass = masses[k];
    link.body.com = Vector3d(0.01 * (k % 3), 0.01 * (k % 2), 0.06 + 0.4 * lengths[k]);
    link.body.inertia.diagonal() << 0.004 * masses[k], 0.0045 * masses[k], 0.002 * masses[k];
    iim::Attachment<double> on;
    if (k > 0) { on.parent = "axis" + std::to_string(k); }
    on.p.z() = reach;
    reach = lengths[k];
    assembly.add("axis" + std::to_string(k + 1), on, link);
  }
  return assembly;
}

/// Models of the study. `longest`: chains and trees with more links are left out.
inline std::vector<Model> models(Index longest)
{
  std::vector<Model> list;
  const auto add = [&list](const Case& scene) { list.push_back(describe(scene)); };
  for (const Index n : {1, 2, 5, 10, 12, 20, 50, 100, 200, 500, 1000}) {
    if (n > longest) { continue; }
    add({"chain " + std::to_string(n), iim::models::chain<double>(n)});
    if (n > 1) { add({"chain " + std::to_string(n) + ", last motor", iim::models::chain<double>(n), Motors::last}); }
  }
  for (const Index n : {15, 63, 127, 255}) {
    if (n <= longest) { add({"tree " + std::to_string(n), iim::models::binary_tree<double>(n)}); }
  }
  const auto biped = iim::models::biped<double>(iim::models::Motors::ideal);
  const auto& contacts = iim::models::biped_contacts;
  add({"biped, both feet", biped, Motors::all, {contacts.begin(), contacts.end()}});
  add({"biped, left foot", biped, Motors::all, {contacts.begin(), contacts.begin() + 4}});
  add({"biped, no contact", biped});
  add({"seven-axis arm", seven_axis_arm()});
  return list;
}

}  // namespace peers
