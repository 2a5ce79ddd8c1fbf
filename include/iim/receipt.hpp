// What the O(n) pass returns: the receipt that it ran, which the methods for B̂ are applied to, or q̈ under inputs.
#pragma once

#include <iim/errors.hpp>
#include <iim/scene.hpp>
#include <iim/spatial.hpp>
#include <iim/tree_data.hpp>

#include <cassert>

namespace iim {

namespace detail {
template <Scene scene, class Workspace>
class ForwardPass;
}

/// Receipt of the O(n) pass of one state, u = 0, that the workspace holds: of `forward_dynamics`, `implicit_step`, or a
/// method that begins with the pass. Nothing else makes one. Refers to the tree and the workspace; good until the
/// workspace's next use, and told by the methods from one that is not.
template <class WorkspaceType>
class [[nodiscard]] ForwardDynamics {
public:
  using Workspace = WorkspaceType;
  using Tree = typename Workspace::Tree;
  using Scalar = typename Workspace::Scalar;

  const Tree& tree() const { return workspace_->tree(); }
  const Workspace& workspace() const { return *workspace_; }

  /// State-dependent acceleration q̈₀ = −M⁻¹h, n_v [rad/s², m/s²]; NaN unless status() is ok.
  const VectorX<Scalar>& qdd0() const { return workspace_->qdd(); }

  /// Length of the implicit step [s]; 0 for the accelerations of this instant.
  const Scalar& step() const { return step_; }

  /// What the pass left out; a method that computes velocity or gravity terms of its own must leave out the same.
  Scene scene() const { return scene_; }

  Status status() const { return status_; }
  bool ok() const { return status_ == Status::ok; }
  /// status(), or Status::mismatch for a method on another robot, or once the workspace has been used again.
  Status status_on(const detail::TreeData<Scalar>& tree) const
  {
    const bool is_same = tree.id() == workspace_->tree().id(), is_fresh = use_ == workspace_->uses();
    assert(is_same && "the receipt is of another tree than the method");
    assert(is_fresh && "the workspace has been used since the receipt");
    return is_same && is_fresh ? status_ : Status::mismatch;
  }
  /// The same for a method that computes terms of the scene.
  Status status_on(const detail::TreeData<Scalar>& tree, Scene scene) const
  {
    assert(scene_ == scene && "the receipt is of another Scene than the method");
    return scene_ == scene ? status_on(tree) : Status::mismatch;
  }
  /// Index of the subsystem that status() is about; −1 if it is about none.
  Index subsystem() const { return subsystem_; }

private:
  ForwardDynamics(const Workspace& workspace, Scene scene, const Scalar& step, Status status, Index subsystem)
      : workspace_(&workspace), use_(workspace.uses()), scene_(scene), step_(step), status_(status),
        subsystem_(subsystem)
  {
  }
  template <Scene scene, class W>
  friend class detail::ForwardPass;

  const Workspace* workspace_;
  Index use_;
  Scene scene_;
  Scalar step_;
  Status status_;
  Index subsystem_;
};

/// Acceleration under given inputs, and how its computation ended.
template <class Scalar>
struct [[nodiscard]] Acceleration {
  const VectorX<Scalar>& qdd;  ///< n_v [rad/s², m/s²]; lives in the workspace. NaN unless status is ok
  Status status;
  Index subsystem;  ///< that status is about; −1: none

  bool ok() const { return status == Status::ok; }
};

}  // namespace iim
