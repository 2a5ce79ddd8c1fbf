// PART OF: iim_accuracy
// Plain scenes, and the extreme ones by name.
#include "accuracy.hpp"

#include <iim/models.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>

namespace bench {

namespace {

using Parts = iim::StandardAssembly<double>;
using Link = iim::RevoluteLink<double>;
using Vec3 = iim::Vector3<double>;

/// A rod of given mass and length along −z, hung at its upper end, about a coordinate axis.
Link rod(double mass, double length, int axis)
{
  Link link;
  link.joint.axis = Vec3::Unit(axis);
  link.body.mass = mass;
  link.body.com = Vec3(0, 0, -length / 2);
  link.body.inertia.diagonal() << mass * length * length / 10, mass * length * length / 10,
      mass * length * length / 100;
  return link;
}

struct Rod {
  double mass = 1;
  double length = 1;
  int axis = 0;
};

Parts chain(Index n, const std::function<Rod(Index)>& rod_at)
{
  Parts parts;
  for (Index i = 0; i < n; ++i) {
    iim::Attachment<double> on;
    if (i > 0) {
      const Rod before = rod_at(i - 1);
      on.parent = "link" + std::to_string(i - 1);
      on.p = Vec3(before.length / 8, 0, -before.length);
    }
    const Rod own = rod_at(i);
    parts.add("link" + std::to_string(i), on, rod(own.mass, own.length, own.axis));
  }
  return parts;
}

Parts alternating(Index n)
{
  return chain(n, [](Index i) { return Rod{1, 1, static_cast<int>(i % 2)}; });
}

/// The arm of all load cases: seven links of 1 kg and 0.4 m, axes in turn, and a load on the last.
Parts loaded_arm(double load, double wrist_length = 0.4)
{
  return chain(7, [=](Index i) {
    const double length = i >= 4 ? wrist_length : 0.4;
    return Rod{i == 6 ? load : 1.0, i == 6 ? 0.4 : length, static_cast<int>(i % 3)};
  });
}

Parts moved_to(Parts parts, double distance)
{
  Parts moved;
  for (const auto& part : parts.parts()) {
    auto on = part.on;
    if (on.parent == "world") { on.p += Vec3(distance, -distance, distance); }
    std::visit([&](const auto& s) { moved.add(part.name, on, s); }, part.part);
  }
  for (const auto& frame : parts.named_frames()) { moved.add_frame(frame.name, frame.on); }
  return moved;
}

/// The paper's biped with the masses of its base divided: limbs heavier than the base.
Parts light_base_biped(double ratio)
{
  const Parts biped = iim::models::biped<double>();
  Parts parts;
  for (const auto& part : biped.parts()) {
    std::visit(
        [&](auto s) {
          if constexpr (requires { s.is_free; }) {
            s.body.mass /= ratio;
            s.body.inertia /= ratio;
          }
          parts.add(part.name, part.on, s);
        },
        part.part);
  }
  for (const auto& frame : biped.named_frames()) { parts.add_frame(frame.name, frame.on); }
  return parts;
}

std::vector<std::string> biped_points()
{
  return {iim::models::biped_contacts.begin(), iim::models::biped_contacts.end()};
}

/// The arm with a motor at every joint, the rotor's axis along the joint's.
Parts geared(const Parts& arm, double ratio, double rotor_inertia)
{
  Parts result;
  for (const auto& part : arm.parts()) {
    std::visit(
        [&](const auto& s) {
          if constexpr (std::is_same_v<std::remove_cvref_t<decltype(s)>, Link>) {
            iim::MotorArm<double> motor_arm{s.joint, s.body, {}};
            motor_arm.motor.gear_ratio = ratio;
            motor_arm.motor.axial_inertia = rotor_inertia;
            motor_arm.motor.axis = s.joint.axis;
            result.add(part.name, part.on, motor_arm);
          }
        },
        part.part);
  }
  return result;
}

/// A chain whose joint axes nearly coincide in pairs, 2⁻²⁰ m and rad apart, askew.
Parts near_coincident(Index n)
{
  const double apart = std::ldexp(1.0, -20);
  Parts parts;
  const Parts before = chain(n, [=](Index i) { return Rod{1, i % 2 == 0 ? apart : 1.0, static_cast<int>(i / 2 % 2)}; });
  Index i = 0;
  for (const auto& part : before.parts()) {
    std::visit(
        [&](auto s) {
          if constexpr (std::is_same_v<decltype(s), Link>) {
            s.joint.axis((i / 2 + 1) % 2) = apart * static_cast<double>(i % 3 - 1);
            s.joint.axis(2) = apart * static_cast<double>(i % 2);
          }
          parts.add(part.name, part.on, s);
        },
        part.part);
    ++i;
  }
  return parts;
}

constexpr std::uint64_t seed = 4711;

void fill(AccuracyScene& scene, int count, double speed = 1, double spread = 1)
{
  const Tree<double> tree(scene.parts);
  scene.states = random_states(tree, 0, count, seed);
  for (State<double>& x : scene.states) {
    x.qd *= speed;
    if (spread != 1) { x.q *= spread; }
  }
}

}  // namespace

std::vector<AccuracyScene> accuracy_scenes(bool quick, int states)
{
  std::vector<AccuracyScene> scenes;
  const int count = states > 0 ? states : quick ? 5 : 100;
  const auto add = [&](AccuracyScene scene, double speed = 1, double spread = 1) {
    fill(scene, scene.timed && states == 0 ? 32 : count, speed, spread);
    scenes.push_back(std::move(scene));
  };

  add({"arm of 7", "plain", 7, loaded_arm(1), {}, {}, true});
  add({"biped, 38 inputs", "plain", 20, iim::models::biped<double>(), biped_points(), {}, true});
  add({"chain of 20", "plain", 20, alternating(20), {}, {}, true});
  add({"tree of 63", "plain", 63, iim::models::binary_tree<double>(63), {}, {}, true});
  add({"chain of 100", "plain", 100, alternating(100), {}, {}, true});

  std::vector<Index> lengths{5, 10, 20, 50, 100};
  if (!quick) { lengths.insert(lengths.end(), {200, 500, 1000}); }
  for (const Index n : lengths) {
    AccuracyScene scene{"chain of " + std::to_string(n), "length", static_cast<double>(n), alternating(n)};
    fill(scene, states > 0 ? states : quick ? 1 : n >= 500 ? 2 : 5);
    scenes.push_back(std::move(scene));
  }

  for (const double decades : {0.0, 2.0, 4.0, 6.0, 9.0, 12.0}) {
    const double load = std::pow(10.0, decades);
    add({"load 1e" + std::to_string(static_cast<int>(decades)) + " kg on seven links", "mass ratio", load,
         loaded_arm(load)});
  }
  for (const double distance : {0.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6}) {
    add({"arm at " + std::to_string(static_cast<long>(distance)) + " m", "distance", std::max(distance, 1.0),
         moved_to(loaded_arm(1), distance)});
  }

  const auto extreme = [&](const std::string& name, const Parts& parts, double speed = 1, double spread = 1,
                           const std::vector<std::string>& points = {}) {
    add({name, "extreme", 0, parts, points}, speed, spread);
  };
  extreme("mass × 10 per link outward, 12 links",
          chain(12, [](Index i) { return Rod{std::pow(10.0, static_cast<double>(i)), 1, static_cast<int>(i % 2)}; }));
  extreme("mass ÷ 10 per link outward, 12 links",
          chain(12, [](Index i) { return Rod{std::pow(10.0, -static_cast<double>(i)), 1, static_cast<int>(i % 2)}; }));
  extreme("mass × 10 per link outward, 13 links",
          chain(13, [](Index i) { return Rod{std::pow(10.0, static_cast<double>(i)), 1, static_cast<int>(i % 2)}; }));
  extreme("mass ÷ 10 per link outward, 13 links",
          chain(13, [](Index i) { return Rod{std::pow(10.0, -static_cast<double>(i)), 1, static_cast<int>(i % 2)}; }));
  extreme("masses of 1 and 1e12 kg in turn, 8 links",
          chain(8, [](Index i) { return Rod{i % 2 == 1 ? 1e12 : 1.0, 1, static_cast<int>(i % 3)}; }));
  extreme("links of 1 mm between links of 1 m, 12",
          chain(12, [](Index i) { return Rod{1, i % 2 == 1 ? 1e-3 : 1.0, static_cast<int>(i % 3)}; }));
  extreme("load 1e6 kg on a 10 mm wrist", loaded_arm(1e6, 0.01));
  extreme("load 1e9 kg on a 10 mm wrist", loaded_arm(1e9, 0.01));
  extreme("parallel axes, 20 links", chain(20, [](Index) { return Rod{1, 1, 1}; }));
  extreme("near-coincident axes: 1e-6 m apart, 8 links",
          chain(8, [](Index i) { return Rod{1, i % 2 == 0 ? 1e-6 : 1.0, 1}; }));
  extreme("near-coincident axes in pairs, 1e-6 m and rad, 8 links", near_coincident(8));
  extreme("gear ratio 1000, rotor 1e6 times the arm", geared(loaded_arm(1), 1e3, 1e-2));
  extreme("gear ratio 1000, rotor as the arm", geared(loaded_arm(1), 1e3, 1e-8));
  // Rotor and arm turn together: A' = ΘJ(1 − ratio)² / (Θ + J ratio²) is all that the parent feels of them.
  extreme("rotor and arm nearly locked: gear ratio 1 + 1e-6",
          geared(chain(6, [](Index i) { return Rod{i % 2 == 0 ? 1e-6 : 1.0, 0.4, 2}; }), 1 + 1e-6, 1e-2));
  extreme("speeds of 1e3 rad/s", loaded_arm(1), 1e3);
  extreme("masses of 1e300 kg", chain(5, [](Index i) { return Rod{1e300, 1, static_cast<int>(i % 2)}; }));
  extreme("masses of 1e-306 kg, subnormal thin moments",
          chain(5, [](Index i) { return Rod{1e-306, 1, static_cast<int>(i % 2)}; }));
  extreme("masses of 1e-310 kg: B̂ is no double",
          chain(5, [](Index i) { return Rod{1e-310, 1, static_cast<int>(i % 2)}; }));
  extreme("masses of 1e-300 kg", chain(5, [](Index i) { return Rod{1e-300, 1, static_cast<int>(i % 2)}; }));
  {
    Parts parts = chain(4, [](Index i) { return Rod{1, 1, static_cast<int>(i % 2)}; });
    Link tip;
    tip.joint.axis = Vec3::UnitX();
    tip.body = iim::Body<double>::massless();
    iim::Attachment<double> on;
    on.parent = "link3";
    on.p = Vec3(0, 0, -1);
    parts.add("tip", on, tip);
    extreme("massless distal link", parts);
  }
  {
    Parts parts;
    const Parts before = chain(6, [](Index i) { return Rod{1, 1, static_cast<int>(i % 2)}; });
    for (const auto& part : before.parts()) {
      std::visit(
          [&](auto s) {
            if (part.name == "link2") { s.body = iim::Body<double>::massless(); }
            parts.add(part.name, part.on, s);
          },
          part.part);
    }
    extreme("massless middle link", parts);
  }
  extreme("biped, base 1e6 times lighter", light_base_biped(1e6), 1, 1, biped_points());
  {
    AccuracyScene scene{"biped 1e6 m from the origin", "extreme", 0, iim::models::biped<double>(), biped_points()};
    fill(scene, count);
    for (State<double>& x : scene.states) { x.q.head<3>() += Vec3(1e6, -1e6, 1e6); }
    scenes.push_back(std::move(scene));
  }
  extreme("stretched arm: kinematic singularity", loaded_arm(1), 1, 0);
  return scenes;
}

}  // namespace bench
