// Flexible link: a slender beam behind a joint, bending and twisting in a few Ritz functions.
#pragma once

#include <iim/errors.hpp>
#include <iim/numerics/array.hpp>
#include <iim/subsystem.hpp>
#include <iim/subsystem/joint.hpp>
#include <iim/subsystem/relative_motion.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string>

namespace iim {

/// A uniform beam along the link's x, clamped to the link's frame, the tip free. q: the joint's coordinates, then the
/// amplitudes of n_y functions of bending along y, n_z along z and n_t of torsion [rad]. Inputs: those of the joint.
///
/// With ξ = s/L and P_k the Legendre polynomials on 0 … 1, curvature and twist are Σ a_k P_k(ξ)/L: deflection
/// v = L Σ a_k φ_k, φ_k'' = P_k, φ_k(0) = φ_k'(0) = 0. The first two hold the static deflection under a force at the
/// tip exactly, and stiffness is diagonal. A section moves by (u, v, w) and turns by v' about z, −w' about y, then its
/// twist. `shortening` draws it in by u = −½ ∫ (v'² + w'²) ds, second order in the amplitudes: it makes a rotating beam
/// stiffer.
///
/// Mass is not lumped but integrated: the frames behind the first are sections at Gauss points that carry their share
/// (weight × length × mass and rotary inertia per length) with their exact Jacobians, enough of them to integrate the
/// inertia of an undeformed beam without error. Frame 0 is the tip, for children and forces.
template <class Joint, int n_y, int n_z, int n_t = 0>
struct FlexibleLink {
  using Scalar = typename Joint::Scalar;
  static_assert(Joint::n_q == Joint::n_i, "the joint's coordinates must be integrals of its velocities");
  static_assert(n_y >= 0 && n_z >= 0 && n_t >= 0 && n_y + n_z + n_t >= 1);
  static constexpr int n_joint = Joint::n_i;
  static constexpr int n_i = n_joint + n_y + n_z + n_t;
  static constexpr int n_q = n_i;
  static constexpr int n_u = n_joint;
  static constexpr int n_functions = std::max({n_y, n_z, n_t});
  static constexpr int n_sections = n_functions + 2;  // φ² has degree 2 (n + 1)
  static constexpr int n_frames = 1 + n_sections;
  static constexpr MotionPattern pattern{};
  using Coordinates = Eigen::Matrix<Scalar, n_i, 1>;
  using Moving = RelativeMotion<Scalar, n_i>;

  Joint joint{};
  Scalar length = Scalar(1);           ///< [m]
  Scalar mass_per_length = Scalar(1);  ///< [kg/m]
  Scalar bending_y = Scalar(1);        ///< bending stiffness EI for deflection along y [N m²]
  Scalar bending_z = Scalar(1);        ///< the same along z
  Scalar torsion = Scalar(1);          ///< torsional stiffness GJ [N m²]
  Scalar rotary_y = Scalar(0);         ///< rotary inertia ρI of a section about its y, per length [kg m]
  Scalar rotary_z = Scalar(0);         ///< about its z; about x it is their sum
  Scalar damping = Scalar(0);          ///< structural: strain rate counts this much as strain [s]
  bool shortening = true;

  void prepare(const std::string& name)
  {
    joint.prepare(name);
    const auto check = [&](const Scalar& x, bool zero_too, const char* what) {
      if (!(x > Scalar(0) || (zero_too && x == Scalar(0))) || !detail::is_finite(x)) {
        detail::refuse({name, ": ", what,
                        (zero_too ? " must be finite and not negative, got " : " must be positive and finite, got "),
                        detail::to_text(x)});
      }
    };
    check(length, false, "length");
    check(mass_per_length, false, "mass per length");
    check(bending_y, n_y == 0, "bending stiffness y");
    check(bending_z, n_z == 0, "bending stiffness z");
    check(torsion, n_t == 0, "torsional stiffness");
    check(rotary_y, n_t == 0 || rotary_z > Scalar(0), "rotary inertia y");
    check(rotary_z, true, "rotary inertia z");
    check(damping, true, "damping");
    tabulate();
  }

  bool motion(const Matrix3<Scalar>& R, const Coordinates& q, const Coordinates& qd,
              std::array<FrameMotion<Scalar, n_i>, static_cast<std::size_t>(n_frames)>& frames) const
  {
    const auto x = independent<Scalar, n_i>(q, qd);
    Moving root;
    const bool ok = clamp(q, qd, root);
    for (int k = 0; k < n_frames; ++k) { section(root, x, table_[detail::at(k)]).write(R, frames[detail::at(k)]); }
    return ok;
  }

  std::array<CarriedBody<Scalar>, static_cast<std::size_t>(n_sections)> bodies() const
  {
    std::array<CarriedBody<Scalar>, static_cast<std::size_t>(n_sections)> all;
    for (int k = 0; k < n_sections; ++k) {
      const Scalar share = table_[detail::at(k + 1)].weight * length;
      Body<Scalar> body;
      body.mass = share * mass_per_length;
      body.inertia.diagonal() << share * (rotary_y + rotary_z), share * rotary_y, share * rotary_z;
      all[detail::at(k)] = {k + 1, body};
    }
    return all;
  }

  Eigen::Matrix<Scalar, n_i, n_u> Bbar(const Coordinates&) const { return Eigen::Matrix<Scalar, n_i, n_u>::Identity(); }

  /// Stiffness per amplitude; zero for the joint [N m/rad].
  Coordinates stiffness() const
  {
    Coordinates k = Coordinates::Zero();
    const auto fill = [&](int first, int count, const Scalar& EI) {
      for (int j = 0; j < count; ++j) { k(first + j) = EI / length / Scalar(2 * j + 1); }
    };
    fill(n_joint, n_y, bending_y);
    fill(n_joint + n_y, n_z, bending_z);
    fill(n_joint + n_y + n_z, n_t, torsion);
    return k;
  }

  Coordinates internal_force(const Coordinates& q, const Coordinates& qd) const
  {
    return stiffness().cwiseProduct(q + damping * qd);
  }
  std::array<Spring<Scalar, n_i>, n_i> springs(const Coordinates& q, const Coordinates& qd) const
  {
    const Coordinates k = stiffness(), force = internal_force(q, qd);
    std::array<Spring<Scalar, n_i>, n_i> springs;
    for (int d = 0; d < n_i; ++d) {
      springs[static_cast<std::size_t>(d)] = {Eigen::Matrix<Scalar, 1, n_i>::Unit(d), k(d), damping * k(d), force(d)};
    }
    return springs;
  }
  Scalar potential(const Coordinates& q) const { return q.dot(stiffness().cwiseProduct(q)) / Scalar(2); }
  Scalar dissipation(const Coordinates&, const Coordinates& qd) const
  {
    return damping * qd.dot(stiffness().cwiseProduct(qd));
  }

  template <class T>
  auto cast() const
  {
    FlexibleLink<decltype(joint.template cast<T>()), n_y, n_z, n_t> other;
    other.joint = joint.template cast<T>();
    other.length = T(length);
    other.mass_per_length = T(mass_per_length);
    other.bending_y = T(bending_y);
    other.bending_z = T(bending_z);
    other.torsion = T(torsion);
    other.rotary_y = T(rotary_y);
    other.rotary_z = T(rotary_z);
    other.damping = T(damping);
    other.shortening = shortening;
    return other;
  }

private:
  using Row = Eigen::Matrix<Scalar, n_functions, 1>;

  /// The functions at one section.
  struct Section {
    Scalar xi = Scalar(1);
    Scalar weight = Scalar(0);
    Row deflection, slope, twist;                           // φ_k, φ_k', ∫ P_k
    Eigen::Matrix<Scalar, n_functions, n_functions> drawn;  // ∫ φ_j' φ_k' from the clamp to ξ
  };

  /// P_0 … P_{n+1} on 0 … 1.
  static std::array<Scalar, static_cast<std::size_t>(n_functions) + 2> legendre(const Scalar& xi)
  {
    std::array<Scalar, static_cast<std::size_t>(n_functions) + 2> P;
    const Scalar t = Scalar(2) * xi - Scalar(1);
    P[0] = Scalar(1);
    P[1] = t;
    for (int k = 1; k <= n_functions; ++k) {
      P[detail::at(k + 1)] =
          (Scalar(2 * k + 1) * t * P[detail::at(k)] - Scalar(k) * P[detail::at(k - 1)]) / Scalar(k + 1);
    }
    return P;
  }

  /// ∫ P_k = (P_{k+1} − P_{k−1})/(2 (2k + 1)), P_{−1} = −1 here: zero at the clamp for k = 0, and for k > 0 anyway.
  static Row integrals(const Scalar& xi)
  {
    const auto P = legendre(xi);
    Row I;
    for (int k = 0; k < n_functions; ++k) {
      const Scalar below = k == 0 ? Scalar(-1) : P[detail::at(k - 1)];
      I(k) = (P[detail::at(k + 1)] - below) / Scalar(2 * (2 * k + 1));
    }
    return I;
  }

  /// Gauss points and weights on 0 … 1: roots of P_{n_sections}, by Newton.
  static void gauss(std::array<Scalar, static_cast<std::size_t>(n_sections)>& xi,
                    std::array<Scalar, static_cast<std::size_t>(n_sections)>& weight)
  {
    using std::cos;
    constexpr int n = n_sections;
    for (int k = 0; k < n; ++k) {
      Scalar t = cos(Scalar(3.14159265358979323846) * (Scalar(k) + Scalar(0.75)) / (Scalar(n) + Scalar(0.5)));
      Scalar slope(1);
      for (int step = 0; step < 12; ++step) {
        Scalar before(1), P = t;
        for (int j = 1; j < n; ++j) {
          const Scalar next = (Scalar(2 * j + 1) * t * P - Scalar(j) * before) / Scalar(j + 1);
          before = P;
          P = next;
        }
        slope = Scalar(n) * (before - t * P) / (Scalar(1) - t * t);
        t -= P / slope;
      }
      xi[detail::at(k)] = (Scalar(1) - t) / Scalar(2);
      weight[detail::at(k)] = Scalar(1) / ((Scalar(1) - t * t) * slope * slope);
    }
  }

  void tabulate()
  {
    std::array<Scalar, static_cast<std::size_t>(n_sections)> xi, weight;
    gauss(xi, weight);
    for (int k = 0; k < n_frames; ++k) {
      Section& s = table_[detail::at(k)];
      s.xi = k == 0 ? Scalar(1) : xi[detail::at(k - 1)];
      s.weight = k == 0 ? Scalar(0) : weight[detail::at(k - 1)];
      s.slope = integrals(s.xi);
      s.twist = s.slope;
      // By Gauss on 0 … ξ, exact: φ_k' has degree k + 1.
      s.deflection.setZero();
      s.drawn.setZero();
      for (std::size_t g = 0; g < xi.size(); ++g) {
        const Row slope = integrals(s.xi * xi[g]);
        s.deflection += (s.xi * weight[g]) * slope;
        s.drawn += (s.xi * weight[g]) * (slope * slope.transpose()).eval();  // a product of 1 × 1 may pass for a Scalar
      }
    }
  }

  /// The joint's motion in inlet axes.
  bool clamp(const Coordinates& q, const Coordinates& qd, Moving& root) const
  {
    Eigen::Matrix<Scalar, 6, n_joint> S = Eigen::Matrix<Scalar, 6, n_joint>::Zero();
    Vector6<Scalar> bias = Vector6<Scalar>::Zero();
    FrameMotion<Scalar, n_joint> m{root.R, root.p, S, bias};
    const Eigen::Matrix<Scalar, n_joint, 1> q_j = q.template head<n_joint>(), qd_j = qd.template head<n_joint>();
    const bool ok = joint.motion(Matrix3<Scalar>::Identity(), q_j, qd_j, m);
    root.alpha = bias.template tail<3>();
    root.a = bias.template head<3>();
    if constexpr (n_joint > 0) {
      for (int d = 0; d < n_joint; ++d) {
        const Vector3<Scalar> w = S.template block<3, 1>(3, d);
        root.w.col(d) = w;
        root.v.col(d) = S.template block<3, 1>(0, d);
        if constexpr (!Joint::pattern.about_frame) { root.v.col(d) += detail::cross(w, root.p); }
        root.omega += w * qd(d);
        root.velocity += root.v.col(d) * qd(d);
      }
    }
    if constexpr (!Joint::pattern.about_frame) {
      root.a += detail::cross(root.alpha, root.p) + detail::cross(root.omega, detail::cross(root.omega, root.p));
    }
    return ok;
  }

  Moving section(const Moving& root, const std::array<Dependent<Scalar, n_i>, static_cast<std::size_t>(n_i)>& x,
                 const Section& s) const
  {
    using D = Dependent<Scalar, n_i>;
    const auto sum = [&](int first, int count, const Row& functions) {
      D total;
      for (int k = 0; k < count; ++k) { total = total + x[detail::at(first + k)] * D(functions(k)); }
      return total;
    };
    D along(s.xi * length);
    if (shortening) {
      const auto draw = [&](int first, int count) {
        for (int j = 0; j < count; ++j) {
          D row;
          for (int k = 0; k < count; ++k) { row = row + x[detail::at(first + k)] * D(s.drawn(j, k)); }
          along = along - D(length / Scalar(2)) * x[detail::at(first + j)] * row;
        }
      };
      draw(n_joint, n_y);
      draw(n_joint + n_y, n_z);
    }
    const Vector3<Scalar> e1 = Vector3<Scalar>::UnitX(), e2 = Vector3<Scalar>::UnitY(), e3 = Vector3<Scalar>::UnitZ();
    Moving moved = root.slid(e1, along);
    if constexpr (n_y > 0) {
      moved = moved.slid(e2, D(length) * sum(n_joint, n_y, s.deflection)).turned(e3, sum(n_joint, n_y, s.slope));
    }
    if constexpr (n_z > 0) {
      // Displaced along the clamp's z, which the turn about z above leaves where it was.
      moved = moved.slid(e3, D(length) * sum(n_joint + n_y, n_z, s.deflection))
                  .turned(e2, -sum(n_joint + n_y, n_z, s.slope));
    }
    if constexpr (n_t > 0) { moved = moved.turned(e1, sum(n_joint + n_y + n_z, n_t, s.twist)); }
    return moved;
  }

  std::array<Section, static_cast<std::size_t>(n_frames)> table_{};
};

static_assert(Subsystem<FlexibleLink<Revolute<double>, 2, 2, 1>>);

}  // namespace iim
