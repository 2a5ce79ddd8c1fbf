// Kinematics, energy and inertia of a tree as an observer sees them: from the motion(), bodies() and rotors() of its
// subsystems, summed body by body. What the law suite compares the library with.
#pragma once

#include <iim/iim.hpp>

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

namespace iim {

namespace detail {

struct Observation {
  std::vector<Eigen::Vector3d> origin;  // of each frame, world
  std::vector<Eigen::Matrix3d> R;
  std::vector<Eigen::Vector3d> v, omega;  // of each frame's origin
  std::vector<Eigen::Vector3d> coupling;  // point of each subsystem, world
  double kinetic = 0, potential = 0;

  /// Twist of a frame at its point that is `arm` (frame axes) from its origin.
  Vector6<double> twist(Index frame, const Eigen::Vector3d& arm) const
  {
    const auto f = static_cast<std::size_t>(frame);
    Vector6<double> V;
    V << v[f] + omega[f].cross(R[f] * arm), omega[f];
    return V;
  }
};

inline double body_energy(const FrameMass<double>& body, const Eigen::Matrix3d& R, const Eigen::Vector3d& v,
                          const Eigen::Vector3d& omega)
{
  if (!body.present) { return 0; }
  const Eigen::Vector3d v_c = v + omega.cross(R * body.com);
  const Eigen::Vector3d turning = R.transpose() * omega;
  return (body.mass * v_c.squaredNorm() + turning.dot(body.central_inertia * turning)) / 2;
}

/// Placements, velocities and energy of all frames: orientations and Jacobians as the library's first loop leaves them
/// (checks.hpp compares these with differences), velocities and energies from them and the bodies by formulas of its
/// own.
template <class Tree>
Observation observe(const Tree& tree, const Eigen::VectorXd& q, const Eigen::VectorXd& qd)
{
  Workspace ws(tree);
  static_cast<void>(forward_dynamics(q, qd, ws));  // of this the first loop, which a failure of the others leaves
  Observation o;
  const auto frames = static_cast<std::size_t>(tree.n_frames());
  o.origin.resize(frames);
  o.R.resize(frames);
  o.v.resize(frames);
  o.omega.resize(frames);
  std::vector<Eigen::Vector3d>& coupling = o.coupling;
  coupling.resize(static_cast<std::size_t>(tree.size()));
  tree.outward([&]<class N, class S>(const N& node, const S& s) {
    const NodeState<S>& state = ws.template node<S>(node);
    Eigen::Vector3d v = Eigen::Vector3d::Zero(), omega = v, x = state.r;
    if (node.inlet >= 0) {
      const auto inlet = static_cast<std::size_t>(node.inlet);
      x += coupling[static_cast<std::size_t>(node.parent)];
      omega = o.omega[inlet];
      v = o.v[inlet] + omega.cross(x - o.origin[inlet]);
    }
    coupling[static_cast<std::size_t>(node.index)] = x;
    const Velocities<S> qd_i = qd.template segment<S::n_i>(node.v);
    for (int k = 0; k < S::n_frames; ++k) {
      const auto f = static_cast<std::size_t>(node.frame + k);
      const Vector6<double> relative = state.S_k[static_cast<std::size_t>(k)] * qd_i;
      o.R[f] = ws.frame(node.frame + k).R;
      o.origin[f] = x + ws.frame(node.frame + k).r;
      o.omega[f] = omega + relative.tail<3>();
      o.v[f] = v + relative.head<3>() + o.omega[f].cross(o.origin[f] - x);
      const FrameMass<double>& body = tree.frame_mass(node.frame + k);
      o.kinetic += body_energy(body, o.R[f], o.v[f], o.omega[f]);
      if (body.present) { o.potential -= body.mass * tree.gravity().dot(o.origin[f] + o.R[f] * body.com); }
    }
    const FrameMass<double>& body = tree.inlet_mass(node.index);
    const Matrix3<double>& R = ws.inlet_axes(node, state);
    o.kinetic += body_energy(body, R, v, omega);
    if (body.present) { o.potential -= body.mass * tree.gravity().dot(x + R * body.com); }
    if constexpr (rotor_count<S>() > 0) {
      for (const auto& rotor : s.rotors()) {
        double spin = (rotor.ratio * qd_i).value();
        if (rotor.coupled) {
          const auto f = static_cast<std::size_t>(node.frame + std::max(rotor.frame, 0));
          spin += rotor.frame < 0 ? (R * rotor.axis).dot(omega) : (o.R[f] * rotor.axis).dot(o.omega[f]);
        }
        o.kinetic += rotor.inertia * spin * spin / 2;
      }
    }
  });
  return o;
}

/// q after the time t with q̇(t) = qd + qdd t, by Runge–Kutta steps of at most |t|/16.
template <class Tree>
Eigen::VectorXd moved(const Tree& tree, const Eigen::VectorXd& q, const Eigen::VectorXd& qd, const Eigen::VectorXd& qdd,
                      double t)
{
  Eigen::VectorXd result = q;
  tree.outward([&]<class N, class S>(const N& node, const S& s) {
    Coordinates<S> x = q.template segment<S::n_q>(node.q);
    const auto rate = [&](const Coordinates<S>& at, double time) -> Coordinates<S> {
      const Velocities<S> v = qd.template segment<S::n_i>(node.v) + time * qdd.template segment<S::n_i>(node.v);
      return coordinate_rate(s, at, v);
    };
    constexpr int steps = 16;
    const double h = t / steps;
    for (int k = 0; k < steps; ++k) {
      const Coordinates<S> k1 = rate(x, k * h);
      const Coordinates<S> k2 = rate(x + h / 2 * k1, (k + 0.5) * h);
      const Coordinates<S> k3 = rate(x + h / 2 * k2, (k + 0.5) * h);
      const Coordinates<S> k4 = rate(x + h * k3, (k + 1) * h);
      x += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    }
    result.template segment<S::n_q>(node.q) = x;
  });
  return result;
}

/// Weights of the eight-point first derivative at ±1, ±2, ±3, ±4.
inline constexpr std::array<double, 4> difference_weights{4. / 5, -1. / 5, 4. / 105, -1. / 280};

/// A frame of a part whose inlet rests in world axes.
struct MovedFrame {
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  Eigen::Vector3d r = Eigen::Vector3d::Zero();
  Eigen::MatrixXd S_k;  // 6 × n_i
};

inline void add_body(const Body<double>& body, const MovedFrame& f, Eigen::MatrixXd& Mbar)
{
  Eigen::MatrixXd at_com(6, Mbar.cols());
  at_com << Eigen::MatrixXd::Identity(6, 6), f.S_k;
  const Eigen::MatrixXd turning = at_com.bottomRows(3), arm = skew<double>(f.r + f.R * body.com);
  const Eigen::MatrixXd linear = at_com.topRows(3) - arm * turning;
  const Eigen::MatrixXd inertia = f.R * body.inertia * f.R.transpose();
  Mbar += body.mass * linear.transpose() * linear;
  Mbar += turning.transpose() * (inertia * turning);
}

inline void add_rotor(double inertia, const Eigen::RowVectorXd& ratio, bool coupled, const Eigen::Vector3d& axis,
                      const MovedFrame& f, Eigen::MatrixXd& Mbar)
{
  Eigen::MatrixXd g = Eigen::MatrixXd::Zero(1, Mbar.cols());
  g.rightCols(ratio.size()) = ratio;
  if (coupled) {
    const Eigen::RowVectorXd a = (f.R * axis).transpose();
    g.middleCols(3, 3) += a;
    g.rightCols(ratio.size()) += a * f.S_k.bottomRows(3);
  }
  Mbar += inertia * g.transpose() * g;
}

/// M̄_i from motion(), bodies(), rotors(): (6 + n_i)², for an inlet at rest in world axes.
template <class S>
Eigen::MatrixXd internal_inertia(const S& s, const Coordinates<S>& q)
{
  const MovedFrame inlet{.S_k = Eigen::MatrixXd::Zero(6, S::n_i)};
  std::array<MovedFrame, S::n_frames> frames;
  std::array<Eigen::Matrix<double, 6, S::n_i>, S::n_frames> S_k;
  std::array<Vector6<double>, S::n_frames> bias;
  for (auto& columns : S_k) { columns.setZero(); }
  for (auto& acceleration : bias) { acceleration.setZero(); }
  [&]<std::size_t... K>(std::index_sequence<K...>) {
    std::array<FrameMotion<double, S::n_i>, S::n_frames> m{{{frames[K].R, frames[K].r, S_k[K], bias[K]}...}};
    s.motion(Eigen::Matrix3d::Identity(), q, Velocities<S>::Zero(), m);
  }(std::make_index_sequence<S::n_frames>{});
  for (std::size_t k = 0; k < S::n_frames; ++k) {
    frames[k].S_k = S_k[k];
    if (follows_frame<S>()) { frames[k].r.setZero(); }
  }
  const auto frame = [&](int k) -> const MovedFrame& { return k < 0 ? inlet : frames[static_cast<std::size_t>(k)]; };
  Eigen::MatrixXd Mbar = Eigen::MatrixXd::Zero(6 + S::n_i, 6 + S::n_i);
  for (const CarriedBody<double>& carried : s.bodies()) {
    if (!carried.body.is_massless) { add_body(carried.body, frame(carried.frame), Mbar); }
  }
  if constexpr (rotor_count<S>() > 0) {
    for (const auto& rotor : s.rotors()) {
      add_rotor(rotor.inertia, rotor.ratio, rotor.coupled, rotor.axis, frame(rotor.frame), Mbar);
    }
  }
  return Mbar;
}

}  // namespace detail
}  // namespace iim
