// The laws that every type of subsystem must obey, to be run on a type of one's own:
//
//     const iim::LawReport report = iim::check_laws(part);
//     std::cout << report.text();   // a line per law; report.ok()
//
// The part is put on a base of three hinged links, with a hinged load on each of its frames, and into random states. The
// laws see motion(), bodies(), rotors(), internal_force() and Bbar() from outside: positions are differenced, energies
// summed.
//
//     inertia            M̄_i has no negative eigenvalue, and its q̇ block is positive definite
//     velocity           (8): frames move with [1 S_k], as differences of their placements say
//     acceleration       (19): and with T V̇ + ṪV, as differences of their velocities say
//     power balance      d/dt (kinetic + potential energy) = q̇ᵀB̄u − q̇ᵀ internal force
//     stored energy      q̇ᵀ internal force = dU/dt + dissipation, for types that have potential(q), dissipation(q, q̇)
//     linear in u        q̈(u) = q̈₀ + B̂u
//     invariance         turning and moving robot and gravity together changes nothing
//     static tree        StaticTree and DynamicTree agree
#pragma once

#include <iim/iim.hpp>

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <random>
#include <sstream>
#include <string>
#include <vector>

namespace iim {

/// Worst case of one law over all states.
struct LawResult {
  std::string law;
  double error = 0;      ///< largest, relative
  double tolerance = 0;
  int state = -1;        ///< where
  bool ok() const { return error <= tolerance; }  // false for NaN
};

struct LawReport {
  std::vector<LawResult> laws;
  std::string failure;  ///< what kept the laws from being tried

  bool ok() const
  {
    return failure.empty() && std::all_of(laws.begin(), laws.end(), [](const LawResult& l) { return l.ok(); });
  }

  std::string text() const
  {
    std::ostringstream out;
    if (!failure.empty()) { out << failure << '\n'; }
    for (const LawResult& l : laws) {
      out << (l.ok() ? "holds  " : "BROKEN ") << l.law << ": error " << l.error << " (at most " << l.tolerance << ")";
      if (!l.ok()) { out << " in state " << l.state; }
      out << '\n';
    }
    return out.str();
  }
};

/// How to try. Coordinates are drawn by `coordinates`, for instance within the reach of a mechanism; without it they
/// are what neutral() becomes when it moves with a random velocity up to `range` for a second.
template <class S>
struct LawOptions {
  int states = 20;
  std::uint64_t seed = 1;
  double range = 1;    ///< [rad, m]
  double speed = 1;    ///< largest velocity [rad/s, m/s]
  double effort = 1;   ///< largest input [N, N m]
  /// Difference quotients have eight points `step` apart, in units of the time in which the state changes by about 1.
  double step = 2.5e-3;
  /// Of laws that are differenced: ε/step for the roundings is 1e-13, and up to 10³ for sums of unlike terms.
  double difference_tolerance = 1e-9;
  /// Of laws that compare two computations: ε times the condition number of M, up to 10⁶ for geared drives.
  double tolerance = 1e-9;
  std::function<detail::Coordinates<S>(const std::function<double(double, double)>& uniform)> coordinates;
};

namespace detail {

template <class Tree>
struct Observation {
  std::vector<Eigen::Vector3d> origin;           // of each frame, world
  std::vector<Eigen::Matrix3d> R;
  std::vector<Eigen::Vector3d> v, omega;         // of each frame's origin
  double kinetic = 0, potential = 0;
};

inline double body_energy(const FrameMass<double>& body, const Eigen::Matrix3d& R, const Eigen::Vector3d& v,
                          const Eigen::Vector3d& omega)
{
  if (!body.present) { return 0; }
  const Eigen::Vector3d v_c = v + omega.cross(R * body.com);
  const Eigen::Vector3d turning = R.transpose() * omega;
  return (body.mass * v_c.squaredNorm() + turning.dot(body.central_inertia * turning)) / 2;
}

/// Placements, velocities and energy of all frames, from motion(), bodies() and rotors() alone.
template <class Tree>
Observation<Tree> observe(const Tree& tree, const Eigen::VectorXd& q, const Eigen::VectorXd& qd)
{
  Workspace ws(tree);
  forward_dynamics(q, qd, ws);
  Observation<Tree> o;
  const auto frames = static_cast<std::size_t>(tree.n_frames());
  o.origin.resize(frames);
  o.R.resize(frames);
  o.v.resize(frames);
  o.omega.resize(frames);
  std::vector<Eigen::Vector3d> coupling(static_cast<std::size_t>(tree.size()));
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
    o.kinetic += body_energy(body, state.R, v, omega);
    if (body.present) { o.potential -= body.mass * tree.gravity().dot(x + state.R * body.com); }
    if constexpr (rotor_count<S>() > 0) {
      for (const auto& rotor : s.rotors()) {
        double spin = (rotor.ratio * qd_i).value();
        if (rotor.coupled) {
          const auto f = static_cast<std::size_t>(node.frame + std::max(rotor.frame, 0));
          spin += rotor.frame < 0 ? (state.R * rotor.axis).dot(omega) : (o.R[f] * rotor.axis).dot(o.omega[f]);
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

/// M̄_i from motion(), bodies(), rotors(): (6 + n_i)², for an inlet at rest in world axes.
template <class S>
Eigen::Matrix<double, 6 + S::n_i, 6 + S::n_i> internal_inertia(const S& s, const Coordinates<S>& q)
{
  constexpr int size = 6 + S::n_i;
  struct Frame {
    Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
    Eigen::Vector3d r = Eigen::Vector3d::Zero();
    Eigen::Matrix<double, 6, S::n_i> S_k = Eigen::Matrix<double, 6, S::n_i>::Zero();
    Vector6<double> bias = Vector6<double>::Zero();
  };
  std::array<Frame, S::n_frames> frames;
  [&]<std::size_t... K>(std::index_sequence<K...>) {
    std::array<FrameMotion<double, S::n_i>, S::n_frames> m{
        {{frames[K].R, frames[K].r, frames[K].S_k, frames[K].bias}...}};
    s.motion(Eigen::Matrix3d::Identity(), q, Velocities<S>::Zero(), m);
  }(std::make_index_sequence<S::n_frames>{});
  Eigen::Matrix<double, size, size> Mbar = Eigen::Matrix<double, size, size>::Zero();
  Eigen::Matrix<double, 6, size> P;
  P.template leftCols<6>().setIdentity();
  for (const CarriedBody<double>& carried : s.bodies()) {
    if (carried.body.is_massless) { continue; }
    const Frame f = carried.frame < 0 ? Frame{} : frames[static_cast<std::size_t>(carried.frame)];
    P.template rightCols<S::n_i>() = f.S_k;
    Eigen::Matrix<double, 6, size> at_com = P;
    at_com.template topRows<3>() -= skew<double>(f.r + f.R * carried.body.com) * P.template bottomRows<3>();
    const Eigen::Matrix3d inertia = f.R * carried.body.inertia * f.R.transpose();
    Mbar += carried.body.mass * at_com.template topRows<3>().transpose() * at_com.template topRows<3>() +
            at_com.template bottomRows<3>().transpose() * inertia * at_com.template bottomRows<3>();
  }
  if constexpr (rotor_count<S>() > 0) {
    for (const auto& rotor : s.rotors()) {
      Eigen::Matrix<double, 1, size> g = Eigen::Matrix<double, 1, size>::Zero();
      g.template rightCols<S::n_i>() = rotor.ratio;
      if (rotor.coupled) {
        const Frame f = rotor.frame < 0 ? Frame{} : frames[static_cast<std::size_t>(rotor.frame)];
        const Eigen::Vector3d axis = f.R * rotor.axis;
        g.template segment<3>(3) += axis.transpose();
        g.template rightCols<S::n_i>() += axis.transpose() * f.S_k.template bottomRows<3>();
      }
      Mbar += rotor.inertia * g.transpose() * g;
    }
  }
  return Mbar;
}

template <class S>
struct LawTrees {
  using Link = RevoluteLink<double>;
  using Dynamic = DynamicTree<S, Link>;
  using Static = StaticTree<On<-1, Link>, On<0, S>, On<1, Link>>;
};
template <>
struct LawTrees<RevoluteLink<double>> {
  using Link = RevoluteLink<double>;
  using Dynamic = DynamicTree<Link>;
  using Static = StaticTree<On<-1, Link>, On<0, Link>, On<1, Link>>;
};

}  // namespace detail

/// Tries all laws on `part` (parameters as for a tree; not yet prepared). Throws ModelError if they are wrong.
template <Subsystem S>
  requires std::same_as<typename S::Scalar, double>
LawReport check_laws(const S& part, const LawOptions<S>& options = {})
{
  using Trees = detail::LawTrees<S>;
  using Tree = typename Trees::Dynamic;
  using StaticTreeType = typename Trees::Static;
  using Vec = Eigen::VectorXd;
  std::mt19937_64 bits(options.seed);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(bits() >> 11) * 0x1p-53;
  };
  const auto vector = [&](double size) {
    const double x = uniform(-size, size), y = uniform(-size, size), z = uniform(-size, size);
    return Eigen::Vector3d(x, y, z);
  };
  const auto rotation = [&] {
    const Eigen::Vector3d w = vector(2);
    return Eigen::AngleAxisd(w.norm(), w.normalized()).toRotationMatrix();
  };

  // The robot, the same one turned by Q and moved, and a shorter one.
  const Eigen::Matrix3d Q = rotation();
  const Eigen::Vector3d shift = vector(3);
  Body<double> box{2, Eigen::Vector3d(0.1, -0.05, 0.08), Eigen::Vector3d(0.03, 0.04, 0.05).asDiagonal(), false};
  typename Tree::Parts robot, elsewhere, slim;
  constexpr Index first = 3;  // number of the part
  for (int k = 0; k < first; ++k) {
    const std::string name = k + 1 == first ? "base" : "base" + std::to_string(k);
    const RevoluteLink<double> link{{vector(1).normalized()}, box};
    Attachment<double> on{k == 0 ? "world" : "base" + std::to_string(k - 1), rotation(), vector(0.3), 0};
    robot.add(name, on, link);
    if (k == 0) {
      on.R = Q * on.R;
      on.p = Q * on.p + shift;
    }
    elsewhere.add(name, on, link);
    if (k + 1 == first) { slim.add(name, {}, link); }
  }
  const Attachment<double> at_base{"base", rotation(), vector(0.3), 0};
  for (auto* assembly : {&robot, &elsewhere, &slim}) { assembly->add("part", at_base, part); }
  box.mass = 0.5;
  for (int k = 0; k < S::n_frames; ++k) {
    const Attachment<double> on{"part", rotation(), vector(0.3), k};
    const RevoluteLink<double> load{{vector(1).normalized()}, box};
    for (auto* assembly : {&robot, &elsewhere}) { assembly->add("load" + std::to_string(k), on, load); }
    if (k == 0) { slim.add("load0", on, load); }
  }
  robot.set_gravity(Eigen::Vector3d(3, -4, -8));
  elsewhere.set_gravity(Q * robot.gravity());
  const Tree tree(robot), turned(elsewhere), slim_tree(slim);
  const StaticTreeType fixed(slim);
  Workspace ws(tree), turned_ws(turned), slim_ws(slim_tree);
  Workspace fixed_ws(fixed);
  S prepared = part;
  prepared.prepare("part");
  const auto& node = tree.node(first);
  const auto make_inputs = [](const auto& of, int loads) {
    Inputs<std::remove_cvref_t<decltype(of)>> inputs(of);
    for (int k = 0; k < loads; ++k) {
      inputs.add_wrench("load" + std::to_string(k), {0.1, 0.2, -0.1}, Axes::body);
    }
    return inputs;
  };
  auto inputs = make_inputs(tree, S::n_frames);
  auto turned_inputs = make_inputs(turned, S::n_frames);
  auto slim_inputs = make_inputs(slim_tree, 1);
  auto fixed_inputs = make_inputs(fixed, 1);
  ImplicitInversion<Tree> method(tree, inputs), turned_method(turned, turned_inputs), slim_method(slim_tree, slim_inputs);
  ImplicitInversion<StaticTreeType> fixed_method(fixed, fixed_inputs);

  LawReport report;
  int at = 0;
  const auto hold = [&](const std::string& law, double error, double tolerance) {
    auto found = std::find_if(report.laws.begin(), report.laws.end(), [&](const LawResult& l) { return l.law == law; });
    if (found == report.laws.end()) { found = report.laws.insert(found, {law, 0, tolerance, 0}); }
    if (!(error <= found->error)) {
      found->error = std::isnan(error) ? std::numeric_limits<double>::infinity() : error;
      found->state = at;
    }
  };
  const auto apart = [](const auto& a, const auto& b) {
    const double size = b.norm();
    return (a - b).norm() / (size > 0 ? size : 1);
  };

  for (at = 0; at < options.states; ++at) {
    Vec q(tree.n_q()), qd(tree.n_v()), u(inputs.columns());
    for (double& x : q) { x = uniform(-1, 1); }
    for (double& x : qd) { x = uniform(-options.speed, options.speed); }
    for (double& x : u) { x = uniform(-options.effort, options.effort); }
    if (options.coordinates) {
      q.template segment<S::n_q>(node.q) = options.coordinates(uniform);
    } else {
      Vec from = q, velocity = Vec::Zero(tree.n_v());
      from.template segment<S::n_q>(node.q) = neutral(prepared);
      for (Index k = 0; k < S::n_i; ++k) { velocity(node.v + k) = uniform(-options.range, options.range); }
      from = detail::moved(tree, from, velocity, Vec::Zero(tree.n_v()), 1.0);
      q.template segment<S::n_q>(node.q) = from.template segment<S::n_q>(node.q);
    }
    const detail::Coordinates<S> q_i = q.template segment<S::n_q>(node.q);
    const detail::Velocities<S> qd_i = qd.template segment<S::n_i>(node.v);

    const Vec qdd_u = forward_dynamics(q, qd, inputs, u, ws).qdd;
    const auto receipt = forward_dynamics(q, qd, ws);
    const auto answer = method(receipt);
    if (!answer.ok()) {
      report.failure = "state " + std::to_string(at) + ", q_i = " + detail::to_text(q_i) + ": " + to_string(answer.status);
      return report;
    }
    hold("linear in u", apart(Vec(answer.qdd0 + answer.Bhat * u), qdd_u), options.tolerance);

    if constexpr (S::n_i > 0) {
      const auto Mbar = detail::internal_inertia(prepared, q_i);
      const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> spectrum(Mbar, Eigen::EigenvaluesOnly);
      const Eigen::MatrixXd own = Mbar.template bottomRightCorner<S::n_i, S::n_i>();
      const double size = spectrum.eigenvalues().maxCoeff();
      const bool definite = Eigen::LLT<Eigen::MatrixXd>(own).info() == Eigen::Success;
      hold("inertia", definite ? std::max(-spectrum.eigenvalues().minCoeff() / size, 0.0) : 1, 1e-12);
    }

    // Differences along q̇(t) = q̇ + q̈ t with the acceleration under u.
    const double quickness = std::max({1.0, qd.cwiseAbs().maxCoeff(), std::sqrt(qdd_u.cwiseAbs().maxCoeff())});
    const double h = options.step / quickness;
    const auto now = detail::observe(tree, q, qd);
    const auto frames = now.R.size();
    std::vector<Eigen::Matrix3d> Rdot(frames, Eigen::Matrix3d::Zero());
    std::vector<Eigen::Vector3d> rdot(frames, Eigen::Vector3d::Zero()), vdot = rdot, omegadot = rdot;
    double power = 0, potential_rate = 0;
    Vec q_rate = Vec::Zero(tree.n_q());
    for (int point = -4; point <= 4; ++point) {
      if (point == 0) { continue; }
      const double c = (point > 0 ? 1 : -1) * detail::difference_weights[static_cast<std::size_t>(std::abs(point) - 1)] / h;
      const Vec q_t = detail::moved(tree, q, qd, qdd_u, point * h);
      const auto then = detail::observe(tree, q_t, qd + point * h * qdd_u);
      for (std::size_t f = 0; f < frames; ++f) {
        Rdot[f] += c * (then.R[f] - now.R[f]);
        rdot[f] += c * (then.origin[f] - now.origin[f]);
        vdot[f] += c * (then.v[f] - now.v[f]);
        omegadot[f] += c * (then.omega[f] - now.omega[f]);
      }
      power += c * ((then.kinetic - now.kinetic) + (then.potential - now.potential));
      if constexpr (requires { prepared.potential(q_i); }) {
        const detail::Coordinates<S> q_then = q_t.template segment<S::n_q>(node.q);
        potential_rate += c * (prepared.potential(q_then) - prepared.potential(q_i));
      }
    }
    forward_dynamics(q, qd, inputs, u, ws);
    double v_error = 0, a_error = 0, v_size = 1, a_size = 1;
    for (std::size_t f = 0; f < frames; ++f) {
      const auto& state = ws.frame(static_cast<Index>(f));
      const Eigen::Matrix3d spin = Rdot[f] * now.R[f].transpose();
      v_error = std::max({v_error, (spin - skew<double>(now.omega[f])).norm(), (rdot[f] - now.v[f]).norm()});
      v_size = std::max({v_size, now.v[f].norm(), now.omega[f].norm()});
      const Eigen::Vector3d a =
          vdot[f] - omegadot[f].cross(state.r) - now.omega[f].cross(now.omega[f].cross(state.r)) - tree.gravity();
      a_error = std::max({a_error, (state.Vdot.template head<3>() - a).norm(),
                          (state.Vdot.template tail<3>() - omegadot[f]).norm()});
      a_size = std::max({a_size, a.norm(), omegadot[f].norm()});
    }
    hold("velocity", v_error / v_size, options.difference_tolerance);
    hold("acceleration", a_error / a_size, options.difference_tolerance);

    // Power of inputs: motors on their own velocities, wrenches at points of the loads in the loads' axes.
    double expected = 0, power_size = 1;
    const auto work = [&](double watts) {
      expected += watts;
      power_size += std::abs(watts);
    };
    Index column = 0;
    tree.outward([&]<class N, class T>(const N& n, const T& s) {
      const detail::Velocities<T> qd_n = qd.template segment<T::n_i>(n.v);
      if constexpr (T::n_u > 0) {
        const detail::Coordinates<T> q_n = q.template segment<T::n_q>(n.q);
        const Eigen::Matrix<double, T::n_u, 1> u_n = u.template segment<T::n_u>(column);
        work(qd_n.dot(s.Bbar(q_n) * u_n));
        column += T::n_u;
      }
    });
    for (int k = 0; k < S::n_frames; ++k, column += 6) {
      const auto f = static_cast<std::size_t>(tree.node(first + 1 + k).frame);
      const Eigen::Vector3d arm = now.R[f] * Eigen::Vector3d(0.1, 0.2, -0.1);
      work((now.R[f] * u.segment<3>(column)).dot(now.v[f] + now.omega[f].cross(arm)));
      work((now.R[f] * u.segment<3>(column + 3)).dot(now.omega[f]));
    }
    if constexpr (detail::has_internal_force<S>()) {
      const double taken = qd_i.dot(prepared.internal_force(q_i, qd_i));
      work(-taken);
      if constexpr (requires { prepared.potential(q_i); }) {
        double known = potential_rate;
        if constexpr (requires { prepared.dissipation(q_i, qd_i); }) { known += prepared.dissipation(q_i, qd_i); }
        hold("stored energy", std::abs(taken - known) / (1 + std::abs(taken) + std::abs(potential_rate)),
             options.difference_tolerance);
      }
    }
    hold("power balance", std::abs(power - expected) / power_size, options.difference_tolerance);

    const auto turned_answer = turned_method(forward_dynamics(q, qd, turned_ws));
    hold("invariance", apart(turned_answer.qdd0, answer.qdd0), options.tolerance);
    hold("invariance", apart(turned_answer.Bhat, answer.Bhat), options.tolerance);
    const Vec q_slim = q.segment(first - 1, S::n_q + 2), qd_slim = qd.segment(first - 1, S::n_i + 2);
    const auto slim_answer = slim_method(forward_dynamics(q_slim, qd_slim, slim_ws));
    const auto fixed_answer = fixed_method(forward_dynamics(q_slim, qd_slim, fixed_ws));
    hold("static tree", apart(fixed_answer.qdd0, slim_answer.qdd0), options.tolerance);
    hold("static tree", apart(fixed_answer.Bhat, slim_answer.Bhat), options.tolerance);
  }
  return report;
}

}  // namespace iim
