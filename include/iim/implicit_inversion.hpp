// The implicit inversion method, Sect. 4: B̂ from what the O(n) pass left, without M and without its inverse.
//
//     B̂ = Γ⁻¹ diag(M̄_R⁻¹) F*ᵀ B̄                                                                       (50)
//
// read from the left, as Algorithm 1 has it, Γ⁻¹ and F* once and a product for all inputs (product_form.hpp); or from
// the right, a few inputs at a time through the tree (sweep.hpp), which needs nothing of size n². Whichever is the
// cheaper.
#pragma once

#include <iim/affine_dynamics.hpp>
#include <iim/forward_dynamics.hpp>
#include <iim/inputs.hpp>
#include <iim/inversion/product_form.hpp>
#include <iim/inversion/product_pays.hpp>
#include <iim/inversion/sweep.hpp>
#include <iim/numerics/lane_count.hpp>
#include <iim/pass/forward_pass.hpp>
#include <iim/workspace.hpp>

#include <concepts>
#include <optional>

namespace iim {

/// B̂ and q̈₀ by implicit inversion. Owns its memory, O(n_v · m), and O(n_v · depth) if the product form may come to be
/// used; refers to tree and inputs.
template <class Tree>
class ImplicitInversion {
public:
  using Scalar = typename Tree::Scalar;

  ImplicitInversion(const Tree& tree, const Inputs<Tree>& inputs)
      : ImplicitInversion(tree, inputs, detail::product_pays_from(tree, inputs))
  {
  }
  ImplicitInversion(const Tree&&, const Inputs<Tree>&) = delete;
  ImplicitInversion(const Tree&, const Inputs<Tree>&&) = delete;

  /// For the inputs that are active now. No allocation, no exception.
  template <class Workspace>
    requires std::same_as<typename Workspace::Tree, Tree>
  AffineDynamics<Scalar> operator()(const ForwardDynamics<Workspace>& fd) &
  {
    const Status status = result_.status_on(*inputs_, fd.status_on(inputs_->tree()));
    if (status != Status::ok) { return result_.result(inputs_->columns(), status, fd.subsystem()); }
    auto Bhat = result_.Bhat(inputs_->columns());
    return finish(fd, use_product() ? (*product_)(fd.workspace(), Bhat) : (*sweep_)(fd.workspace(), Bhat));
  }

  /// The O(n) pass at the state (q, q̇) and this, in one call with the numbers of two. As a product, loops of both
  /// become one: q̈₀ and B̂ of an arm, a chain of 20 and one of 50 take 7 to 10 % less, of the biped 4 %. Arguments and
  /// errors as of forward_dynamics.
  template <Scene scene = Scene{}, class Q, class V, class Workspace>
    requires std::same_as<typename Workspace::Tree, Tree>
  StateDynamics<Workspace> operator()(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd,
                                      Workspace& workspace) &
  {
    static_assert(!scene.implicit, "of an implicit step, give the receipt: it says how long the step is");
    detail::ForwardPass<scene, Workspace> pass(workspace);
    bool finite = false;
    if (pass.fits(q.derived(), qd.derived())) {
      pass.out_and_in(q.derived(), qd.derived(), [] {});
      // Of several states the loops take 2 % less one after the other: they wait for nothing.
      constexpr bool waits = detail::lane_count<Scalar> != 1;
      if constexpr (waits) {
        if (use_product() &&
            result_.status_on(*inputs_, pass.receipt().status_on(inputs_->tree())) != Status::mismatch) {
          auto Bhat = result_.Bhat(inputs_->columns());
          finite = product_->with_accelerations(pass, workspace, Bhat);
          const auto fd = pass.receipt();
          return {fd.ok() ? finish(fd, finite) : result_.result(inputs_->columns(), fd.status(), fd.subsystem()), fd};
        }
      }
      pass.accelerations();
    }
    const auto fd = pass.receipt();
    return {(*this)(fd), fd};
  }

  /// Number of active columns from which on B̂ is computed as a product; below it, by sweeps.
  Index product_from() const { return product_from_; }

protected:
  /// With another number of columns from which the product form is used: to measure.
  ImplicitInversion(const Tree& tree, const Inputs<Tree>& inputs, Index product_from)
      : inputs_(&inputs), product_from_(product_from), result_(tree, inputs)
  {
    if (product_from_ <= inputs.max_columns()) { product_.emplace(tree, inputs); }
    if (product_from_ > 0) { sweep_.emplace(tree, inputs); }
  }

private:
  bool use_product() const { return inputs_->columns() >= product_from_; }

  /// finite: whether B̂ is known to be.
  template <class Workspace>
  AffineDynamics<Scalar> finish(const ForwardDynamics<Workspace>& fd, bool finite)
  {
    const Index m = inputs_->columns();
    result_.qdd0() = fd.qdd0();
    return result_.result(m, finite || detail::all_finite(result_.Bhat(m)) ? Status::ok : Status::not_finite, -1);
  }

  const Inputs<Tree>* inputs_;
  Index product_from_;
  std::optional<detail::ProductForm<Tree>> product_;
  std::optional<detail::Sweeps<Tree>> sweep_;
  detail::ResultMemory<Scalar> result_;
};

}  // namespace iim
