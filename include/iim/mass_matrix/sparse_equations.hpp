// M (11) and h (12) of a tree: composite inertias for M, recursive Newton–Euler for h. B (13) beside it:
// input_matrix.hpp.
//
// Only what the outward kinematic loop of the O(n) pass leaves in the workspace is used (R, r, ω, bias, S_k, c), so
// that methods on M, h and B owe nothing to M̄*. World axes, every subsystem at its coupling point:
//
//     outward   y = X(r) a_inlet + (c; 0),   a_k = y + bias_k              accelerations for q̈ = 0, a_world = −g
//               f_k = I_k a_k + velocity terms                                                       (A2)
//     inward    F_i = Σ_k I_k S_k,   M_ii = Σ_k S_kᵀ I_k S_k      I_k: all that frame k carries, as one rigid body
//               h_i = Σ_k S_kᵀ f_k + internal forces                                                  (12)
//               I_inlet += X(r)ᵀ (Σ_k I_k) X(r),   f_inlet += X(r)ᵀ Σ_k f_k
//     outward   M_ia = F_iᵀ X(r) J_inlet(:, a)                    J: Jacobian in the ancestors' velocities     (11)
#pragma once

#include <iim/mass_matrix/composite_body.hpp>
#include <iim/mass_matrix/input_matrix.hpp>
#include <iim/numerics/array.hpp>
#include <iim/pass/articulated_inertia.hpp>
#include <iim/pass/internal_inertia.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <cstddef>

namespace iim::detail {

/// M and h of one state, and B beside them. Construction allocates; nothing after it does. Refers to tree and inputs.
/// Scene: that of the pass which filled the workspace.
template <class Tree, Scene scene = Scene{}>
class SparseEquations {
public:
  using Scalar = typename Tree::Scalar;

  SparseEquations(const Tree& tree, const Inputs<Tree>& inputs)
      : tree_(&tree), B_(tree, inputs), frames_(static_cast<std::size_t>(tree.n_frames())),
        y_(static_cast<std::size_t>(tree.size())), F_(static_cast<std::size_t>(tree.n_v())),
        M_(padded<Scalar>(tree.max_path_v()), tree.n_v()), h_(tree.n_v())
  {
    M_.setZero();
    h_.setZero();
  }

  template <class Workspace>
  void compute(const Workspace& ws)
  {
    newton_euler(ws);
    composites(ws);
    B_.begin();
    tree_->outward([&]<class N, class S>(const N& node, const S&) {
      B_.jacobian().template propagate<S>(node, ws.template node<S>(node), [&](Index a, const auto& y) {
        for (int d = 0; d < S::n_i; ++d) {
          const Vector6<Scalar>& F = F_[at(node.v + d)];
          const Strip<Scalar> row =
              (y[0] * F(0) + y[1] * F(1) + y[2] * F(2)) + (y[3] * F(3) + y[4] * F(4) + y[5] * F(5));
          store(M_.data() + (node.v + d) * M_.rows() + a, row, node.path_v - a);
        }
      });
      B_.template project<S>(node, ws);
    });
  }

  /// Column v: row v of M, by path position up to that of v's own subsystem; what stands behind it is not M.
  MatrixX<Scalar>& M() { return M_; }
  /// On and above the diagonal, into a matrix of zeros.
  void put_upper(const Limbs& limbs, MatrixX<Scalar>& M) const
  {
    for (Index v = 0; v < tree_->n_v(); ++v) {
      limbs.for_each_run(limbs.limb_of_velocity(v), 0, limbs.path_position(v) + 1,
                         [&](Index a, Index first, Index count) {
                           const Scalar* row = M_.data() + v * M_.rows() + a;
                           std::copy(row, row + count, M.data() + v * M.rows() + first);
                         });
    }
  }
  const VectorX<Scalar>& h() const { return h_; }
  const InputMatrix<Tree>& B() const { return B_; }

private:
  struct Composite {
    CompositeBody<Scalar> I;
    Vector6<Scalar> a;
    Vector6<Scalar> f;
  };

  /// Bodies in world axes, accelerations for q̈ = 0, and the wrenches that these take.
  template <class Workspace>
  void newton_euler(const Workspace& ws)
  {
    tree_->outward([&]<class N, class S>(const N& node, const S&) {
      const NodeState<S>& state = ws.template node<S>(node);
      Vector6<Scalar>& y = y_[at(node.index)];
      if (node.inlet >= 0) {
        y = shift_twist(state.r, frames_[at(node.inlet)].a);
        if constexpr (scene.velocity) {
          for (int i = 0; i < 3; ++i) { y(i) += state.c(i); }
        }
      } else {
        for (int i = 0; i < 3; ++i) {
          y(i) = scene.gravity ? Scalar(-tree_->gravity()(i)) : Scalar(0);
          y(i + 3) = Scalar(0);
        }
      }
      for (int k = 0; k < S::n_frames; ++k) {
        const FrameState<Scalar>& f = ws.frame(node.frame + k);
        Composite& composite = frames_[at(node.frame + k)];
        composite.a = y;
        if constexpr (has_bias<scene, S>(0)) {
          for (int i = 0; i < 3; ++i) { composite.a(i) += f.bias(i); }
        }
        if constexpr (has_bias<scene, S>(3)) {
          for (int i = 3; i < 6; ++i) { composite.a(i) += f.bias(i); }
        }
        SpatialInertia<Scalar> A;
        TriplePair<Scalar> h;
        place_bodies<is_placed_off<S>(), scene.velocity>(tree_->frame_mass(node.frame + k), f.R, triple(f.r),
                                                         triple(f.omega), A, h);
        h.put(composite.f.data());
        composite.I.set(A);
        add(composite.f, composite.I.template times<true, true>(linear(composite.a), angular(composite.a)));
      }
    });
  }

  /// h, the blocks M_ii, and F_i.
  template <class Workspace>
  void composites(const Workspace& ws)
  {
    tree_->inward([&]<class N, class S>(const N& node, const S& s) {
      constexpr int n_i = S::n_i;
      constexpr MotionPattern pattern = S::pattern;
      const NodeState<S>& state = ws.template node<S>(node);
      CompositeBody<Scalar> I = frames_[at(node.frame)].I;
      Vector6<Scalar> f = frames_[at(node.frame)].f;
      for (int k = 1; k < S::n_frames; ++k) {
        I += frames_[at(node.frame + k)].I;
        add(f, frames_[at(node.frame + k)].f);
      }
      if constexpr (n_i > 0) {
        Eigen::Matrix<Scalar, 6, n_i> F;
        Eigen::Matrix<Scalar, n_i, n_i> D;
        Eigen::Matrix<Scalar, n_i, 1> h;
        for (int d = 0; d < n_i; ++d) {
          h(d) = -ws.load()(node.v + d);
          for (int e = 0; e < n_i; ++e) { D(e, d) = Scalar(0); }
          for (int c = 0; c < 6; ++c) { F(c, d) = Scalar(0); }
        }
        for (int k = 0; k < S::n_frames; ++k) {
          const Composite& composite = frames_[at(node.frame + k)];
          const auto& S_k = state.S_k[at(k)];
          for (int d = 0; d < n_i; ++d) {
            const Vector6<Scalar> F_k = composite.I.template times<pattern.linear, pattern.angular>(
                Vector3<Scalar>(S_k(0, d), S_k(1, d), S_k(2, d)), Vector3<Scalar>(S_k(3, d), S_k(4, d), S_k(5, d)));
            for (int c = 0; c < 6; ++c) { F(c, d) += F_k(c); }
            if constexpr (pattern.linear || pattern.angular) {
              for (int e = d; e < n_i; ++e) { D(e, d) += column_dot<pattern>(S_k, e, F_k); }
              h(d) += column_dot<pattern>(S_k, d, composite.f);
            }
          }
        }
        for (int d = 0; d < n_i; ++d) {
          for (int e = 0; e < d; ++e) { D(e, d) = D(d, e); }
        }
        if constexpr (rotor_count<S>() > 0) { add_rotors(ws, node, s, state, F, D, h, I, f); }
        if constexpr (scene.implicit) {
          for (const auto& spring : state.springs) {
            add_spring(spring, D);
            for (int d = 0; d < n_i; ++d) { h(d) += spring.ratio(d) * spring.force; }
          }
        }
        for (int d = 0; d < n_i; ++d) {
          h_(node.v + d) = h(d);
          for (int c = 0; c < 6; ++c) { F_[at(node.v + d)](c) = F(c, d); }
          Scalar* own = M_.data() + (node.v + d) * M_.rows() + node.path_v;
          for (int e = 0; e < n_i; ++e) { own[e] = D(d, e); }
        }
      }
      if (node.inlet < 0) { return; }

      if (tree_->inlet_mass(node.index).present) {
        const Triple<Scalar> at_inlet(Scalar(0), Scalar(0), Scalar(0));
        const Vector6<Scalar>& y = y_[at(node.index)];
        SpatialInertia<Scalar> A;
        TriplePair<Scalar> h;
        place_bodies<false, scene.velocity>(tree_->inlet_mass(node.index), ws.inlet_axes(node, state), at_inlet,
                                            triple(ws.frame(node.inlet).omega), A, h);
        Vector6<Scalar> f_body;
        h.put(f_body.data());
        CompositeBody<Scalar> body;
        body.set(A);
        I += body;
        add(f, f_body);
        add(f, body.template times<true, true>(linear(y), angular(y)));
      }
      Composite& inlet = frames_[at(node.inlet)];
      inlet.I.add_shifted(I, state.r);
      add(inlet.f, shift_wrench(state.r, f));
    });
  }

  /// A rotor turns with its carrier and at ratio·q̇_i relative to it; e: its rate about its axis a per q̇_i. It adds
  /// J gᵀg to M̄_i, g = (0, aᵀ, eᵀ), and J (a·ω̇ for q̈ = 0) gᵀ to h̄_i.
  template <class Workspace, class N, class S>
  void add_rotors(const Workspace& ws, const N& node, const S& s, const NodeState<S>& state,
                  Eigen::Matrix<Scalar, 6, S::n_i>& F, Eigen::Matrix<Scalar, S::n_i, S::n_i>& D,
                  Eigen::Matrix<Scalar, S::n_i, 1>& h, CompositeBody<Scalar>& I, Vector6<Scalar>& f) const
  {
    const Vector6<Scalar>& y = y_[at(node.index)];
    for (const auto& rotor : s.rotors()) {
      const SpunRotor<S> spun = spin_rotor<scene, S>(node, rotor, state, ws);
      const Scalar turning = spun.J * (spun.bias + (spun.a(0) * y(3) + spun.a(1) * y(4) + spun.a(2) * y(5)));
      for (int d = 0; d < S::n_i; ++d) {
        const Scalar Je = spun.J * spun.e(d);
        for (int e = 0; e < S::n_i; ++e) { D(e, d) += Je * spun.e(e); }
        for (int i = 0; i < 3; ++i) { F(i + 3, d) += Je * spun.a(i); }
        h(d) += turning * spun.e(d);
      }
      for (int j = 0; j < 3; ++j) { f(j + 3) += turning * spun.a(j); }
      I.add_rotor(spun.J, spun.a);
      if constexpr (scene.velocity) { add_gyroscopic(spun, rotor, state, f, h); }
    }
  }

  const Tree* tree_;
  InputMatrix<Tree> B_;
  Array<Composite> frames_;
  Array<Vector6<Scalar>> y_;  // guidance acceleration for q̈ = 0
  Array<Vector6<Scalar>> F_;  // wrench at the own coupling point per q̈ of one velocity
  MatrixX<Scalar> M_;
  VectorX<Scalar> h_;
};

}  // namespace iim::detail
