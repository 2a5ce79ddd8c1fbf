// PROGRAM: iim_peers_pinocchio
// REQUIRES: pinocchio
// Pinocchio 3. Its velocities, quaternion and depth-first order are the same as iim's: no conversion of states.
#include "peers.hpp"
#include "worker.hpp"

// GCC 12 with AVX-512 warns of reads beyond six-vectors that its own headers load under a mask.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Warray-bounds"
#pragma GCC diagnostic ignored "-Wstringop-overread"
#endif

// Its templates compiled here, with our flags, instead of those in the packaged library.
#undef PINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION

#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/cholesky.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody/data.hpp>
#include <pinocchio/multibody/model.hpp>

#include <Eigen/Cholesky>

#include <stdexcept>

namespace peers {
namespace {

namespace pin = ::pinocchio;

pin::JointModel joint_model(const Joint& joint)
{
  if (joint.kind == JointKind::floating) { return pin::JointModelFreeFlyer(); }
  const bool turns = joint.kind == JointKind::revolute;
  if (joint.axis == Vector3d::UnitX()) { return turns ? pin::JointModel(pin::JointModelRX()) : pin::JointModelPX(); }
  if (joint.axis == Vector3d::UnitY()) { return turns ? pin::JointModel(pin::JointModelRY()) : pin::JointModelPY(); }
  if (joint.axis == Vector3d::UnitZ()) { return turns ? pin::JointModel(pin::JointModelRZ()) : pin::JointModelPZ(); }
  if (turns) { return pin::JointModelRevoluteUnaligned(joint.axis); }
  return pin::JointModelPrismaticUnaligned(joint.axis);
}

pin::Model build(const Model& from, std::vector<pin::FrameIndex>& contacts)
{
  pin::Model model;
  model.gravity.linear() = from.gravity;
  std::vector<pin::JointIndex> ids;
  for (const Joint& joint : from.joints) {
    const pin::JointIndex parent = joint.parent < 0 ? 0 : ids[static_cast<std::size_t>(joint.parent)];
    ids.push_back(model.addJoint(parent, joint_model(joint), pin::SE3(joint.R, joint.p), joint.name));
    model.appendBodyToJoint(ids.back(), pin::Inertia(joint.mass, joint.com, joint.inertia), pin::SE3::Identity());
  }
  for (const Contact& contact : from.contacts) {
    contacts.push_back(model.addFrame(pin::Frame(contact.name, ids[static_cast<std::size_t>(contact.joint)],
                                                 pin::SE3(Matrix3d::Identity(), contact.p), pin::OP_FRAME)));
  }
  return model;
}

class PinocchioPeer : public Peer {
public:
  PinocchioPeer(const Model& model, const std::vector<State>& states)
      : model_(build(model, contacts_)), data_(model_), states_(states), motors_(model.motors),
        full_(model.fully_actuated()), zero_(VectorXd::Zero(model.n_v)), tau_(VectorXd::Zero(model.n_v)),
        J_(pin::Data::Matrix6x::Zero(6, model.n_v)), JcT_(model.n_v, 3 * static_cast<Index>(model.contacts.size())),
        qdd0_(model.n_v), Bhat_(model.n_v, model.columns()), llt_(model.n_v)
  {
    for (State& x : states_) {  // the quaternions of the pool are those that float holds; Pinocchio wants unit length
      for (const Joint& joint : model.joints) {
        if (joint.kind == JointKind::floating) { x.q.segment<4>(joint.q + 3).normalize(); }
      }
    }
  }

  std::vector<Path> paths() override
  {
    std::vector<Path> paths;
    const auto dense = [this] { return Result{qdd0_, Bhat_}; };
    const auto inverse = [this] { return Result{qdd0_, full_ ? MatrixXd(data_.Minv) : Bhat_}; };
    paths.push_back({"aba, computeMinverse", [this](std::size_t k) { minverse(states_[k]); }, inverse});
    paths.push_back({"crba, sparse Cholesky", [this](std::size_t k) { cholesky(states_[k]); }, dense});
    paths.push_back({"crba, Eigen's LLT", [this](std::size_t k) { llt(states_[k]); }, dense});
    if (contacts_.empty() && motors_.size() == 1) {
      paths.push_back({"aba twice", [this](std::size_t k) { twice(states_[k]); }, dense});
    }
    return paths;
  }

private:
  void minverse(const State& x)
  {
    qdd0_ = pin::aba(model_, data_, x.q, x.qd, zero_, pin::Convention::WORLD);
    pin::computeMinverse(model_, data_);  // the upper triangle
    auto& inverse = data_.Minv;
    if (contacts_.empty() && !full_) {
      for (std::size_t c = 0; c < motors_.size(); ++c) {
        const Index j = motors_[c];
        auto column = Bhat_.col(static_cast<Index>(c));
        column.head(j + 1) = inverse.col(j).head(j + 1);
        column.tail(model_.nv - j - 1) = inverse.row(j).tail(model_.nv - j - 1).transpose();
      }
      return;
    }
    inverse.triangularView<Eigen::StrictlyLower>() = inverse.transpose().triangularView<Eigen::StrictlyLower>();
    if (full_) { return; }
    for (std::size_t c = 0; c < motors_.size(); ++c) { Bhat_.col(static_cast<Index>(c)) = inverse.col(motors_[c]); }
    contact_jacobians();
    Bhat_.rightCols(JcT_.cols()).noalias() = inverse * JcT_;
  }

  void cholesky(const State& x)
  {
    mass_matrix_and_inputs(x);
    pin::cholesky::decompose(model_, data_);
    pin::cholesky::solve(model_, data_, qdd0_);
    pin::cholesky::solve(model_, data_, Bhat_);
  }

  void llt(const State& x)
  {
    mass_matrix_and_inputs(x);
    llt_.compute(data_.M);
    llt_.solveInPlace(qdd0_);
    llt_.solveInPlace(Bhat_);
  }

  void mass_matrix_and_inputs(const State& x)
  {
    pin::crba(model_, data_, x.q, pin::Convention::WORLD);  // the upper triangle
    qdd0_ = -pin::nonLinearEffects(model_, data_, x.q, x.qd);
    Bhat_.setZero();
    for (std::size_t c = 0; c < motors_.size(); ++c) { Bhat_(motors_[c], static_cast<Index>(c)) = 1; }
    if (!contacts_.empty()) {
      contact_jacobians();
      Bhat_.rightCols(JcT_.cols()) = JcT_;
    }
  }

  /// From data.J and data.oMi, which aba, crba and nonLinearEffects leave behind.
  void contact_jacobians()
  {
    Index column = 0;
    for (const pin::FrameIndex frame : contacts_) {
      pin::updateFramePlacement(model_, data_, frame);
      J_.setZero();
      pin::getFrameJacobian(model_, data_, frame, pin::LOCAL_WORLD_ALIGNED, J_);
      JcT_.middleCols<3>(column) = J_.topRows<3>().transpose();
      column += 3;
    }
  }

  void twice(const State& x)
  {
    qdd0_ = pin::aba(model_, data_, x.q, x.qd, zero_, pin::Convention::LOCAL);
    tau_(motors_[0]) = 1;
    Bhat_.col(0) = pin::aba(model_, data_, x.q, x.qd, tau_, pin::Convention::LOCAL) - qdd0_;
  }

  std::vector<pin::FrameIndex> contacts_;
  pin::Model model_;
  pin::Data data_;
  std::vector<State> states_;
  std::vector<int> motors_;
  bool full_;
  VectorXd zero_, tau_;
  pin::Data::Matrix6x J_;
  MatrixXd JcT_;
  VectorXd qdd0_;
  MatrixXd Bhat_;
  Eigen::LLT<MatrixXd, Eigen::Upper> llt_;
};

}  // namespace
}  // namespace peers

int main(int argc, char** argv)
{
  using namespace peers;
  return serve({"Pinocchio", PINOCCHIO_VERSION,
                [](const Model& model, const std::vector<State>& states) -> std::unique_ptr<Peer> {
                  if (model.n_v > 600) { throw std::runtime_error("its Data takes four tensors of n³ numbers, 32 GB"); }
                  return std::make_unique<PinocchioPeer>(model, states);
                }},
               argc, argv);
}
