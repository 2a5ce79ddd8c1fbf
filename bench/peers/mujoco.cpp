// PROGRAM: iim_peers_mujoco
// REQUIRES: mujoco
// MuJoCo. Its free joint has the velocity of the origin in world axes, and the quaternion's scalar first.
#include "peers.hpp"
#include "worker.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Eigenvalues>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <stdexcept>

namespace peers {
namespace {

template <class Derived>
std::string numbers(const Eigen::MatrixBase<Derived>& x)
{
  std::string text;
  char buffer[32];
  for (Index k = 0; k < x.size(); ++k) {
    std::snprintf(buffer, sizeof buffer, "%s%.17g", k > 0 ? " " : "", x(k));
    text += buffer;
  }
  return text;
}

/// Scalar part first.
Eigen::Vector4d quaternion(const Matrix3d& R)
{
  const Eigen::Quaterniond turn(R);
  return {turn.w(), turn.x(), turn.y(), turn.z()};
}

/// The model in MuJoCo's own language.
std::string mjcf(const Model& model)
{
  std::ostringstream xml;
  xml << "<mujoco><compiler angle='radian' inertiafromgeom='false' balanceinertia='false' boundmass='0' "
         "boundinertia='0'/>"
      << "<option gravity='" << numbers(model.gravity) << "'/><worldbody>";
  std::vector<int> open;
  for (std::size_t k = 0; k < model.joints.size(); ++k) {
    const Joint& joint = model.joints[k];
    while (!open.empty() && open.back() != joint.parent) {
      xml << "</body>";
      open.pop_back();
    }
    xml << "<body name='" << joint.name << "' pos='" << numbers(joint.p) << "' quat='" << numbers(quaternion(joint.R))
        << "'><inertial pos='" << numbers(joint.com) << "' mass='" << numbers(Eigen::Matrix<double, 1, 1>(joint.mass));
    // Principal axes from here: MuJoCo's own are good to 1e-7.
    const Eigen::SelfAdjointEigenSolver<Matrix3d> principal(joint.inertia);
    Matrix3d axes = principal.eigenvectors();
    if (axes.determinant() < 0) { axes.col(0) *= -1; }
    xml << "' quat='" << numbers(quaternion(axes)) << "' diaginertia='" << numbers(principal.eigenvalues()) << "'/>";
    if (joint.kind == JointKind::floating) {
      xml << "<freejoint/>";
    } else {
      xml << "<joint type='" << (joint.kind == JointKind::revolute ? "hinge" : "slide") << "' axis='"
          << numbers(joint.axis) << "'/>";
    }
    open.push_back(static_cast<int>(k));
  }
  for (std::size_t k = 0; k < open.size(); ++k) { xml << "</body>"; }
  xml << "</worldbody></mujoco>";
  return xml.str();
}

struct ModelDeleter {
  void operator()(mjModel* model) const { mj_deleteModel(model); }
};
struct DataDeleter {
  void operator()(mjData* data) const { mj_deleteData(data); }
};
using ModelPointer = std::unique_ptr<mjModel, ModelDeleter>;
using DataPointer = std::unique_ptr<mjData, DataDeleter>;

ModelPointer load(const Model& from)
{
  const auto path =
      std::filesystem::temp_directory_path() / ("iim_peers_" + std::to_string(std::random_device{}()) + ".xml");
  std::ofstream(path) << mjcf(from);
  char error[512] = "";
  ModelPointer model(mj_loadXML(path.c_str(), nullptr, error, sizeof error));
  std::filesystem::remove(path);
  if (!model) { throw std::runtime_error(error); }
  return model;
}

class MujocoPeer : public Peer {
public:
  MujocoPeer(const Model& model, const std::vector<State>& states)
      : from_(model), model_(load(model)), data_(mj_makeData(model_.get())), states_(states),
        right_(RowMatrix::Zero(model.columns() + 1, model.n_v)), solved_(model.columns() + 1, model.n_v)
  {
    if (model_->nv != model.n_v || model_->nq != model.n_q) {
      throw std::runtime_error("another number of velocities");
    }
    for (std::size_t c = 0; c < model.motors.size(); ++c) { right_(static_cast<Index>(c) + 1, model.motors[c]) = 1; }
    for (const Contact& contact : model.contacts) {
      const std::string& body = model.joints[static_cast<std::size_t>(contact.joint)].name;
      bodies_.push_back(mj_name2id(model_.get(), mjOBJ_BODY, body.c_str()));
    }
    for (State& x : states_) {
      for (const Joint& joint : model.joints) {
        if (joint.kind != JointKind::floating) { continue; }
        const Eigen::Quaterniond turn(x.q(joint.q + 6), x.q(joint.q + 3), x.q(joint.q + 4), x.q(joint.q + 5));
        x.q.segment<4>(joint.q + 3) << turn.w(), turn.x(), turn.y(), turn.z();
        x.qd.segment<3>(joint.v) = turn.normalized() * x.qd.segment<3>(joint.v);
      }
    }
  }

  std::vector<Path> paths() override
  {
    return {{"mj_factorM, mj_solveM", [this](std::size_t k) { solve(k); }, [this] { return result(); }}};
  }

private:
  using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  /// Only what these accelerations need of MuJoCo's pipeline.
  void solve(std::size_t k)
  {
    const mjModel* m = model_.get();
    mjData* d = data_.get();
    Eigen::Map<VectorXd>(d->qpos, m->nq) = states_[k].q;
    Eigen::Map<VectorXd>(d->qvel, m->nv) = states_[k].qd;
    last_ = k;
    mj_kinematics(m, d);
    mj_comPos(m, d);
    mj_crb(m, d);
    mj_factorM(m, d);
    mj_comVel(m, d);
    mj_rne(m, d, 0, right_.data());
    right_.row(0) = -right_.row(0);
    for (std::size_t c = 0; c < bodies_.size(); ++c) {
      const Eigen::Map<const RowMatrix> R(d->xmat + 9 * bodies_[c], 3, 3);
      const Vector3d point = Eigen::Map<const Vector3d>(d->xpos + 3 * bodies_[c]) + R * from_.contacts[c].p;
      const Index row = 1 + static_cast<Index>(from_.motors.size() + 3 * c);
      mj_jac(m, d, right_.row(row).data(), nullptr, point.data(), bodies_[c]);
    }
    mj_solveM(m, d, solved_.data(), right_.data(), static_cast<int>(right_.rows()));
  }

  Result result() const
  {
    Result result{solved_.row(0).transpose(), solved_.bottomRows(solved_.rows() - 1).transpose()};
    const State& x = states_[last_];
    for (const Joint& joint : from_.joints) {
      if (joint.kind != JointKind::floating) { continue; }
      // v̇ in world axes = R (v̇ + ω × v)
      const Matrix3d E = Eigen::Quaterniond(x.q(joint.q + 3), x.q(joint.q + 4), x.q(joint.q + 5), x.q(joint.q + 6))
                             .normalized()
                             .toRotationMatrix();
      const Vector3d v = E.transpose() * x.qd.segment<3>(joint.v);
      const Vector3d omega = x.qd.segment<3>(joint.v + 3);
      result.qdd0.segment<3>(joint.v) = E.transpose() * Vector3d(result.qdd0.segment<3>(joint.v)) - omega.cross(v);
      result.Bhat.middleRows<3>(joint.v) = (E.transpose() * result.Bhat.middleRows<3>(joint.v)).eval();
    }
    return result;
  }

  Model from_;
  ModelPointer model_;
  DataPointer data_;
  std::vector<State> states_;  // in MuJoCo's form
  std::vector<int> bodies_;    // of the contacts
  RowMatrix right_;            // right-hand sides, one per row: −h, then Bᵀ
  RowMatrix solved_;
  std::size_t last_ = 0;
};

}  // namespace
}  // namespace peers

int main(int argc, char** argv)
{
  using namespace peers;
  return serve({"MuJoCo", mj_versionString(),
                [](const Model& model, const std::vector<State>& states) -> std::unique_ptr<Peer> {
                  return std::make_unique<MujocoPeer>(model, states);
                }},
               argc, argv);
}
