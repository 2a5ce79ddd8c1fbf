// The implicit inversion as a product of matrices, Algorithm 1: Γ⁻¹ and F* first, then B̂ for all inputs at once.
//
// With C_a C_aᵀ = M̄_R⁻¹ of ancestor a (the root of the factor that (50) has in its middle) the two steps of
// Algorithm 1 run on columns that carry C_a from the start:
//
//     H_k(:, a) : accelerations of frame k per C-scaled coordinate of a, the rows G F*_p C_a of (31)
//     outward   y = X(r) H_inlet,   L_i(:, a) = −W y,   L_i(:, i) = C_i          L = Γ⁻¹ diag(C)      (48)
//               H_k(:, a) = y + S_k L_i(:, a),   H_k(:, i) = S_k C_i             H = F* diag(C)       (31)
//     B̂ = L (Lᵀ or Hᵀ) B̄ = Γ⁻¹ diag(M̄_R⁻¹) F*ᵀ B̄                                                     (50)
//
// Row i of L and H is non-zero only in the columns of i's ancestors, so these columns are numbered along the path from
// the world ("path positions"): no zero of a tree's branching is stored or multiplied.
#pragma once

#include <iim/affine_dynamics.hpp>
#include <iim/inputs.hpp>
#include <iim/inversion/branches.hpp>
#include <iim/inversion/bundle_product.hpp>
#include <iim/inversion/limb_product.hpp>
#include <iim/inversion/product_plan.hpp>
#include <iim/numerics/registers.hpp>
#include <iim/spatial.hpp>
#include <iim/square_root/unit_rows.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <numeric>
#include <optional>
#include <type_traits>

namespace iim::detail {

/// Of the product all that depends on Scalar alone, and the step of a single subsystem. Workspace: its part that
/// depends on Scalar and update alone.
template <class Scalar>
class ProductSteps : ProductPlan<Scalar> {
  using Plan = ProductPlan<Scalar>;
  using Plan::columns_, Plan::depth_, Plan::first_beta_, Plan::H_of_frame_, Plan::inputs_, Plan::projections_,
      Plan::rows_, Plan::scaled_, Plan::steps_, Plan::tree_;
  using Plan::components, Plan::lanes, Plan::row;
  using typename Plan::Projection, typename Plan::Scaled, typename Plan::Step;
  using Product = std::conditional_t<(lane_count<Scalar> > 1), BundleProduct<Scalar>, LimbProduct<Scalar>>;

protected:
  [[gnu::cold]] ProductSteps(const TreeData<Scalar>& tree, const InputBlocks<Scalar>& inputs)
      : Plan(tree, inputs, Product::least_rows), product_(tree, inputs), unit_rows_(tree)
  {
    H_.setZero(this->H_size_);
    apart_.setZero(components * (depth_ + lanes));
    this->plan(product_);
  }

  using Strip = detail::Strip<Scalar>;

  static constexpr int rate = 6;  ///< in square-root form H without S·rate, and rate; see SharedAxis, FreeLimb

  Scalar* H(Index frame) { return H_.data() + H_of_frame_[at(frame)]; }

  /// Step 2 at one subsystem: L and H; β = Hᵀ w or Lᵀ B̄ for the inputs that act on it. A function of its own: where g++
  /// inlines it into a long one, which depends on the program around, its rows do not stay in registers (all of a biped
  /// 18 %, of a chain of 100 65 % more).
  template <class S, class Workspace>
  [[gnu::noinline]] void outward(const Node& node, const NodeMemory<S>& state, const Workspace& ws)
  {
    const Step& step = steps_[at(node.index)];
    const Scalar* inlet = H_.data() + step.inlet;
    const FreeLimb<Scalar>* limb = nullptr;
    if constexpr (follows_free_axis<S, Workspace>) {
      if (step.needed == node.path_v) { limb = ws.free_limb(node.index); }
      if (limb != nullptr) [[unlikely]] { inlet = apart_from(ws.free_axis_of(*limb), node); }
    }
    if constexpr (shares_motion<S, Workspace> && S::n_i > 0) {
      if (ws.loads_bodies(node.index)) [[unlikely]] {  // H of its own may take the place of the inlet's
        project_on_body(ws, node, state.S_k[0].data(), S::n_i, state.r, false);
      }
    }
    propagate<S>(ws, node, state, step, inlet);
    if constexpr (follows_free_axis<S, Workspace>) {
      if (limb != nullptr) [[unlikely]] { follow(*limb, ws.free_axis_of(*limb).last, node, state.S_k[0], step); }
    }
    if constexpr (shares_motion<S, Workspace> && S::n_i > 0) {
      if (ws.loads_bodies(node.index)) [[unlikely]] {
        project_on_body(ws, node, state.S_k[0].data(), S::n_i, state.r, true);
      }
    }
    for (std::size_t k = step.projections; k < step.projections_end; ++k) { project<S>(ws, node, projections_[k]); }
  }

  /// Steps 2 and 3. outward_loop: calls outward for all subsystems.
  template <class Workspace, class Matrix, class Loop>
  bool compute(const Workspace& ws, Matrix& Bhat, Loop&& outward_loop)
  {
    assert(Bhat.outerStride() == column_stride<Scalar>(tree_->n_v()));
    if (inputs_.number_columns()) { this->plan(product_); }
    outward_loop();
    const bool finite = product_(rows_, columns_, Bhat);
    return scale_columns(ws, Bhat) && finite;
  }

  /// Columns that were rows of L, times their B̄. Returns true if they are known to be finite then.
  template <class Workspace, class Matrix>
  bool scale_columns(const Workspace& ws, Matrix& Bhat)
  {
    constexpr int side = register_lanes<Scalar>;
    using Register = Row<Scalar, side>;
    Register check = Register::Zero();
    for (const Scaled& scaled : scaled_) {
      const Scalar Bbar = ws.Bbar().data()[scaled.bbar];
      if (Bbar == Scalar(1)) { continue; }
      Scalar* const column = Bhat.data() + columns_[at(scaled.column)].begin;
      Register sum = Register::Zero();  // of each its own: a single one, sums wait for each other (several states 1 %)
      for (Index v = 0; v < Bhat.rows(); v += side) {  // with the zeros between columns
        const Register numbers = Register::load(column + v) * Bbar;
        numbers.store(column + v);
        sum += numbers;
      }
      check += sum;
    }
    std::array<Scalar, side> sums;
    check.store(sums.data());
    return detail::is_finite(std::accumulate(sums.begin(), sums.end(), Scalar(0)));
  }

  template <class S, class Workspace>
  [[gnu::always_inline]] void project(const Workspace& ws, const Node& node, const Projection& projection)
  {
    const Input<Scalar>& input = inputs_.inputs().block(projection.block);
    const Index depth = node.path_v + S::n_i;
    Scalar* const beta = row(first_beta_ + projection.column);
    if constexpr (S::n_i > 0) {
      if (input.kind == InputKind::motor) {
        if constexpr (shares_motion<S, Workspace>) {
          if (ws.loads_bodies(node.index)) [[unlikely]] { return; }
        }
        project_motor<S>(ws, input, beta, depth);
        return;
      }
    }
    if constexpr (Workspace::update == Update::square_root) {
      if (ws.is_heavy(input.frame)) [[unlikely]] {
        project_on_rows(ws, input, beta, depth);
        return;
      }
    }
    project_point(ws, input, beta, depth);
  }

  /// Columns 0 … needed of L and H, y = X(r) H_inlet, L_i = −W y, H_k = y + S_k L_i, and after them the subsystem's
  /// `own` ones: y = 0, L_i = C. The last lanes after these are zero, and therefore so in all that follows from them.
  template <class S, class Workspace>
  [[gnu::always_inline]] void propagate(const Workspace& ws, const Node& node, const NodeMemory<S>& state,
                                        const Step& step, const Scalar* const inlet)
  {
    constexpr int n_i = S::n_i;
    constexpr bool keeps_v = one_column<S, Workspace>;
    constexpr bool free_root = is_free<S>() && Workspace::update == Update::square_root;
    const Index depth = depth_, needed = step.needed, own = step.own, own_from = step.own_from;
    Scalar* const L_rows = rows_.data() + step.L;
    std::array<Scalar*, S::n_frames> frames{H_.data() + step.frame};
    for (int k = 1; k < S::n_frames; ++k) { frames[at(k)] = H(node.frame + k); }
    const auto columns = [&]<bool ancestors, bool others>(Index a) __attribute__((always_inline)) {
      std::array<Strip, n_i> l;
      l.fill(Strip::Zero());
      if (others && n_i == 1 && a >= own_from) {
        place(state.MbarR_inv_root(0, 0), node.path_v - a, l[0]);
      } else if (others && a >= own_from) {  // 2 % of several states
        for (Index e = std::max<Index>(0, a - node.path_v); e < std::min(own, a + lanes - node.path_v); ++e) {
          for_each_velocity<n_i, Scalar>([&](int d) __attribute__((always_inline)) {
            place(state.MbarR_inv_root(d, e), node.path_v + e - a, l[at(d)]);
          });
        }
      }
      std::array<Strip, n_i> moves = l;  // what the frames move by: a free one does not follow the ancestors' columns
      constexpr bool shares = shares_motion<S, Workspace>;
      [[maybe_unused]] Strip undone[shares && n_i > 1 ? n_i : 1];  // of q̈, against the inlet's rate along S
      if constexpr (shares) {
        for (Strip& of_velocity : undone) { of_velocity = Strip::Zero(); }
      }
      [[maybe_unused]] Strip slip = Strip::Zero();
      std::array<Strip, 6> y;
      y.fill(Strip::Zero());
      if (ancestors && a < needed) {
        for (int c = 0; c < 6; ++c) { y[at(c)] = load(inlet + components * a + c * lanes); }
        move_twist(state.r, y);
        if constexpr (Workspace::update == Update::square_root) {
          if (ws.root(node.inlet).keeps_v) {
            const SharedAxis<Scalar>& shared = ws.shared_axis(node.index);
            const Strip inlet_rate = add_rate(inlet + components * a, shared.difference, y);
            if constexpr (shares) {
              for (int d = 0; d < n_i; ++d) { undone[d] = shared.undone(d) * inlet_rate; }
            }
            slip = shared.slip * inlet_rate;
          }
        }
        for_each_velocity<n_i, Scalar>([&](int d) __attribute__((always_inline)) {
          for (int c = 5; c >= 0; --c) { l[at(d)] -= state.W(d, c) * y[at(c)]; }
        });
        if constexpr (is_free<S>()) { y.fill(Strip::Zero()); }
      }
      if constexpr (!is_free<S>()) { moves = l; }
      if constexpr (keeps_v) { store(frames[0] + components * a + rate * lanes, l[0] + slip); }
      if constexpr (shares) {
        for (int d = 0; d < n_i; ++d) { l[at(d)] -= undone[d]; }
      }
      for (int d = 0; d < n_i; ++d) { store(L_rows + d * depth + a, l[at(d)]); }
      if (!step.hands_on) { return; }
      if constexpr (free_root) {
        std::array<Strip, components> h;
        h.fill(Strip::Zero());
        for (Index e = std::max<Index>(0, a - node.path_v); e < std::min(own, a + lanes - node.path_v); ++e) {
          const auto& G = ws.root(node.frame).G;  // E b, and the rate
          for (int c = 0; c < components; ++c) { place(G[at(c)](e), node.path_v + e - a, h[at(c)]); }
        }
        for (int c = 0; c < components; ++c) { store(frames[0] + components * a + c * lanes, h[at(c)]); }
        return;
      }
      for (int k = 0; k < S::n_frames; ++k) {
        for (int c = 0; c < 6; ++c) {
          Strip h = y[at(c)];
          if (!keeps_v && (c < 3 ? S::pattern.linear : S::pattern.angular)) {
            for_each_velocity<n_i, Scalar>(
                [&](int d) __attribute__((always_inline)) { h += state.S_k[at(k)](c, d) * moves[at(d)]; });
          }
          store(frames[at(k)] + components * a + c * lanes, h);
        }
      }
    };
    if constexpr (lanes == 1) {  // each by itself: 9 % fewer instructions for step 2 of eight bipeds
      for (Index a = 0; a < needed; ++a) { columns.template operator()<true, false>(a); }
      for (Index a = needed; a < needed + own; ++a) { columns.template operator()<false, true>(a); }
    } else {
      for (Index a = 0; a < needed + own; a += lanes) { columns.template operator()<true, true>(a); }
    }
  }

  /// H of the axis' free frame without S·rate. (With a rate beside it, as in square-root form, step 2 of all robots
  /// takes 4 to 5 % of the time more.) Other columns than its own do not move that frame.
  [[gnu::noinline]] const Scalar* apart_from(const FreeAxis<Scalar>& axis, const Node& node)
  {
    apart_.head(components * ((node.path_v + lanes - 1) / lanes * lanes)).setZero();
    for (Index e = 0; e < 6; ++e) {
      Scalar* const column = component(apart_.data(), node.path_v - 6 + e);
      for (int c = 0; c < 6; ++c) { column[c * lanes] = axis.E(c, e); }
    }
    return apart_.data();
  }

  /// What the rate that was left out makes of L and H of a limb along the axis: W S = 1, but for what rotors within
  /// hold.
  [[gnu::noinline]] void follow(const FreeLimb<Scalar>& limb, const Scalar& last_rate, const Node& node,
                                const Vector6<Scalar>& S, const Step& step)
  {
    const Index last = node.path_v - 1;
    const Scalar on_axis = in_sense(limb.sense, last_rate), slip = on_axis * limb.slip;
    rows_(step.L + last) -= on_axis * limb.undone;
    Scalar* const column = component(H_.data() + step.frame, last);
    for (int c = 0; c < 6 && step.hands_on; ++c) { column[c * lanes] += S(c) * slip; }
  }

  /// The first of path position a.
  static Scalar* component(Scalar* H, Index a) { return H + a / lanes * lanes * components + a % lanes; }

  /// What H of a frame leaves out in square-root form, V += S·rate. Returns the rate.
  [[gnu::always_inline]] static Strip add_rate(const Scalar* h, const Vector6<Scalar>& S, std::array<Strip, 6>& V)
  {
    const Strip q_dot = load(h + rate * lanes);
    for (int c = 0; c < 6; ++c) { V[at(c)] += S(c) * q_dot; }
    return q_dot;
  }

  /// x into a lane that is zero.
  [[gnu::always_inline]] static void place(const Scalar& x, Index lane, Strip& to)
  {
    if constexpr (lanes == 1) {
      to = load(&x);
    } else {
      static constexpr std::array<Scalar, 2 * lanes> unit = [] {
        std::array<Scalar, 2 * lanes> numbers{};
        numbers[lanes] = 1;
        return numbers;
      }();
      to += load(unit.data() + lanes - lane) * x;
    }
  }

  /// β = Lᵀ B̄ in path positions 0 … depth.
  template <class S, class Workspace>
  void project_motor(const Workspace& ws, const Input<Scalar>& input, Scalar* beta, Index depth)
  {
    for (Index j = 0; j < input.size; ++j, beta += depth_) {
      const Scalar* Bbar = ws.Bbar().data() + input.bbar + j * S::n_i;
      for (Index a = 0; a < depth; a += lanes) {
        Strip sum = Strip::Zero();
        for (int d = 0; d < S::n_i; ++d) { sum += load(row(input.v + d) + a) * Bbar[d]; }
        store(beta + a, sum);
      }
    }
  }

  /// β = Hᵀ w: velocities of the point, and of its body, per path position.
  template <class Workspace>
  [[gnu::noinline]] void project_point(const Workspace& ws, const Input<Scalar>& input, Scalar* beta, Index depth)
  {
    const FrameState<Scalar>& f = ws.frame(input.frame);
    Vector3<Scalar> x = f.r;
    add(x, times(f.R, input.point));
    Matrix3<Scalar> axes;
    const bool turned = input.axes == Axes::body, wrench = input.size > 3;
    if (turned) { detail::multiply(f.R, input.R, axes); }
    const Scalar* h = H(input.frame);
    for (Index a = 0; a < depth; a += lanes) {
      std::array<Strip, 6> V;
      for (int c = 0; c < 6; ++c) { V[at(c)] = load(h + components * a + c * lanes); }
      if constexpr (Workspace::update == Update::square_root) {
        const RootInertia<Scalar>& N = ws.root(input.frame);
        if (N.keeps_v) { add_rate(h + components * a, N.S, V); }
      }
      move_twist(x, V);
      // Three rows by three, so that V stays in registers (2 % of several states).
      const auto put = [&]<int first>(std::integral_constant<int, first>) __attribute__((always_inline)) {
        unrolled<3>([&](auto c) __attribute__((always_inline)) {
          Strip v = V[first + c];
          if (turned) {
            const Scalar* axis = axes.data() + 3 * c;
            v = V[first] * axis[0] + V[first + 1] * axis[1] + V[first + 2] * axis[2];
          }
          store(beta + (first + c) * depth_ + a, v);
        });
      };
      put(std::integral_constant<int, 0>{});
      if (wrench) { put(std::integral_constant<int, 3>{}); }
    }
  }

  /// β of a heavy body: what its rows carry of the unit wrenches as z₁, what is left of these as Hᵀ w.
  template <class Workspace>
  [[gnu::cold]] void project_on_rows(const Workspace& ws, const Input<Scalar>& input, Scalar* beta, Index depth)
  {
    unit_rows_.carry_inward(ws, input.frame, false);
    for (Index j = 0; j < input.size; ++j, beta += depth_) {
      std::fill(beta, beta + depth, Scalar(0));
      add_on_rows(ws, input.frame, input_wrench(input, ws.frame(input.frame), j), beta, depth);
    }
  }

  /// β of motors between two heavy bodies (OpposedWrenches): what is on the inlet's, and after it what is on the own.
  /// S, r: as opposed_wrenches has them.
  template <class Workspace>
  [[gnu::cold, gnu::noinline]] void project_on_body(const Workspace& ws, const Node& node, const Scalar* S, int n_i,
                                                    const Vector3<Scalar>& r, bool own)
  {
    const Step& step = steps_[at(node.index)];
    const Index depth = node.path_v + (own ? n_i : 0), frame = own ? node.frame : node.inlet;
    std::optional<bool> carried;  // whether as shared
    for (std::size_t k = step.projections; k < step.projections_end; ++k) {
      const Input<Scalar>& input = inputs_.inputs().block(projections_[k].block);
      if (input.kind != InputKind::motor) { continue; }
      Scalar* beta = row(first_beta_ + projections_[k].column);
      for (Index j = 0; j < input.size; ++j, beta += depth_) {
        if (!own) { std::fill(beta, beta + node.path_v + n_i, Scalar(0)); }
        for (int d = 0; d < n_i; ++d) {
          const Scalar& Bbar = ws.Bbar()(input.bbar + j * n_i + d);
          const std::optional<OpposedWrenches<Scalar>> wrenches = opposed_wrenches(node, S, n_i, d, r, ws);
          if (wrenches) {
            const bool shared = own && wrenches->is_shared;
            if (carried != shared) { unit_rows_.carry_inward(ws, frame, shared); }
            carried = shared;
            add_on_rows(ws, frame, (own ? wrenches->on_frame : wrenches->on_inlet) * Bbar, beta, depth);
          } else if (own) {
            for (Index a = 0; a < depth; ++a) { beta[a] += row(input.v + d)[a] * Bbar; }
          }
        }
      }
    }
  }

  /// Of a wrench on a heavy frame, whose unit rows have been carried inward.
  template <class Workspace>
  void add_on_rows(const Workspace& ws, Index frame, Vector6<Scalar> left, Scalar* beta, Index depth)
  {
    const FrameState<Scalar>& f = ws.frame(frame);
    const RootInertia<Scalar>& N = ws.root(frame);
    const RootRow<Scalar> z = put_on_rows(ws.frame_body(frame), f.R, f.bodies_at(), left);
    for (Index a = 0; a < depth; ++a) {
      const Scalar* const h = component(H(frame), a);
      Scalar sum = unit_rows_.share(a, z);
      for (int c = 0; c < 6; ++c) {
        sum += h[c * lanes] * left(c);
        if (N.keeps_v) { sum += h[rate * lanes] * N.S(c) * left(c); }
      }
      beta[a] += sum;
    }
  }

  Product product_;
  VectorX<Scalar> H_;      // of a frame: per `lanes` path positions seven components, so that one address serves
  VectorX<Scalar> apart_;  // of one frame
  UnitRows<Scalar> unit_rows_;
};

/// B̂ from the workspace. Construction allocates O(n_v · depth + depth · m); nothing after it does. Refers to the tree.
template <class Tree>
class ProductForm : ProductSteps<typename Tree::Scalar> {
public:
  using Scalar = typename Tree::Scalar;

  [[gnu::cold]] ProductForm(const Tree& tree, const Inputs<Tree>& inputs) : ProductSteps<Scalar>(tree, inputs) {}

  /// Steps 2 and 3 of Algorithm 1: all active columns, n_v × inputs.columns(), `column_stride` apart. The workspace
  /// holds the O(n) pass. Returns true if B̂ is known to be finite.
  template <class Workspace, class Matrix>
  bool operator()(const Workspace& ws, Matrix& Bhat)
  {
    const typename Workspace::Data& data = ws;
    return this->compute(data, Bhat, [&] {
      ws.tree().outward(
          [&]<class S>(const Node& node, const S&) { this->outward(node, ws.template node<S>(node), data); });
    });
  }

  /// The same, step 2 in the last loop of the O(n) pass, which is yet to come.
  template <class Pass, class Workspace, class Matrix>
  bool with_accelerations(Pass& pass, const Workspace& ws, Matrix& Bhat)
  {
    const typename Workspace::Data& data = ws;
    return this->compute(data, Bhat, [&] {
      pass.accelerations([&](const Node& node, const auto& state) { this->outward(node, state, data); });
    });
  }
};

}  // namespace iim::detail
