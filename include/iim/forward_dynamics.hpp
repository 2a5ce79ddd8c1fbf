// O(n) forward dynamics of a tree of subsystems, Sect. 2.3: three loops, and the receipt that they ran.
//
// In axes parallel to the world with own origins the recursions (14)–(19) read, with i's inlet on a frame of p,
//
//     y_i  = X(r_i) V̇_inlet + (c_i; 0)                        guidance acceleration, c_i = ω × (ω × r_i)
//     U = Σ_k A_k S_k,   D = M̄_R = Σ_k S_kᵀ A_k S_k,   W = D⁻¹ Uᵀ                                    (17)
//     A' = Σ_k P_kᵀ A_k P_k + …,  P_k = 1 − S_k W             what p sees of i: T*ᵀ M̄* T before the shift  (14), (16)
//     p' = h_g − Wᵀ h_q                                                                              (15)
//     q̈_i = −D⁻¹ h_q − W y_i                                                                         (18)
//     V̇_k = y_i + S_k q̈_i + bias_k                                                                   (19)
//
// with A_k, h_k inertia and bias wrench of what frame k carries, bodies and children; h_g = Σ_k (A_k bias_k + h_k),
// h_q = Σ_k S_kᵀ (A_k bias_k + h_k) + internal forces. Gravity is the world accelerating upward.
#pragma once

#include <iim/articulated_inertia.hpp>
#include <iim/errors.hpp>
#include <iim/inputs.hpp>
#include <iim/kinematics.hpp>
#include <iim/spatial.hpp>
#include <iim/spd.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <array>
#include <cassert>
#include <cstddef>

namespace iim {

namespace detail {
template <Scene scene, class Workspace>
class ForwardPass;
}

/// Receipt of `forward_dynamics`: the workspace holds the O(n) pass of one state, u = 0. Only it makes one.
/// Refers to the tree and the workspace; good until the workspace's next use.
template <class WorkspaceType>
class ForwardDynamics {
public:
  using Workspace = WorkspaceType;
  using Tree = typename Workspace::Tree;
  using Scalar = typename Workspace::Scalar;

  const Tree& tree() const { return workspace_->tree(); }
  const Workspace& workspace() const { return *workspace_; }

  /// State-dependent acceleration q̈₀ = −M⁻¹h, n_v [rad/s², m/s²]. Not to be used unless status() is ok.
  const VectorX<Scalar>& qdd0() const { return workspace_->qdd(); }

  Status status() const { return status_; }
  bool ok() const { return status_ == Status::ok; }
  /// Index of the subsystem that status() is about; −1 if it is about none.
  Index subsystem() const { return subsystem_; }

private:
  ForwardDynamics(const Workspace& workspace, Status status, Index subsystem)
      : workspace_(&workspace), status_(status), subsystem_(subsystem)
  {
  }
  template <Scene scene, class W>
  friend class detail::ForwardPass;

  const Workspace* workspace_;
  Status status_;
  Index subsystem_;
};

/// Acceleration under given inputs, and how its computation ended.
template <class Scalar>
struct Acceleration {
  const VectorX<Scalar>& qdd;  ///< n_v; lives in the workspace
  Status status;
  Index subsystem;
};

namespace detail {

/// The three loops.
template <Scene scene, class Workspace>
class ForwardPass {
public:
  using Tree = typename Workspace::Tree;
  using Scalar = typename Workspace::Scalar;

  explicit ForwardPass(Workspace& ws) : tree_(ws.tree()), ws_(ws) { ws_.load().setZero(); }

  template <class Q, class V>
  void kinematics(const Q& q, const V& qd)
  {
    detail::kinematics<scene>(q, qd, ws_, diagnosis_);
  }

  /// h̄ −= B̄ u: motor torques on the velocities, contact wrenches on the frames.
  template <class InputsType, class U>
  void apply(const InputsType& inputs, const U& u)
  {
    inputs.for_each_active([&](const auto& input, Index column) {
      if (!detail::all_finite(u.segment(column, input.size))) { diagnosis_.fail(Status::invalid_state, input.subsystem); }
      if (input.kind == InputKind::motor) {
        const Index rows = input.velocities;
        for (Index j = 0; j < input.size; ++j) {
          ws_.load().segment(input.v, rows) += ws_.Bbar().segment(input.bbar + j * rows, rows) * u(column + j);
        }
      } else {
        FrameState<Scalar>& f = ws_.frame(input.frame);
        for (Index j = 0; j < input.size; ++j) { f.h -= input_wrench(input, f, j) * u(column + j); }
      }
    });
  }

  /// From the tips inward: what the tree beyond each coupling point looks like from there, (14)–(17).
  void inertia()
  {
    tree_.inward([&]<class N, class S>(const N& node, const S& s) {
      if constexpr (S::n_i == 0) {
        if (node.inlet >= 0) { rigid_inward<S>(node, s); }
      } else {
        moving_inward<S>(node, s);
      }
    });
  }

  /// From the base outward again: accelerations, (18) and (19).
  void accelerations()
  {
    tree_.outward([&]<class N, class S>(const N& node, const S&) {
      NodeState<S>& state = ws_.template node<S>(node);
      Vector6<Scalar> y;
      if (node.inlet >= 0) {
        y = shift_twist(state.r, ws_.frame(node.inlet).Vdot);
        if constexpr (scene.velocity) {
          for (int i = 0; i < 3; ++i) { y(i) += state.c(i); }
        }
      } else {
        for (int i = 0; i < 3; ++i) {
          y(i) = scene.gravity ? Scalar(-tree_.gravity()(i)) : Scalar(0);
          y(i + 3) = Scalar(0);
        }
      }
      detail::Velocities<S> qdd;
      for (int d = 0; d < S::n_i; ++d) {
        qdd(d) = -state.psi(d) - ((state.W(d, 0) * y(0) + state.W(d, 1) * y(1) + state.W(d, 2) * y(2)) +
                                  (state.W(d, 3) * y(3) + state.W(d, 4) * y(4) + state.W(d, 5) * y(5)));
        ws_.qdd()(node.v + d) = qdd(d);
      }
      for (int k = 0; k < S::n_frames; ++k) {
        FrameState<Scalar>& f = ws_.frame(node.frame + k);
        f.Vdot = y;
        if constexpr (has_bias<S>(0)) { for (int i = 0; i < 3; ++i) { f.Vdot(i) += f.bias(i); } }
        if constexpr (has_bias<S>(3)) { for (int i = 3; i < 6; ++i) { f.Vdot(i) += f.bias(i); } }
        const auto& S_k = state.S_k[static_cast<std::size_t>(k)];
        for (int d = 0; d < S::n_i; ++d) {
          if constexpr (S::pattern.linear) { for (int i = 0; i < 3; ++i) { f.Vdot(i) += S_k(i, d) * qdd(d); } }
          if constexpr (S::pattern.angular) { for (int i = 3; i < 6; ++i) { f.Vdot(i) += S_k(i, d) * qdd(d); } }
        }
      }
    });
    // Only now: an overflow anywhere above has reached q̈.
    if (diagnosis_.status == Status::ok && !detail::all_finite(ws_.qdd())) { diagnosis_.fail(Status::not_finite, first_not_finite()); }
  }

  ForwardDynamics<Workspace> receipt() const { return {ws_, diagnosis_.status, diagnosis_.subsystem}; }
  Acceleration<Scalar> acceleration() const { return {ws_.qdd(), diagnosis_.status, diagnosis_.subsystem}; }

private:
  /// Whether a frame of S has a bias acceleration in the linear (0) or angular (3) rows.
  template <class S>
  static constexpr bool has_bias(int rows)
  {
    return scene.velocity && (S::pattern.bias || (rows == 0 ? S::pattern.linear : S::pattern.angular));
  }

  Index first_not_finite() const
  {
    for (const Node& node : tree_.nodes()) {
      const Index own_end = node.subtree_end > node.index + 1 ? tree_.node(node.index + 1).v : node.v_end;
      if (!detail::all_finite(ws_.qdd().segment(node.v, own_end - node.v))) { return node.index; }
    }
    return -1;
  }

  /// Bias wrench of what frame k carries: h + A bias.
  template <class S>
  [[gnu::always_inline]] static Vector6<Scalar> bias_wrench(const FrameState<Scalar>& f)
  {
    Vector6<Scalar> p = f.h;
    if constexpr (has_bias<S>(0)) { add_wrench_of_linear(f.A, linear(f.bias), p); }
    if constexpr (has_bias<S>(3)) {
      const Vector3<Scalar> a = angular(f.bias);
      const Vector3<Scalar> force = f.A.force_of_angular(a);
      const Vector3<Scalar> moment = f.A.moment_of_angular(a);
      for (int i = 0; i < 3; ++i) {
        p(i) += force(i);
        p(i + 3) += moment(i);
      }
    }
    return p;
  }

  [[gnu::always_inline]] static void add_wrench_of_linear(const SpatialInertia<Scalar>& A, const Vector3<Scalar>& a,
                                                          Vector6<Scalar>& p)
  {
    const Vector3<Scalar> force = A.force_of_linear(a);
    const Vector3<Scalar> moment = A.moment_of_linear(a);
    for (int i = 0; i < 3; ++i) {
      p(i) += force(i);
      p(i + 3) += moment(i);
    }
  }

  /// A subsystem without internal velocities hands on what it carries.
  template <class S, class N>
  void rigid_inward(const N& node, const S&)
  {
    NodeState<S>& state = ws_.template node<S>(node);
    FrameState<Scalar>& inlet = ws_.frame(node.inlet);
    for (int k = 0; k < S::n_frames; ++k) {
      const FrameState<Scalar>& f = ws_.frame(node.frame + k);
      Vector6<Scalar> p = f.h;
      if constexpr (scene.velocity) { add_wrench_of_linear(f.A, state.c, p); }
      add(inlet.h, shift_wrench(state.r, p));
      inlet.A.add_shifted(f.A, state.r);
    }
  }

  template <class S, class N>
  void moving_inward(const N& node, const S& s)
  {
    constexpr MotionPattern pattern = S::pattern;
    constexpr int n_i = S::n_i;
    constexpr int n_frames = S::n_frames;
    constexpr int n_rotors = detail::rotor_count<S>();
    using VectorI = Eigen::Matrix<Scalar, n_i, 1>;
    using Columns = Eigen::Matrix<Scalar, 6, n_i>;
    NodeState<S>& state = ws_.template node<S>(node);

    // U, D, h_g, h_q over the frames.
    std::array<Columns, n_frames> U_k;
    Eigen::Matrix<Scalar, n_i, n_i> D;
    Vector6<Scalar> hg;
    VectorI hq, scale;
    for (int d = 0; d < n_i; ++d) {
      hq(d) = -ws_.load()(node.v + d);
      scale(d) = Scalar(0);
      for (int e = 0; e < n_i; ++e) { D(e, d) = Scalar(0); }
    }
    for (int k = 0; k < n_frames; ++k) {
      const auto at = static_cast<std::size_t>(k);
      const FrameState<Scalar>& f = ws_.frame(node.frame + k);
      inertia_times<pattern>(f.A, state.S_k[at], U_k[at]);
      add_joint_inertia<pattern>(state.S_k[at], U_k[at], D);
      add_scale<pattern>(f.A, state.S_k[at], scale);
      const Vector6<Scalar> p = bias_wrench<S>(f);
      for (int d = 0; d < n_i; ++d) { hq(d) += column_dot<pattern>(state.S_k[at], d, p); }
      if (k == 0) {
        hg = p;
      } else {
        add(hg, p);
      }
    }
    Columns U = U_k[0];
    for (int k = 1; k < n_frames; ++k) { U += U_k[static_cast<std::size_t>(k)]; }

    // Rotors: J gᵀg with g = (0, aᵀ, e); what is left of it at the guidance part waits for W.
    std::array<SpunRotor<n_i>, n_rotors> spun;
    if constexpr (n_rotors > 0) {
      const auto rotors = s.rotors();
      for (std::size_t k = 0; k < n_rotors; ++k) {
        spun[k] = add_rotor<S>(node, rotors[k], state, U, D, hg, hq);
        for (int d = 0; d < n_i; ++d) { scale(d) += spun[k].J * spun[k].e(d) * spun[k].e(d); }
      }
    }

    if (!detail::invert_spd<Scalar, n_i>(D, scale, state.MbarR_inv_root, state.MbarR_inv)) {
      diagnosis_.fail(Status::not_positive_definite, node.index);
    }
    state.MbarR = D;
    state.U = U;
    for (int d = 0; d < n_i; ++d) {
      state.psi(d) = state.MbarR_inv(d, 0) * hq(0);
      for (int e = 1; e < n_i; ++e) { state.psi(d) += state.MbarR_inv(d, e) * hq(e); }
    }
    if constexpr (detail::is_free<S>()) {
      state.W = state.S_k[0].transpose();
      return;  // nothing passes on: A' = 0, p' = 0
    }
    Eigen::Matrix<Scalar, n_i, 6> W;
    for (int j = 0; j < 6; ++j) {
      for (int d = 0; d < n_i; ++d) {
        W(d, j) = state.MbarR_inv(d, 0) * U(j, 0);
        for (int e = 1; e < n_i; ++e) { W(d, j) += state.MbarR_inv(d, e) * U(j, e); }
      }
    }
    state.W = W;
    if (node.inlet < 0) { return; }

    // What the parent sees, before the shift to its own point.
    SpatialInertia<Scalar> A;
    for (int k = 0; k < n_frames; ++k) {
      const auto at = static_cast<std::size_t>(k);
      const SpatialInertia<Scalar>& A_k = ws_.frame(node.frame + k).A;
      if constexpr (Workspace::update == Update::projected) {
        if (k == 0) {
          A = projected<pattern>(A_k, state.S_k[at], U_k[at], W);
        } else {
          A += projected<pattern>(A_k, state.S_k[at], U_k[at], W);
        }
      } else if (k == 0) {
        A = A_k;
      } else {
        A += A_k;
      }
    }
    for (const SpunRotor<n_i>& rotor : spun) {
      Vector6<Scalar> z;
      set(z, Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(0)), rotor.a);
      if constexpr (Workspace::update == Update::projected) {
        for (int j = 0; j < 6; ++j) {
          for (int d = 0; d < n_i; ++d) { z(j) -= rotor.e(d) * W(d, j); }
        }
      }
      add_square(rotor.J, z, A);
    }
    if constexpr (Workspace::update == Update::printed) { subtract_product(U, W, A); }

    FrameState<Scalar>& inlet = ws_.frame(node.inlet);
    if (tree_.inlet_mass(node.index).present) {
      SpatialInertia<Scalar> A_inlet;
      Vector6<Scalar> h;
      const Vector3<Scalar> at_inlet(Scalar(0), Scalar(0), Scalar(0));
      place_bodies<false, scene.velocity>(tree_.inlet_mass(node.index), state.R, at_inlet, inlet.omega, A_inlet, h);
      A += A_inlet;
      add(hg, h);
    }
    for (int j = 0; j < 6; ++j) {
      for (int d = 0; d < n_i; ++d) { hg(j) -= W(d, j) * hq(d); }
    }
    if constexpr (scene.velocity) { add_wrench_of_linear(A, state.c, hg); }
    add(inlet.h, shift_wrench(state.r, hg));
    inlet.A.add_shifted(A, state.r);
  }

  /// A rotor in motion: its axis a (zero for an armature) in world axes, and e, its spin per q̇_i.
  template <int n_i>
  struct SpunRotor {
    Vector3<Scalar> a;
    Eigen::Matrix<Scalar, n_i, 1> e;
    Scalar J;
  };

  /// Adds one rotor to U, D, h.
  template <class S, class N, class RotorType>
  SpunRotor<S::n_i> add_rotor(const N& node, const RotorType& rotor, const NodeState<S>& state,
                              Eigen::Matrix<Scalar, 6, S::n_i>& U, Eigen::Matrix<Scalar, S::n_i, S::n_i>& D,
                              Vector6<Scalar>& hg, Eigen::Matrix<Scalar, S::n_i, 1>& hq)
  {
    constexpr int n_i = S::n_i;
    SpunRotor<n_i> spun{Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(0)), rotor.ratio.transpose(), rotor.inertia};
    const bool on_inlet = rotor.frame < 0;
    const std::size_t at = static_cast<std::size_t>(on_inlet ? 0 : rotor.frame);
    if (rotor.coupled) {
      spun.a = times(on_inlet ? state.R : ws_.frame(node.frame + rotor.frame).R, rotor.axis);
      if (!on_inlet) {
        for (int d = 0; d < n_i; ++d) {
          for (int i = 0; i < 3; ++i) { spun.e(d) += state.S_k[at](i + 3, d) * spun.a(i); }
        }
      }
    }
    for (int d = 0; d < n_i; ++d) {
      const Scalar Je = spun.J * spun.e(d);
      for (int e = 0; e < n_i; ++e) { D(e, d) += Je * spun.e(e); }
      for (int i = 0; i < 3; ++i) { U(i + 3, d) += Je * spun.a(i); }
    }
    if constexpr (scene.velocity) {
      if (!rotor.coupled) { return spun; }
      Vector3<Scalar> omega(Scalar(0), Scalar(0), Scalar(0));
      Scalar bias = Scalar(0);
      if (!on_inlet) {
        const FrameState<Scalar>& f = ws_.frame(node.frame + rotor.frame);
        omega = f.omega;
        for (int i = 0; i < 3; ++i) { bias += spun.a(i) * f.bias(i + 3); }
      } else if (node.inlet >= 0) {
        omega = ws_.frame(node.inlet).omega;
      }
      // Spin momentum J (a·ω + ratio q̇) a turns with the carrier.
      Scalar spin = spun.a(0) * omega(0) + spun.a(1) * omega(1) + spun.a(2) * omega(2);
      for (int d = 0; d < n_i; ++d) { spin += rotor.ratio(d) * state.qd(d); }
      spin *= spun.J;
      const Vector3<Scalar> gyroscopic = cross(omega, spun.a);
      for (int i = 0; i < 3; ++i) { hg(i + 3) += spin * gyroscopic(i) + spun.J * bias * spun.a(i); }
      for (int d = 0; d < n_i; ++d) {
        hq(d) += spun.J * bias * spun.e(d);
        for (int i = 0; i < 3 && !on_inlet; ++i) { hq(d) += spin * state.S_k[at](i + 3, d) * gyroscopic(i); }
      }
    }
    return spun;
  }

  const Tree& tree_;
  Workspace& ws_;
  Diagnosis diagnosis_;
};

}  // namespace detail

/// q̈₀ of the tree at the state (q, q̇), and in the workspace all that the input-Jacobian methods need. O(n).
/// q, q̇: dense vectors of n_q and n_v entries (asserted). Does not allocate or throw; a state that cannot be computed
/// comes back as a status.
template <Scene scene = Scene{}, class Workspace, class Q, class V>
ForwardDynamics<Workspace> forward_dynamics(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd,
                                            Workspace& workspace)
{
  assert(q.size() == workspace.tree().n_q() && "q must have n_q entries");
  assert((!scene.velocity || qd.size() == workspace.tree().n_v()) && "qd must have n_v entries");
  detail::ForwardPass<scene, Workspace> pass(workspace);
  pass.kinematics(q.derived(), qd.derived());
  pass.inertia();
  pass.accelerations();
  return pass.receipt();
}

/// q̈ of the tree at the state (q, q̇) under the inputs u (as many as inputs.columns(), asserted). O(n).
template <Scene scene = Scene{}, class Workspace, class Q, class V, class InputsType, class U>
Acceleration<typename Workspace::Scalar> forward_dynamics(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd,
                                                          const InputsType& inputs, const Eigen::MatrixBase<U>& u,
                                                          Workspace& workspace)
{
  assert(q.size() == workspace.tree().n_q() && "q must have n_q entries");
  assert((!scene.velocity || qd.size() == workspace.tree().n_v()) && "qd must have n_v entries");
  assert(u.size() == inputs.columns() && "u must have one entry per active column");
  detail::ForwardPass<scene, Workspace> pass(workspace);
  pass.kinematics(q.derived(), qd.derived());
  pass.apply(inputs, u.derived());
  pass.inertia();
  pass.accelerations();
  return pass.acceleration();
}

}  // namespace iim
