// This library as one of the peers, and the condition of the inertia matrix, which says how far answers may differ.
#pragma once

#include "../common/pool.hpp"
#include "peers.hpp"

#include <iim/iim.hpp>

#include <Eigen/Eigenvalues>

#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace peers {

using Tree = bench::Tree<double>;
using Inputs = iim::Inputs<Tree>;

/// The model as iim's users put it together.
inline iim::StandardAssembly<double> assembly(const Model& model)
{
  iim::StandardAssembly<double> assembly;
  assembly.set_gravity(model.gravity);
  for (const Joint& joint : model.joints) {
    iim::Attachment<double> on;
    if (joint.parent >= 0) { on.parent = model.joints[static_cast<std::size_t>(joint.parent)].name; }
    on.R = joint.R;
    on.p = joint.p;
    const iim::Body<double> body{joint.mass, joint.com, joint.inertia, false};
    switch (joint.kind) {
      case JointKind::floating: assembly.add(joint.name, on, iim::FloatingBase<double>{body}); break;
      case JointKind::revolute: assembly.add(joint.name, on, iim::RevoluteLink<double>{{joint.axis}, body}); break;
      case JointKind::prismatic: assembly.add(joint.name, on, iim::PrismaticLink<double>{{joint.axis}, body}); break;
    }
  }
  for (const Contact& contact : model.contacts) {
    iim::Attachment<double> on;
    on.parent = model.joints[static_cast<std::size_t>(contact.joint)].name;
    on.p = contact.p;
    assembly.add_frame(contact.name, on);
  }
  return assembly;
}

/// All of `model`'s inputs, in the order of its columns.
inline Inputs choose_inputs(const Tree& tree, const Model& model)
{
  Inputs inputs(tree, iim::Start::empty);
  for (const Joint& joint : model.joints) {
    for (const int v : model.motors) {
      if (v == joint.v) { inputs.add_motor(joint.name); }
    }
  }
  for (const Contact& contact : model.contacts) { inputs.add_force(contact.name); }
  return inputs;
}

/// Run-time tree, default accuracy tier.
class IimPeer : public Peer {
public:
  IimPeer(const Model& model, std::vector<State> states)
      : tree_(assembly(model)), inputs_(choose_inputs(tree_, model)), workspace_(tree_), method_(tree_, inputs_),
        states_(std::move(states))
  {
  }
  IimPeer(const IimPeer&) = delete;
  IimPeer& operator=(const IimPeer&) = delete;

  std::vector<Path> paths() override
  {
    return {{"implicit inversion",
             [this](std::size_t k) { last_.emplace(method_(states_[k].q, states_[k].qd, workspace_)); },
             [this] {
               if (!last_->ok()) { throw std::runtime_error(std::string("iim: ") + to_string(last_->status)); }
               return Result{last_->qdd0, last_->Bhat};
             }}};
  }

private:
  Tree tree_;
  Inputs inputs_;
  iim::Workspace<Tree> workspace_;
  iim::ImplicitInversion<Tree> method_;
  std::vector<State> states_;
  std::optional<iim::AffineDynamics<double>> last_;
};

/// λmax/λmin of M⁻¹, which is B̂ when every velocity is driven: motors on joints, a wrench in body axes on bases.
inline double condition_of_inertia_matrix(const Model& model, const State& state)
{
  const Tree tree(assembly(model));
  Inputs inputs(tree, iim::Start::empty);
  for (Index i = 0; i < tree.size(); ++i) {
    tree.visit(i, [&]<class N, class S>(const N&, const S&) {
      if constexpr (std::is_same_v<S, iim::FloatingBase<double>>) {
        inputs.add_wrench(tree.name(i), Vector3d::Zero(), iim::Axes::body);
      } else {
        inputs.add_motor(tree.name(i));
      }
    });
  }
  iim::Workspace<Tree> workspace(tree);
  iim::ImplicitInversion<Tree> method(tree, inputs);
  const auto dynamics = method(iim::forward_dynamics(state.q, state.qd, workspace));
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(dynamics.Bhat, Eigen::EigenvaluesOnly);
  if (!dynamics.ok() || !(solver.eigenvalues()(0) > 0)) {
    throw std::runtime_error("iim: M⁻¹ is not positive definite");
  }
  return solver.eigenvalues().tail<1>()(0) / solver.eigenvalues()(0);
}

}  // namespace peers
