// A robot whose every number is off by at most one ε of double: what no algorithm that is given rounded data can beat.
#pragma once

#include "../common/pool.hpp"

#include <iim/iim.hpp>

#include <limits>
#include <random>
#include <variant>

namespace bench {

/// Every length (of the points of forces, too), mass, inertia and gear ratio times 1 + ε ξ, every axis turned by angles
/// ε ξ; ξ uniform in (−1, 1).
template <class Digits>
iim::StandardAssembly<Digits> perturbed(const iim::StandardAssembly<Digits>& parts, std::mt19937_64& source)
{
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const auto move = [&](auto& x) { x *= Digits(1) + Digits(std::numeric_limits<double>::epsilon() * uniform(source)); };
  const auto move_body = [&](iim::Body<Digits>& body) {
    if (body.is_massless) { return; }
    move(body.mass);
    for (int i = 0; i < 3; ++i) {
      move(body.com(i));
      for (int j = i; j < 3; ++j) {
        move(body.inertia(i, j));
        body.inertia(j, i) = body.inertia(i, j);
      }
    }
  };
  iim::StandardAssembly<Digits> other;
  for (const auto& part : parts.parts()) {
    auto on = part.on;
    for (int i = 0; i < 3; ++i) { move(on.p(i)); }
    const iim::Vector3<Digits> turn(uniform(source), uniform(source), uniform(source));
    on.R += iim::Matrix3<Digits>(iim::skew(turn) * on.R) * Digits(std::numeric_limits<double>::epsilon());
    std::visit(
        [&](auto s) {
          move_body(s.body);
          if constexpr (requires { s.motor; }) {
            move(s.motor.gear_ratio);
            move(s.motor.axial_inertia);
            move(s.motor.transverse_inertia);
            move(s.motor.mass);
            for (int i = 0; i < 3; ++i) { move(s.motor.com(i)); }
          }
          other.add(part.name, on, s);
        },
        part.part);
  }
  for (const auto& frame : parts.named_frames()) {
    auto on = frame.on;
    for (int i = 0; i < 3; ++i) { move(on.p(i)); }
    other.add_frame(frame.name, on);
  }
  other.set_gravity(parts.gravity());
  return other;
}

/// q and q̇ in the same way.
template <class Digits>
State<Digits> perturbed(State<Digits> x, std::mt19937_64& source)
{
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (auto* vector : {&x.q, &x.qd}) {
    for (Index i = 0; i < vector->size(); ++i) {
      (*vector)(i) *= Digits(1) + Digits(std::numeric_limits<double>::epsilon() * uniform(source));
    }
  }
  return x;
}

}  // namespace bench
