// PROGRAM: iim_peers_dart
// REQUIRES: dart
// DART. Its free joint moves by the twist (ω, v) in the body's own axes.
#include "packaged.hpp"

#include "peers.hpp"
#include "worker.hpp"

#include <dart/config.hpp>
#include <dart/dynamics/BodyNode.hpp>
#include <dart/dynamics/FreeJoint.hpp>
#include <dart/dynamics/PrismaticJoint.hpp>
#include <dart/dynamics/RevoluteJoint.hpp>
#include <dart/dynamics/Skeleton.hpp>

#include <Eigen/Cholesky>

#include <type_traits>

namespace peers {
namespace {

namespace dd = ::dart::dynamics;

Eigen::Isometry3d placement(const Matrix3d& R, const Vector3d& p)
{
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = R;
  T.translation() = p;
  return T;
}

template <class JointType>
dd::BodyNode* add(const dd::SkeletonPtr& skeleton, dd::BodyNode* parent, const Joint& joint)
{
  typename JointType::Properties properties;
  properties.mName = joint.name + "_joint";
  properties.mT_ParentBodyToJoint = placement(joint.R, joint.p);
  if constexpr (!std::is_same_v<JointType, dd::FreeJoint>) { properties.mAxis = joint.axis; }
  dd::BodyNode::Properties body;
  body.mName = joint.name;
  const Matrix3d& I = joint.inertia;
  body.mInertia = dd::Inertia(joint.mass, joint.com, I);
  return skeleton->createJointAndBodyNodePair<JointType>(parent, properties, body).second;
}

class DartPeer : public Peer {
public:
  DartPeer(const Model& model, const std::vector<State>& states)
      : skeleton_(dd::Skeleton::create(model.name)), order_(model.n_v), full_(model.fully_actuated()),
        JcT_(model.n_v, 3 * static_cast<Index>(model.contacts.size())), qdd0_(model.n_v),
        Bhat_(MatrixXd::Zero(model.n_v, model.columns())), llt_(model.n_v)
  {
    skeleton_->setGravity(model.gravity);
    std::vector<dd::BodyNode*> bodies;
    for (const Joint& joint : model.joints) {
      dd::BodyNode* parent = joint.parent < 0 ? nullptr : bodies[static_cast<std::size_t>(joint.parent)];
      switch (joint.kind) {
        case JointKind::floating: bodies.push_back(add<dd::FreeJoint>(skeleton_, parent, joint)); break;
        case JointKind::revolute: bodies.push_back(add<dd::RevoluteJoint>(skeleton_, parent, joint)); break;
        case JointKind::prismatic: bodies.push_back(add<dd::PrismaticJoint>(skeleton_, parent, joint)); break;
      }
    }
    // DART may number the skeleton's coordinates as it likes.
    for (std::size_t k = 0; k < bodies.size(); ++k) {
      const dd::Joint* joint = bodies[k]->getParentJoint();
      for (int d = 0; d < model.joints[k].n_v(); ++d) {
        const int own = model.joints[k].kind == JointKind::floating ? (d + 3) % 6 : d;
        order_(model.joints[k].v + d) = static_cast<int>(joint->getIndexInSkeleton(static_cast<std::size_t>(own)));
      }
    }
    for (const int v : model.motors) { motors_.push_back(order_(v)); }
    for (int c = 0; c < model.columns(); ++c) { columns_.push_back(c); }
    for (const Contact& contact : model.contacts) {
      contacts_.push_back({bodies[static_cast<std::size_t>(contact.joint)], contact.p});
    }
    for (const State& x : states) {
      State own{VectorXd(model.n_v), VectorXd(model.n_v)};
      for (int v = 0; v < model.n_v; ++v) { own.qd(order_(v)) = x.qd(v); }
      for (const Joint& joint : model.joints) {
        if (joint.kind == JointKind::floating) {
          const Eigen::Quaterniond turn(x.q(joint.q + 6), x.q(joint.q + 3), x.q(joint.q + 4), x.q(joint.q + 5));
          const auto T = placement(turn.normalized().toRotationMatrix(), x.q.segment<3>(joint.q));
          const Eigen::Matrix<double, 6, 1> positions = dd::FreeJoint::convertToPositions(T);
          for (int d = 0; d < 6; ++d) { own.q(order_(joint.v + d)) = positions((d + 3) % 6); }
        } else {
          own.q(order_(joint.v)) = x.q(joint.q);
        }
      }
      states_.push_back(own);
    }
  }

  std::vector<Path> paths() override
  {
    return {{"computeForwardDynamics, getInvMassMatrix", [this](std::size_t k) { inverse(states_[k]); },
             [this] { return full_ ? sorted(skeleton_->getInvMassMatrix(), motors_) : sorted(Bhat_, columns_); }},
            {"getMassMatrix, Eigen's LLT", [this](std::size_t k) { mass_matrix(states_[k]); },
             [this] { return sorted(Bhat_, columns_); }}};
  }

private:
  struct Point {
    const dd::BodyNode* body;
    Vector3d p;
  };

  void inverse(const State& x)
  {
    skeleton_->setPositions(x.q);
    skeleton_->setVelocities(x.qd);
    skeleton_->computeForwardDynamics();
    qdd0_ = skeleton_->getAccelerations();
    const MatrixXd& inverse = skeleton_->getInvMassMatrix();
    if (full_) { return; }
    for (std::size_t c = 0; c < motors_.size(); ++c) { Bhat_.col(static_cast<Index>(c)) = inverse.col(motors_[c]); }
    if (contacts_.empty()) { return; }
    contact_jacobians();
    Bhat_.rightCols(JcT_.cols()).noalias() = inverse * JcT_;
  }

  void mass_matrix(const State& x)
  {
    skeleton_->setPositions(x.q);
    skeleton_->setVelocities(x.qd);
    llt_.compute(skeleton_->getMassMatrix());
    qdd0_ = -skeleton_->getCoriolisAndGravityForces();
    Bhat_.setZero();
    for (std::size_t c = 0; c < motors_.size(); ++c) { Bhat_(motors_[c], static_cast<Index>(c)) = 1; }
    if (!contacts_.empty()) {
      contact_jacobians();
      Bhat_.rightCols(JcT_.cols()) = JcT_;
    }
    llt_.solveInPlace(qdd0_);
    llt_.solveInPlace(Bhat_);
  }

  void contact_jacobians()
  {
    Index column = 0;
    for (const Point& point : contacts_) {
      JcT_.middleCols<3>(column) = skeleton_->getLinearJacobian(point.body, point.p).transpose();
      column += 3;
    }
  }

  /// In iim's order; `columns`: where DART has the columns.
  Result sorted(const MatrixXd& Bhat, const std::vector<int>& columns) const
  {
    Result result{VectorXd(qdd0_.size()), MatrixXd(Bhat.rows(), Bhat.cols())};
    for (Index v = 0; v < order_.size(); ++v) {
      result.qdd0(v) = qdd0_(order_(v));
      for (Index c = 0; c < Bhat.cols(); ++c) {
        result.Bhat(v, c) = Bhat(order_(v), columns[static_cast<std::size_t>(c)]);
      }
    }
    return result;
  }

  dd::SkeletonPtr skeleton_;
  Eigen::VectorXi order_;     // index in DART of each velocity
  std::vector<int> motors_;   // in DART's numbering
  std::vector<int> columns_;  // 0, 1, 2, …
  std::vector<Point> contacts_;
  std::vector<State> states_;  // in DART's form
  bool full_;
  MatrixXd JcT_;
  VectorXd qdd0_;
  MatrixXd Bhat_;
  Eigen::LLT<MatrixXd> llt_;
};

}  // namespace
}  // namespace peers

int main(int argc, char** argv)
{
  using namespace peers;
  return serve({"DART", DART_VERSION,
                [](const Model& model, const std::vector<State>& states) -> std::unique_ptr<Peer> {
                  return std::make_unique<DartPeer>(model, states);
                }},
               argc, argv);
}
