// PROGRAM: iim_peers_kdl
// REQUIRES: kdl
// Orocos KDL: its dynamics solvers know chains with a fixed base.
#include "packaged.hpp"

#include "peers.hpp"
#include "worker.hpp"

#include <kdl/config.h>
#include <kdl/chain.hpp>
#include <kdl/chaindynparam.hpp>
#include <kdl/chainidsolver_recursive_newton_euler.hpp>

#include <Eigen/Cholesky>

#include <stdexcept>

namespace peers {
namespace {

KDL::Vector vector(const Vector3d& x) { return {x(0), x(1), x(2)}; }

KDL::Chain chain(const Model& model)
{
  KDL::Chain chain;
  for (const Joint& joint : model.joints) {
    const Matrix3d& R = joint.R;
    const KDL::Frame place(
        KDL::Rotation(R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2)),
        vector(joint.p));
    const Matrix3d& I = joint.inertia;
    const KDL::RigidBodyInertia inertia(joint.mass, vector(joint.com),
                                        KDL::RotationalInertia(I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2), I(1, 2)));
    const auto type = joint.kind == JointKind::revolute ? KDL::Joint::RotAxis : KDL::Joint::TransAxis;
    chain.addSegment(
        KDL::Segment(joint.name, KDL::Joint(joint.name, place.p, place.M * vector(joint.axis), type), place, inertia));
  }
  return chain;
}

class KdlPeer : public Peer {
public:
  KdlPeer(const Model& model, const std::vector<State>& states)
      : chain_(chain(model)), n_(static_cast<unsigned>(model.n_v)), parameters_(chain_, vector(model.gravity)),
        newton_euler_(chain_, vector(model.gravity)), M_(n_), q_(n_), qd_(n_), zero_(n_), h_(n_),
        no_forces_(chain_.getNrOfSegments(), KDL::Wrench::Zero()), states_(states), motors_(model.motors),
        qdd0_(model.n_v), Bhat_(model.n_v, model.columns()), llt_(model.n_v)
  {
  }

  std::vector<Path> paths() override
  {
    return {{"JntToMass, CartToJnt, Eigen's LLT", [this](std::size_t k) { compute(states_[k]); },
             [this] { return Result{qdd0_, Bhat_}; }}};
  }

private:
  void compute(const State& x)
  {
    q_.data = x.q;
    qd_.data = x.qd;
    if (parameters_.JntToMass(q_, M_) < 0 || newton_euler_.CartToJnt(q_, qd_, zero_, no_forces_, h_) < 0) {
      throw std::runtime_error("KDL's solver failed");
    }
    llt_.compute(M_.data);
    qdd0_ = -h_.data;
    Bhat_.setZero();
    for (std::size_t c = 0; c < motors_.size(); ++c) { Bhat_(motors_[c], static_cast<Index>(c)) = 1; }
    llt_.solveInPlace(qdd0_);
    llt_.solveInPlace(Bhat_);
  }

  KDL::Chain chain_;
  unsigned n_;
  KDL::ChainDynParam parameters_;
  KDL::ChainIdSolver_RNE newton_euler_;
  KDL::JntSpaceInertiaMatrix M_;
  KDL::JntArray q_, qd_, zero_, h_;
  KDL::Wrenches no_forces_;
  std::vector<State> states_;
  std::vector<int> motors_;
  VectorXd qdd0_;
  MatrixXd Bhat_;
  Eigen::LLT<MatrixXd> llt_;
};

}  // namespace
}  // namespace peers

int main(int argc, char** argv)
{
  using namespace peers;
  return serve(
      {"Orocos KDL", KDL_VERSION_STRING,
       [](const Model& model, const std::vector<State>& states) -> std::unique_ptr<Peer> {
         if (!model.is_chain() || model.joints.front().kind == JointKind::floating || !model.contacts.empty()) {
           return nullptr;
         }
         return std::make_unique<KdlPeer>(model, states);
       }},
      argc, argv);
}
