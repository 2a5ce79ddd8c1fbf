// A biped on rigid ground leans forward, squats, and is pushed sideways: whole-body control by (4),
//
//     min over u  ‖ J_t B̂ u + V̇_t0 − V̇_tc ‖² + λ ‖ D (u − u_n) ‖²                                        (4)
//
// with u = (motor torques, contact forces) and the tasks: eight contact points stay where they are, centre of mass and
// torso orientation go where they shall. Only the torques go to the robot. The ground does not know the forces that the
// controller has in mind: it answers with those that keep the contact points from accelerating.
#include <iim/iim.hpp>
#include <iim/models.hpp>
#include <iim/task.hpp>

#include <Eigen/Cholesky>
#include <Eigen/QR>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace {

using Vec3 = iim::Vector3<double>;
using Vector = Eigen::VectorXd;
using Matrix = Eigen::MatrixXd;

constexpr int contacts = static_cast<int>(iim::models::biped_contacts.size());
constexpr int motors = 14;
constexpr int forces = 3 * contacts;
constexpr double step = 1e-3;      // [s]
constexpr double duration = 2.5;   // [s]
constexpr double friction = 0.6;

/// Torso upright over bent knees, feet level.
Vector crouch(iim::Index n_q)
{
  Vector q = Vector::Zero(n_q);
  q(6) = 1;
  for (const int leg : {7, 14}) {
    q(leg + 2) = -0.4;  // hip pitch
    q(leg + 3) = 0.8;   // knee
    q(leg + 4) = -0.4;  // ankle pitch
  }
  return q;
}

/// Rotation vector of a small rotation.
Vec3 small_angle(const iim::Matrix3<double>& R)
{
  return Vec3(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1)) / 2;
}

/// u of (4), by the normal equations of its dual: as many unknowns as task rows.
Vector solve(const Matrix& JB, const Vector& error, const Vector& u_n, const Vector& D, double lambda)
{
  const Vector inverse = D.cwiseAbs2().cwiseInverse();
  const Matrix scaled = JB * inverse.asDiagonal();
  Matrix normal = scaled * JB.transpose();
  normal.diagonal().array() += lambda;
  return u_n + scaled.transpose() * normal.llt().solve(error - JB * u_n);
}

struct Worst {
  double residual = 0;    // of (4) [m/s², rad/s²]
  double drift = 0;       // of a contact point [m]
  double tilt = 0;        // of the torso [rad]
  double least_push = 1e9;  // vertical force of the ground on a foot [N]
  double slip = 0;        // horizontal by vertical force on a foot
  double margin = 1e9;    // of a foot's centre of pressure from its edge, inwards [m]
  double torque = 0;      // at a joint [N m]
};

}  // namespace

int main()
{
  const iim::DynamicTree tree(iim::models::biped<double>());
  iim::Inputs inputs(tree);
  for (const char* point : iim::models::biped_contacts) { inputs.add_force(point); }
  const auto push = inputs.add_force("torso");
  iim::Tasks tasks(tree, inputs);
  for (const char* point : iim::models::biped_contacts) { tasks.add_point(point); }
  const auto com = tasks.add_com();
  const auto torso = tasks.add_frame("torso");
  iim::Workspace ws(tree);
  iim::ImplicitInversion method(tree, inputs);

  Vector q = crouch(tree.n_q()), rate(tree.n_q());
  Vector qd = Vector::Zero(tree.n_v());

  // The ground is where the contact points are to begin with.
  if (!tasks(iim::forward_dynamics(q, qd, ws)).ok()) { return 1; }
  std::array<Vec3, contacts> ground;
  for (int k = 0; k < contacts; ++k) { ground[static_cast<std::size_t>(k)] = tasks.placement(k).p; }
  const Vec3 start = tasks.placement(com).p;
  const Vec3 goal = start + Vec3(0.05, 0.0, -0.04);  // forward over the feet, and down

  const Vec3 weight = -tasks.mass() * tree.gravity();
  Vector u_n = Vector::Zero(motors + forces), D = Vector::Ones(motors + forces);
  D.head(motors).setConstant(80);  // a motor's Newton metre is eighty at the joint
  for (int k = 0; k < contacts; ++k) { u_n.segment<3>(motors + 3 * k) = weight / contacts; }

  Worst worst;
  double late = 0;  // distance of the centre of mass from its goal in the last 0.1 s
  std::printf("%6s %28s %10s %10s %10s %12s\n", "t [s]", "centre of mass [m]", "off [mm]", "tilt [°]", "residual", "on feet [N]");
  const int steps = static_cast<int>(std::lround(duration / step));
  for (int k = 0; k <= steps; ++k) {
    const double t = k * step;
    const bool pushed = t >= 1.0 && t < 1.2;
    inputs.set_active(push, pushed);

    const auto dynamics = method(q, qd, ws);
    const auto rows = tasks(dynamics);
    if (!rows.ok()) {
      std::printf("failed at t = %g s: %s\n", t, describe(rows, tree).c_str());
      return 1;
    }

    // What the task shall do: V̇_tc, critically damped about the goals. The last three rows are the torso's ω̇.
    const iim::Index n_rows = forces + 6;
    Matrix JB(n_rows, motors + forces);
    JB << rows.JB.topRows(forces + 3).leftCols(motors + forces), rows.JB.bottomRows(3).leftCols(motors + forces);
    const Vector V = rows.J * qd;
    Vector error(n_rows);
    for (int c = 0; c < contacts; ++c) {
      const Vec3 off = tasks.placement(c).p - ground[static_cast<std::size_t>(c)];
      error.segment<3>(3 * c) = -900 * off - 60 * V.segment<3>(3 * c) - rows.Vdot0.segment<3>(3 * c);
      worst.drift = std::max(worst.drift, off.norm());
    }
    const double s = std::clamp(t / 0.8, 0.0, 1.0);
    // From start to goal in 0.8 s, without a jump in acceleration.
    const double path = s * s * s * (10 - 15 * s + 6 * s * s), speed = 30 * s * s * (1 - s) * (1 - s) / 0.8,
                 gain = 60 * s * (1 - s) * (1 - 2 * s) / 0.64;
    const Vec3 off = tasks.placement(com).p - start - path * (goal - start);
    const Vec3 faster = V.segment<3>(forces) - speed * (goal - start);
    error.segment<3>(forces) = gain * (goal - start) - 64 * off - 16 * faster - rows.Vdot0.segment<3>(forces);
    const Vec3 tilt = small_angle(tasks.placement(torso).R);
    error.tail<3>() = -100 * tilt - 20 * V.tail<3>() - rows.Vdot0.tail<3>();

    const Vector u = solve(JB, error, u_n, D, 1e-9);
    const double residual = (JB * u - error).norm();

    // The ground: forces f for which the contact points do not accelerate under the torques that the robot gets. The
    // damping is the numerical remedy against drift that every integrator of rigid contacts needs.
    Vector to_contacts = rows.Vdot0.head(forces) + rows.JB.topLeftCorner(forces, motors) * u.head(motors);
    Vector pushing(inputs.columns() - motors - forces);
    if (pushed) {
      pushing << 0, 15, 0;
      to_contacts += rows.JB.topRows(forces).rightCols(3) * pushing;
    }
    to_contacts += 60 * V.head(forces);
    for (int c = 0; c < contacts; ++c) {
      to_contacts.segment<3>(3 * c) += 900 * (tasks.placement(c).p - ground[static_cast<std::size_t>(c)]);
    }
    // Eight points on four rigid parts: the forces are determined up to tensions within a part.
    Eigen::CompleteOrthogonalDecomposition<Matrix> contact(forces, forces);
    contact.setThreshold(1e-10);
    contact.compute(rows.JB.block(0, motors, forces, forces));
    const Vector f = contact.solve(-to_contacts);

    std::array<double, 2> on_foot{};
    for (int foot = 0; foot < 2; ++foot) {
      Vec3 sum = Vec3::Zero(), pressure = Vec3::Zero(), low = Vec3::Constant(1e9), high = -low;
      for (int c = foot * contacts / 2; c < (foot + 1) * contacts / 2; ++c) {
        const Vec3& p = ground[static_cast<std::size_t>(c)];
        sum += f.segment<3>(3 * c);
        pressure += f(3 * c + 2) * p;
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
      }
      pressure /= sum.z();
      worst.margin = std::min({worst.margin, (pressure - low).head<2>().minCoeff(), (high - pressure).head<2>().minCoeff()});
      on_foot[static_cast<std::size_t>(foot)] = sum.z();
      worst.least_push = std::min(worst.least_push, sum.z());
      worst.slip = std::max(worst.slip, sum.head<2>().norm() / sum.z());
    }
    worst.residual = std::max(worst.residual, residual);
    worst.tilt = std::max(worst.tilt, tilt.norm());
    worst.torque = std::max(worst.torque, 80 * u.head(motors).cwiseAbs().maxCoeff());
    const Vec3 at = tasks.placement(com).p;
    if (t > duration - 0.1) { late = std::max(late, (at - goal).norm()); }
    if (k % 250 == 0) {
      std::printf("%6.2f %9.4f %9.4f %8.4f %10.2f %10.3f %10.1e %6.0f %5.0f%s\n", t, at.x(), at.y(), at.z(), 1e3 * off.norm(),
                  tilt.norm() * 57.2958, residual, on_foot[0], on_foot[1], pushed ? "  pushed" : "");
    }

    // A step in time: velocities first, then coordinates at the new velocities.
    Vector all(inputs.columns());
    all << u.head(motors), f, pushing;
    qd += step * (dynamics.qdd0 + dynamics.Bhat * all);
    iim::coordinate_rate(tree, q, qd, rate);
    q += step * rate;
    iim::normalize(tree, q);
  }

  std::printf("\nworst: residual of (4) %.1e, contact points off by %.2e m, torso tilted by %.3f rad,\n"
              "least force on a foot %.0f N, horizontal / vertical force %.2f, joint torque %.0f N m,\n"
              "centre of pressure %.0f mm inside a foot's edge\n"
              "centre of mass within %.2f mm of its goal at the end\n",
              worst.residual, worst.drift, worst.tilt, worst.least_push, worst.slip, worst.torque, 1e3 * worst.margin, 1e3 * late);
  const bool balanced = worst.residual < 1e-3 && worst.drift < 1e-3 && worst.tilt < 0.1 && worst.least_push > 0 &&
                        worst.slip < friction && worst.margin > 0 && late < 1e-3;
  std::printf("%s\n", balanced ? "the biped balances" : "the biped does not balance");
  return balanced ? 0 : 1;
}
