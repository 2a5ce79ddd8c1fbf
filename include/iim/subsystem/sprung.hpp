// Springs and dampers on the internal coordinates of any subsystem.
#pragma once

#include <iim/subsystem.hpp>
#include <iim/subsystem/motor_arm.hpp>
#include <iim/subsystem/rigid_link.hpp>

#include <array>
#include <cstddef>
#include <string>

namespace iim {

/// A subsystem with a spring and a damper on each of its coordinates. Left-hand side of (10): stiffness (q − rest) +
/// damping q̇. All else as the subsystem itself.
template <class Part>
struct Sprung : Part {
  using Scalar = typename Part::Scalar;
  static constexpr int n_i = Part::n_i;
  static_assert(Part::n_q == Part::n_i, "springs act on coordinates that are the integrals of velocities");
  static_assert(!detail::has_internal_force<Part>(), "the subsystem has internal forces of its own");
  using Coordinates = Eigen::Matrix<Scalar, n_i, 1>;

  Coordinates stiffness = Coordinates::Zero();  ///< [N m/rad, N/m]
  Coordinates damping = Coordinates::Zero();    ///< [N m s/rad, N s/m]
  Coordinates rest = Coordinates::Zero();       ///< coordinates without a force

  void prepare(const std::string& name)
  {
    Part::prepare(name);
    for (const Coordinates& values : {stiffness, damping}) {
      for (int d = 0; d < n_i; ++d) {
        if (!(values(d) >= Scalar(0)) || !detail::is_finite(values(d))) {
          detail::refuse(
              {name, ": stiffness and damping must be finite and not negative, got ", detail::to_text(values(d))});
        }
      }
    }
    if (!detail::all_finite(rest)) {
      detail::refuse({name, ": rest position must be finite, got ", detail::to_text(rest)});
    }
  }

  Coordinates internal_force(const Coordinates& q, const Coordinates& qd) const
  {
    return stiffness.cwiseProduct(q - rest) + damping.cwiseProduct(qd);
  }

  std::array<Spring<Scalar, n_i>, n_i> springs(const Coordinates& q, const Coordinates& qd) const
  {
    const Coordinates force = internal_force(q, qd);
    std::array<Spring<Scalar, n_i>, n_i> springs;
    for (int d = 0; d < n_i; ++d) {
      springs[static_cast<std::size_t>(d)] = {Eigen::Matrix<Scalar, 1, n_i>::Unit(d), stiffness(d), damping(d),
                                              force(d)};
    }
    return springs;
  }

  /// Energy in the springs [J].
  Scalar potential(const Coordinates& q) const { return (q - rest).dot(stiffness.cwiseProduct(q - rest)) / Scalar(2); }

  /// Power lost in the dampers [W].
  Scalar dissipation(const Coordinates&, const Coordinates& qd) const { return qd.dot(damping.cwiseProduct(qd)); }

  template <class T>
  auto cast() const
  {
    const Part& part = *this;
    return Sprung<decltype(part.template cast<T>())>{part.template cast<T>(), stiffness.template cast<T>(),
                                                     damping.template cast<T>(), rest.template cast<T>()};
  }
};

static_assert(Subsystem<Sprung<RevoluteLink<double>>>);
static_assert(Subsystem<Sprung<MotorArm<double>>>);

}  // namespace iim
