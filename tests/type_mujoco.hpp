// A mechanism in MuJoCo: a tree of bodies, and loops closed by its equality constraints.
//
// MuJoCo's own accelerations leave out J̇q̇ and hold constraints by stiff springs. Everything exact that it has is taken
// from it, and the constrained motion solved here:
//     M q̈ + h = B u + Jᵀλ,   J q̈ + J̇q̇ = 0
// M from mj_fullM, h = qfrc_bias, J = efc_J; J̇q̇ from the accelerations that mj_rnePostConstraint has for q̈ = 0.
#pragma once

#include "type_robots.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Eigenvalues>

#include <cstdio>
#include <cstring>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>

namespace iim::test {

struct MujocoJoint {
  std::string kind;  // hinge, slide, ball, free
  Vec3 axis = Vec3::UnitZ();
};

/// A body on its joints, in the order in which they move it; placed in the parent's axes.
struct MujocoPart {
  std::string name, parent;  // parent "": the world
  Placement<double> at{};
  std::vector<MujocoJoint> joints;
  Body<double> body;
};

/// A point of one body is held to a point of another.
struct Connection {
  std::string a;
  Vec3 point_a;
  std::string b;
  Vec3 point_b;
};

/// Coordinate `follower` = ratio × coordinate `leader`; both by body and number of the joint on it.
struct Tie {
  std::string follower;
  int follower_joint;
  std::string leader;
  int leader_joint;
  double ratio;
};

class MujocoRobot {
public:
  MujocoRobot(const std::vector<MujocoPart>& parts, const std::vector<Connection>& connections,
              const std::vector<Tie>& ties, const Vec3& gravity)
      : connections_(connections)
  {
    std::ostringstream xml;
    xml << "<mujoco><compiler angle='radian' inertiafromgeom='false' balanceinertia='false' boundmass='0' "
           "boundinertia='0'/>"
        << "<option jacobian='dense' gravity='" << text(gravity) << "'/><worldbody>";
    write(xml, parts, "");
    xml << "</worldbody><equality>";
    for (const Connection& c : connections) {
      xml << "<connect body1='" << c.a << "' body2='" << c.b << "' anchor='" << text(c.point_a) << "'/>";
    }
    for (const Tie& t : ties) {
      xml << "<joint joint1='" << t.follower << t.follower_joint << "' joint2='" << t.leader << t.leader_joint
          << "' polycoef='0 " << number(t.ratio) << " 0 0 0'/>";
    }
    xml << "</equality></mujoco>";
    load(xml.str());
    // MuJoCo takes the second point from the bodies' placements at zero; the loop need not be closed there.
    for (std::size_t c = 0; c < connections.size(); ++c) {
      Eigen::Map<Vec3>(model_->eq_data + mjNEQDATA * static_cast<int>(c) + 3) = connections[c].point_b;
    }
  }

  Index n_q() const { return model_->nq; }
  Index n_v() const { return model_->nv; }

  /// First coordinate and first velocity of a body.
  Index q_of(const std::string& body) const { return model_->jnt_qposadr[model_->body_jntadr[id(body)]]; }
  Index v_of(const std::string& body) const { return model_->body_dofadr[id(body)]; }
  Index count_of(const std::string& body) const { return model_->body_dofnum[id(body)]; }

  /// Moves the velocities `dependent` (numbers of hinges and slides) until all loops are closed, then sets their rates.
  /// By Newton on MuJoCo's own residuals and Jacobian, from where they stand in q. False if it does not close to 1e-15
  /// m.
  bool close(Eigen::VectorXd& q, Eigen::VectorXd& qd, const std::vector<Index>& dependent)
  {
    const auto columns = [&] {
      Eigen::MatrixXd J(residual_.size(), static_cast<Index>(dependent.size()));
      for (std::size_t k = 0; k < dependent.size(); ++k) { J.col(static_cast<Index>(k)) = J_.col(dependent[k]); }
      return J;
    };
    for (int iteration = 0; iteration < 30; ++iteration) {
      set(q, qd);
      const Eigen::VectorXd step = decompose(columns()).solve(residual_);
      for (std::size_t k = 0; k < dependent.size(); ++k) { q(q_of_v(dependent[k])) -= step(static_cast<Index>(k)); }
      if (step.norm() < 1e-15 * (1 + q.norm())) { break; }
    }
    for (const Index k : dependent) { qd(k) = 0; }
    set(q, qd);
    const Eigen::VectorXd rate = decompose(columns()).solve(J_ * qd);
    for (std::size_t k = 0; k < dependent.size(); ++k) { qd(dependent[k]) = -rate(static_cast<Index>(k)); }
    set(q, qd);
    return residual_.norm() < 20 * eps * (1 + q.norm()) && (J_ * qd).norm() < 1000 * eps * (1 + qd.norm());
  }

  /// q̈₀, and B̂ for the columns `B` of generalised forces, with all constraints kept.
  Answer solve(const Eigen::VectorXd& q, const Eigen::VectorXd& qd, const Eigen::MatrixXd& B)
  {
    set(q, qd);
    const Index n = n_v();
    RowMatrix M(n, n);
    mj_fullM(model_.get(), M.data(), data_->qM);
    const Eigen::LLT<Eigen::MatrixXd> llt(M);
    Eigen::MatrixXd right(n, 1 + B.cols());
    right << -Eigen::Map<const Eigen::VectorXd>(data_->qfrc_bias, n), B;
    Eigen::MatrixXd qdd = llt.solve(right);
    if (J_.rows() > 0) {
      // q̈ − L⁻ᵀ A⁺ᵀ (J q̈ + J̇q̇), A = L⁻¹Jᵀ: rows of J that plane loops repeat do no harm.
      const Eigen::MatrixXd At = llt.matrixL().solve(J_.transpose()).transpose();
      Eigen::MatrixXd drift = J_ * qdd;
      drift.col(0) += Jdot_qd();
      qdd -= Eigen::MatrixXd(llt.matrixU().solve(decompose(At).solve(drift)));
    }
    return {qdd.col(0), qdd.rightCols(B.cols()), Status::ok};
  }

  /// Generalised forces of a force and a moment, in world axes, at a body's origin: n_v × 6. For the state of the last
  /// close() or solve().
  Eigen::MatrixXd wrench(const std::string& body) const
  {
    RowMatrix linear(3, n_v()), angular(3, n_v());
    const int at = id(body);
    mj_jac(model_.get(), data_.get(), linear.data(), angular.data(), data_->xpos + 3 * at, at);
    Eigen::MatrixXd columns(n_v(), 6);
    columns << linear.transpose(), angular.transpose();
    return columns;
  }

  /// Rows (q̈₀, B̂) of some bodies, one after the other.
  Eigen::MatrixXd rows_of(const Answer& answer, const std::vector<std::string>& bodies) const
  {
    Eigen::MatrixXd rows(0, 1 + answer.Bhat.cols());
    for (const std::string& body : bodies) {
      const Index begin = v_of(body), count = count_of(body);
      rows.conservativeResize(rows.rows() + count, Eigen::NoChange);
      rows.bottomRows(count) << answer.qdd0.segment(begin, count), answer.Bhat.middleRows(begin, count);
    }
    return rows;
  }

private:
  using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  struct Delete {
    void operator()(mjModel* model) const { mj_deleteModel(model); }
    void operator()(mjData* data) const { mj_deleteData(data); }
    void operator()(mjVFS* files) const
    {
      mj_deleteVFS(files);
      delete files;
    }
  };

  static std::string number(double x)
  {
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, "%.17g", x);
    return buffer;
  }
  static std::string text(const Eigen::VectorXd& x)
  {
    std::string all;
    for (const double entry : x) { all += (all.empty() ? "" : " ") + number(entry); }
    return all;
  }
  static Eigen::Vector4d quaternion(const Mat3& R)
  {
    const Eigen::Quaterniond turn(R);
    return {turn.w(), turn.x(), turn.y(), turn.z()};
  }

  /// Least squares of least norm; what is below 1e-9 of the largest is a repeated row, which plane loops have at 1e-16.
  static Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> decompose(const Eigen::MatrixXd& A)
  {
    Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> decomposition;
    decomposition.setThreshold(1e-9);
    decomposition.compute(A);
    return decomposition;
  }

  void write(std::ostringstream& xml, const std::vector<MujocoPart>& parts, const std::string& parent) const
  {
    for (const MujocoPart& part : parts) {
      if (part.parent != parent) { continue; }
      xml << "<body name='" << part.name << "' pos='" << text(part.at.p) << "' quat='" << text(quaternion(part.at.R))
          << "'>";
      // Principal axes from here: MuJoCo's own are good to 1e-7.
      const Eigen::SelfAdjointEigenSolver<Mat3> principal(part.body.inertia);
      Mat3 axes = principal.eigenvectors();
      if (axes.determinant() < 0) { axes.col(0) *= -1; }
      xml << "<inertial pos='" << text(part.body.com) << "' mass='" << number(part.body.mass) << "' quat='"
          << text(quaternion(axes)) << "' diaginertia='" << text(principal.eigenvalues()) << "'/>";
      for (std::size_t k = 0; k < part.joints.size(); ++k) {
        const std::string& kind = part.joints[k].kind;
        xml << "<joint name='" << part.name << k << "' type='" << kind << "'";
        if (kind == "hinge" || kind == "slide") { xml << " axis='" << text(part.joints[k].axis) << "'"; }
        xml << "/>";
      }
      for (std::size_t c = 0; c < connections_.size(); ++c) {
        const Connection& connection = connections_[c];
        if (connection.a == part.name) {
          xml << "<site name='a" << c << "' pos='" << text(connection.point_a) << "'/>";
        }
        if (connection.b == part.name) {
          xml << "<site name='b" << c << "' pos='" << text(connection.point_b) << "'/>";
        }
      }
      write(xml, parts, part.name);
      xml << "</body>";
    }
  }

  void load(const std::string& xml)
  {
    const std::unique_ptr<mjVFS, Delete> files(new mjVFS);
    mj_defaultVFS(files.get());
    mj_makeEmptyFileVFS(files.get(), "robot.xml", static_cast<int>(xml.size()));
    std::memcpy(files->filedata[mj_findFileVFS(files.get(), "robot.xml")], xml.data(), xml.size());
    char error[512] = "";
    model_.reset(mj_loadXML("robot.xml", files.get(), error, sizeof error));
    if (!model_) { throw std::runtime_error(std::string(error) + "\n" + xml); }
    data_.reset(mj_makeData(model_.get()));
  }

  int id(const std::string& body) const { return mj_name2id(model_.get(), mjOBJ_BODY, body.c_str()); }
  Index q_of_v(Index v) const { return model_->jnt_qposadr[model_->dof_jntid[v]]; }

  void set(const Eigen::VectorXd& q, const Eigen::VectorXd& qd)
  {
    Eigen::Map<Eigen::VectorXd>(data_->qpos, model_->nq) = q;
    Eigen::Map<Eigen::VectorXd>(data_->qvel, model_->nv) = qd;
    mj_fwdPosition(model_.get(), data_.get());
    mj_fwdVelocity(model_.get(), data_.get());
    J_ = Eigen::Map<const RowMatrix>(data_->efc_J, data_->ne, n_v());
    residual_ = Eigen::Map<const Eigen::VectorXd>(data_->efc_pos, data_->ne);
  }

  /// Rows in MuJoCo's order: three per connection, world axes; then the ties, which are linear.
  Eigen::VectorXd Jdot_qd() const
  {
    Eigen::VectorXd result = Eigen::VectorXd::Zero(J_.rows());
    std::fill_n(data_->qacc, model_->nv, 0.0);
    std::fill_n(data_->efc_force, data_->nefc, 0.0);
    mj_rnePostConstraint(model_.get(), data_.get());
    const auto acceleration = [&](const std::string& site) {
      double turning_then_linear[6];
      mj_objectAcceleration(model_.get(), data_.get(), mjOBJ_SITE, mj_name2id(model_.get(), mjOBJ_SITE, site.c_str()),
                            turning_then_linear, 0);
      return Vec3(turning_then_linear[3], turning_then_linear[4], turning_then_linear[5]);
    };
    for (std::size_t c = 0; c < connections_.size(); ++c) {
      const std::string name = std::to_string(c);
      result.segment<3>(3 * static_cast<Index>(c)) = acceleration("a" + name) - acceleration("b" + name);
    }
    return result;
  }

  std::vector<Connection> connections_;
  std::unique_ptr<mjModel, Delete> model_;
  std::unique_ptr<mjData, Delete> data_;
  Eigen::MatrixXd J_;
  Eigen::VectorXd residual_;
};

}  // namespace iim::test
