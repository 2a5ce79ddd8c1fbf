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

#include <iim/errors.hpp>
#include <iim/inputs.hpp>
#include <iim/spatial.hpp>
#include <iim/spd.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <array>
#include <cassert>
#include <utility>

namespace iim {

/// What a scene has; a term that is off costs nothing.
struct Scene {
  bool velocity = true;  ///< false: q̇ = 0, and the argument is not read
  bool gravity = true;   ///< false: free fall
};

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

  /// From the base outward: orientations, Jacobians, velocity terms, and the bodies in world axes.
  template <class Q, class V>
  void kinematics(const Q& q, const V& qd)
  {
    tree_.outward([&]<class N, class S>(const N& node, const S& s) {
      constexpr MotionPattern pattern = S::pattern;
      NodeState<S>& state = ws_.template node<S>(node);
      const Placement<Scalar>& at = tree_.placement(node.index);
      Vector3<Scalar> omega = Vector3<Scalar>::Zero();
      if (node.inlet < 0) {
        state.R = at.R;
        state.r = at.p;
      } else {
        const FrameState<Scalar>& inlet = ws_.frame(node.inlet);
        if (tree_.placement_turns(node.index)) {
          state.R.noalias() = inlet.R.lazyProduct(at.R);
        } else {
          state.R = inlet.R;
        }
        state.r.noalias() = inlet.r + inlet.R.lazyProduct(at.p);
        if constexpr (scene.velocity) { omega = inlet.omega; }
      }
      const detail::Coordinates<S> q_i = q.template segment<S::n_q>(node.q);
      detail::Velocities<S> qd_i = detail::Velocities<S>::Zero();
      if constexpr (scene.velocity) { qd_i = qd.template segment<S::n_i>(node.v); }
      check_state<S>(node.index, q_i, qd_i);

      auto frames = frame_motions<S>(node.frame, state, std::make_index_sequence<S::n_frames>{});
      if (!s.motion(state.R, q_i, qd_i, frames)) { fail(Status::invalid_state, node.index); }
      if constexpr (detail::is_free<S>()) { state.r += state.R * q_i.template head<3>(); }
      if constexpr (detail::rotor_count<S>() > 0) { state.qd = qd_i; }

      if constexpr (scene.velocity) {
        if (node.inlet >= 0) { state.c = omega.cross(omega.cross(state.r)); }
      }
      for (int k = 0; k < S::n_frames; ++k) {
        FrameState<Scalar>& f = ws_.frame(node.frame + k);
        if constexpr (scene.velocity) {
          // Twist of the frame relative to the inlet, and the accelerations that come with the inlet turning.
          const auto& S_k = state.S_k[static_cast<std::size_t>(k)];
          if constexpr (!pattern.bias) { f.bias.setZero(); }
          f.omega = omega;
          if constexpr (pattern.linear) {
            const Vector3<Scalar> v = S_k.template topRows<3>() * qd_i;
            f.bias.template head<3>() += Scalar(2) * omega.cross(v);
          }
          if constexpr (pattern.angular) {
            const Vector3<Scalar> w = S_k.template bottomRows<3>() * qd_i;
            f.omega += w;
            f.bias.template tail<3>() += omega.cross(w);
          }
        }
        place_bodies<pattern.offset>(tree_.frame_mass(node.frame + k), f.R, f.r, f.omega, f.A, f.h);
      }
      if constexpr (S::n_u > 0) {
        const Eigen::Matrix<Scalar, S::n_i, S::n_u> Bbar = s.Bbar(q_i);
        ws_.Bbar().template segment<S::n_i * S::n_u>(node.bbar) = Bbar.reshaped();
      }
      if constexpr (detail::has_internal_force<S>()) {
        ws_.load().template segment<S::n_i>(node.v) -= s.internal_force(q_i, qd_i);
      }
    });
  }

  /// h̄ −= B̄ u: motor torques on the velocities, contact wrenches on the frames.
  template <class InputsType, class U>
  void apply(const InputsType& inputs, const U& u)
  {
    inputs.for_each_active([&](const auto& input, Index column) {
      if (!detail::all_finite(u.segment(column, input.size))) { fail(Status::invalid_state, input.subsystem); }
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
    Vector6<Scalar> world = Vector6<Scalar>::Zero();
    if constexpr (scene.gravity) { world.template head<3>() = -tree_.gravity(); }
    tree_.outward([&]<class N, class S>(const N& node, const S&) {
      NodeState<S>& state = ws_.template node<S>(node);
      Vector6<Scalar> y = world;
      if (node.inlet >= 0) {
        y = shift_twist(state.r, ws_.frame(node.inlet).Vdot);
        if constexpr (scene.velocity) { y.template head<3>() += state.c; }
      }
      for (int k = 0; k < S::n_frames; ++k) {
        FrameState<Scalar>& f = ws_.frame(node.frame + k);
        f.Vdot = y;
        if constexpr (scene.velocity) { f.Vdot += f.bias; }
      }
      if constexpr (S::n_i > 0) {
        Eigen::Matrix<Scalar, S::n_i, 1> qdd = -state.psi;
        qdd.noalias() -= state.W.lazyProduct(y);
        ws_.qdd().template segment<S::n_i>(node.v) = qdd;
        for (int k = 0; k < S::n_frames; ++k) {
          FrameState<Scalar>& f = ws_.frame(node.frame + k);
          const auto& S_k = state.S_k[static_cast<std::size_t>(k)];
          if constexpr (S::pattern.linear) { f.Vdot.template head<3>() += S_k.template topRows<3>() * qdd; }
          if constexpr (S::pattern.angular) { f.Vdot.template tail<3>() += S_k.template bottomRows<3>() * qdd; }
        }
      }
    });
    // Only now: an overflow anywhere above has reached q̈.
    if (status_ == Status::ok && !detail::all_finite(ws_.qdd())) { fail(Status::not_finite, first_not_finite()); }
  }

  ForwardDynamics<Workspace> receipt() const { return {ws_, status_, subsystem_}; }
  Acceleration<Scalar> acceleration() const { return {ws_.qdd(), status_, subsystem_}; }
  void fail(Status status, Index subsystem)
  {
    if (status_ == Status::ok) {
      status_ = status;
      subsystem_ = subsystem;
    }
  }

private:
  template <class S>
  void check_state(Index i, const detail::Coordinates<S>& q, const detail::Velocities<S>& qd)
  {
    if (!detail::all_finite(q) || !detail::all_finite(qd)) { fail(Status::invalid_state, i); }
  }

  Index first_not_finite() const
  {
    for (const Node& node : tree_.nodes()) {
      const Index own_end = node.subtree_end > node.index + 1 ? tree_.node(node.index + 1).v : node.v_end;
      if (!detail::all_finite(ws_.qdd().segment(node.v, own_end - node.v))) { return node.index; }
    }
    return -1;
  }

  template <class S, std::size_t... K>
  std::array<FrameMotion<Scalar, S::n_i>, S::n_frames> frame_motions(Index first, NodeState<S>& state,
                                                                     std::index_sequence<K...>)
  {
    return {{{ws_.frame(first + static_cast<Index>(K)).R, ws_.frame(first + static_cast<Index>(K)).r, state.S_k[K],
              ws_.frame(first + static_cast<Index>(K)).bias}...}};
  }

  /// Newton–Euler (A1), (A2) of the bodies on one frame, about the coupling point: A and the velocity part of h.
  template <bool offset>
  static void place_bodies(const FrameMass<Scalar>& mass, const Matrix3<Scalar>& R, const Vector3<Scalar>& r,
                           const Vector3<Scalar>& omega, SpatialInertia<Scalar>& A, Vector6<Scalar>& h)
  {
    if (!mass.present) {
      A.set_zero();
      h.setZero();
      return;
    }
    Vector3<Scalar> mc = R * mass.first_moment;
    Matrix3<Scalar> RI;
    RI.noalias() = R.lazyProduct(mass.inertia);
    Matrix3<Scalar> Theta;
    Theta.noalias() = RI.lazyProduct(R.transpose());
    if constexpr (offset) {
      // From the frame's origin to the coupling point: Θ − m r̃r̃ − r̃ m̃c − m̃c r̃
      const Matrix3<Scalar> rx = skew(r);
      const Matrix3<Scalar> cx = skew(mc);
      const Matrix3<Scalar> cross = rx.lazyProduct(cx);
      Theta -= mass.mass * rx.lazyProduct(rx) + cross + cross.transpose();
      mc += mass.mass * r;
    }
    A.set_rigid(mass.mass, mc, Theta);
    if constexpr (scene.velocity) {
      h.template head<3>() = omega.cross(omega.cross(mc));
      h.template tail<3>() = omega.cross(Vector3<Scalar>(Theta * omega));
    } else {
      h.setZero();
    }
  }

  /// A subsystem without internal velocities hands on what it carries.
  template <class S, class N>
  void rigid_inward(const N& node, const S&)
  {
    NodeState<S>& state = ws_.template node<S>(node);
    FrameState<Scalar>& inlet = ws_.frame(node.inlet);
    Vector6<Scalar> p = Vector6<Scalar>::Zero();
    for (int k = 0; k < S::n_frames; ++k) {
      const FrameState<Scalar>& f = ws_.frame(node.frame + k);
      p += f.h;
      if constexpr (scene.velocity) { p.template head<3>() += f.A.M * state.c; }
      if constexpr (scene.velocity) { p.template tail<3>() += f.A.H.transpose() * state.c; }
      inlet.A.add_shifted(f.A, state.r);
    }
    inlet.h += shift_wrench(state.r, p);
  }

  template <class S, class N>
  void moving_inward(const N& node, const S& s)
  {
    constexpr int n_i = S::n_i;
    constexpr int n_frames = S::n_frames;
    constexpr int n_rotors = detail::rotor_count<S>();
    using MatrixI = Eigen::Matrix<Scalar, n_i, n_i>;
    using VectorI = Eigen::Matrix<Scalar, n_i, 1>;
    using Columns = Eigen::Matrix<Scalar, 6, n_i>;
    NodeState<S>& state = ws_.template node<S>(node);

    // U, D, h_g, h_q over the frames.
    std::array<Columns, n_frames> U_k;
    MatrixI D_k;
    Vector6<Scalar> hg = Vector6<Scalar>::Zero();
    VectorI hq = -ws_.load().template segment<n_i>(node.v);
    VectorI scale = VectorI::Zero();
    state.U.setZero();
    state.MbarR.setZero();
    for (int k = 0; k < n_frames; ++k) {
      const auto at = static_cast<std::size_t>(k);
      const FrameState<Scalar>& f = ws_.frame(node.frame + k);
      times<S>(f.A, state.S_k[at], U_k[at]);
      transposed_times<S>(state.S_k[at], U_k[at], D_k);
      state.U += U_k[at];
      state.MbarR += D_k;
      add_scale<S>(f.A, state.S_k[at], scale);
      Vector6<Scalar> p = f.h;
      if constexpr (scene.velocity && (S::pattern.bias || S::pattern.linear || S::pattern.angular)) { p += f.A * f.bias; }
      hg += p;
      VectorI hq_k;
      transposed_times<S>(state.S_k[at], p, hq_k);
      hq += hq_k;
    }

    // Rotors: J gᵀg with g = (0, aᵀ, e); z = its guidance part once W is known.
    std::array<Vector3<Scalar>, n_rotors> a;
    std::array<VectorI, n_rotors> e;
    std::array<Scalar, n_rotors> J;
    if constexpr (n_rotors > 0) {
      const auto rotors = s.rotors();
      for (int k = 0; k < n_rotors; ++k) {
        const auto at = static_cast<std::size_t>(k);
        add_rotor<S>(node, rotors[at], state, a[at], e[at], J[at], hg, hq);
        scale += J[at] * e[at].cwiseAbs2();
      }
    }

    if constexpr (detail::is_free<S>()) {
      if (!detail::invert_spd<Scalar, n_i>(state.MbarR, scale, state.MbarR_inv_root, state.MbarR_inv)) {
        fail(Status::not_positive_definite, node.index);
      }
      state.psi.noalias() = state.MbarR_inv.lazyProduct(hq);
      state.W = state.S_k[0].transpose();
      return;  // nothing passes on: A' = 0, p' = 0
    } else {
      if (!detail::invert_spd<Scalar, n_i>(state.MbarR, scale, state.MbarR_inv_root, state.MbarR_inv)) {
        fail(Status::not_positive_definite, node.index);
      }
      state.psi.noalias() = state.MbarR_inv.lazyProduct(hq);
      state.W.noalias() = state.MbarR_inv.lazyProduct(state.U.transpose());
    }
    if (node.inlet < 0) { return; }

    // What the parent sees, before the shift to its own point.
    SpatialInertia<Scalar> A;
    A.set_zero();
    if (tree_.inlet_mass(node.index).present) {
      Vector3<Scalar> omega = Vector3<Scalar>::Zero();
      if constexpr (scene.velocity) { omega = ws_.frame(node.inlet).omega; }
      Vector6<Scalar> h;
      place_bodies<false>(tree_.inlet_mass(node.index), state.R, Vector3<Scalar>::Zero(), omega, A, h);
      hg += h;
    }
    for (int k = 0; k < n_frames; ++k) {
      const auto at = static_cast<std::size_t>(k);
      reduce<S>(ws_.frame(node.frame + k).A, state.S_k[at], U_k[at], state.W, A);
    }
    for (int k = 0; k < n_rotors; ++k) {
      const auto at = static_cast<std::size_t>(k);
      if constexpr (Workspace::update == Update::printed) {
        A.J += J[at] * a[at] * a[at].transpose();
      } else {
        Vector6<Scalar> z = -(e[at].transpose() * state.W).transpose();
        z.template tail<3>() += a[at];
        add_square(J[at], z, A);
      }
    }
    if constexpr (Workspace::update == Update::printed) {
      subtract_product(state.U, state.W, A);
    }

    Vector6<Scalar> p = hg;
    p.noalias() -= state.W.transpose().lazyProduct(hq);
    if constexpr (scene.velocity) {
      p.template head<3>().noalias() += A.M.lazyProduct(state.c);
      p.template tail<3>().noalias() += A.H.transpose().lazyProduct(state.c);
    }
    FrameState<Scalar>& inlet = ws_.frame(node.inlet);
    inlet.h += shift_wrench(state.r, p);
    inlet.A.add_shifted(A, state.r);
  }

  /// U = A S, leaving out the rows of S that the pattern declares zero.
  template <class S>
  static void times(const SpatialInertia<Scalar>& A, const Eigen::Matrix<Scalar, 6, S::n_i>& S_k,
                    Eigen::Matrix<Scalar, 6, S::n_i>& U)
  {
    constexpr MotionPattern pattern = S::pattern;
    if constexpr (pattern.angular) {
      U.template topRows<3>().noalias() = A.H.lazyProduct(S_k.template bottomRows<3>());
      U.template bottomRows<3>().noalias() = A.J.lazyProduct(S_k.template bottomRows<3>());
    } else {
      U.setZero();
    }
    if constexpr (pattern.linear) {
      U.template topRows<3>().noalias() += A.M.lazyProduct(S_k.template topRows<3>());
      U.template bottomRows<3>().noalias() += A.H.transpose().lazyProduct(S_k.template topRows<3>());
    }
  }

  /// Sᵀ x.
  template <class S, int cols>
  static void transposed_times(const Eigen::Matrix<Scalar, 6, S::n_i>& S_k, const Eigen::Matrix<Scalar, 6, cols>& x,
                               Eigen::Matrix<Scalar, S::n_i, cols>& y)
  {
    constexpr MotionPattern pattern = S::pattern;
    if constexpr (pattern.angular) {
      y.noalias() = S_k.template bottomRows<3>().transpose().lazyProduct(x.template bottomRows<3>());
      if constexpr (pattern.linear) {
        y.noalias() += S_k.template topRows<3>().transpose().lazyProduct(x.template topRows<3>());
      }
    } else {
      y.noalias() = S_k.template topRows<3>().transpose().lazyProduct(x.template topRows<3>());
    }
  }

  /// Size of the diagonal of SᵀAS if nothing cancelled: what its roundings are relative to.
  template <class S>
  static void add_scale(const SpatialInertia<Scalar>& A, const Eigen::Matrix<Scalar, 6, S::n_i>& S_k,
                        Eigen::Matrix<Scalar, S::n_i, 1>& scale)
  {
    for (int j = 0; j < S::n_i; ++j) {
      if constexpr (S::pattern.linear) {
        scale(j) += S_k.col(j).template head<3>().cwiseAbs2().dot(A.M.diagonal());
      }
      if constexpr (S::pattern.angular) {
        scale(j) += S_k.col(j).template tail<3>().cwiseAbs2().dot(A.J.diagonal());
      }
    }
  }

  /// A −= U W, all blocks.
  template <int n_i>
  static void subtract_product(const Eigen::Matrix<Scalar, 6, n_i>& U, const Eigen::Matrix<Scalar, n_i, 6>& W,
                               SpatialInertia<Scalar>& A)
  {
    A.M.noalias() -= U.template topRows<3>().lazyProduct(W.template leftCols<3>());
    A.H.noalias() -= U.template topRows<3>().lazyProduct(W.template rightCols<3>());
    A.J.noalias() -= U.template bottomRows<3>().lazyProduct(W.template rightCols<3>());
  }

  /// Adds J z zᵀ.
  static void add_square(const Scalar& J, const Vector6<Scalar>& z, SpatialInertia<Scalar>& A)
  {
    const Vector6<Scalar> Jz = J * z;
    A.M.noalias() += Jz.template head<3>() * z.template head<3>().transpose();
    A.H.noalias() += Jz.template head<3>() * z.template tail<3>().transpose();
    A.J.noalias() += Jz.template tail<3>() * z.template tail<3>().transpose();
  }

  /// Adds Pᵀ A_k P with P = 1 − S W; with the printed update A_k alone (U W is subtracted once, for all frames).
  ///
  /// A_k − U_k W changes to first order when roundings move W; the congruence does not, it is stationary in W. It is
  /// symmetric as A_k − Wᵀy − yᵀW with y = ½ (U_kᵀ + z), z = Sᵀ (A_k − U_k W). (U_kᵀ − ½ D_k W is the same y on paper,
  /// but keeps the rounding errors of U: measured ten times less accurate on a chain of 100.)
  template <class S>
  static void reduce(const SpatialInertia<Scalar>& A_k, const Eigen::Matrix<Scalar, 6, S::n_i>& S_k,
                     const Eigen::Matrix<Scalar, 6, S::n_i>& U_k, const Eigen::Matrix<Scalar, S::n_i, 6>& W,
                     SpatialInertia<Scalar>& A)
  {
    if constexpr (Workspace::update == Update::projected) {
      constexpr MotionPattern pattern = S::pattern;
      const auto Wv = W.template leftCols<3>();
      const auto Ww = W.template rightCols<3>();
      Eigen::Matrix<Scalar, S::n_i, 6> y = U_k.transpose();
      if constexpr (pattern.linear) {
        const auto St = S_k.template topRows<3>().transpose();
        const Matrix3<Scalar> M = A_k.M - U_k.template topRows<3>().lazyProduct(Wv);
        const Matrix3<Scalar> H = A_k.H - U_k.template topRows<3>().lazyProduct(Ww);
        y.template leftCols<3>() += St.lazyProduct(M);
        y.template rightCols<3>() += St.lazyProduct(H);
      }
      if constexpr (pattern.angular) {
        const auto St = S_k.template bottomRows<3>().transpose();
        const Matrix3<Scalar> H = A_k.H.transpose() - U_k.template bottomRows<3>().lazyProduct(Wv);
        const Matrix3<Scalar> J = A_k.J - U_k.template bottomRows<3>().lazyProduct(Ww);
        y.template leftCols<3>() += St.lazyProduct(H);
        y.template rightCols<3>() += St.lazyProduct(J);
      }
      y *= Scalar(0.5);
      subtract_symmetric<S::n_i>(W, y, A);
    }
    A += A_k;
  }

  /// A −= Wᵀ y + yᵀ W.
  template <int n_i>
  static void subtract_symmetric(const Eigen::Matrix<Scalar, n_i, 6>& W, const Eigen::Matrix<Scalar, n_i, 6>& y,
                                 SpatialInertia<Scalar>& A)
  {
    const auto Wv = W.template leftCols<3>();
    const auto Ww = W.template rightCols<3>();
    const auto yv = y.template leftCols<3>();
    const auto yw = y.template rightCols<3>();
    A.M.noalias() -= Wv.transpose().lazyProduct(yv);
    A.M.noalias() -= yv.transpose().lazyProduct(Wv);
    A.H.noalias() -= Wv.transpose().lazyProduct(yw);
    A.H.noalias() -= yv.transpose().lazyProduct(Ww);
    A.J.noalias() -= Ww.transpose().lazyProduct(yw);
    A.J.noalias() -= yw.transpose().lazyProduct(Ww);
  }

  /// U, D, h of one rotor; leaves its axis a (zero for an armature) in world axes, and e, its spin per q̇_i.
  template <class S, class N, class RotorType>
  void add_rotor(const N& node, const RotorType& rotor, NodeState<S>& state, Vector3<Scalar>& a,
                 Eigen::Matrix<Scalar, S::n_i, 1>& e, Scalar& J, Vector6<Scalar>& hg,
                 Eigen::Matrix<Scalar, S::n_i, 1>& hq)
  {
    J = rotor.inertia;
    e = rotor.ratio.transpose();
    if (!rotor.coupled) {
      a.setZero();
      state.MbarR += J * e * e.transpose();
      return;
    }
    const bool on_inlet = rotor.frame < 0;
    const Matrix3<Scalar>& R = on_inlet ? state.R : ws_.frame(node.frame + rotor.frame).R;
    a.noalias() = R.lazyProduct(rotor.axis);
    const Eigen::Matrix<Scalar, S::n_i, 1> spin_ratio = e;
    if (!on_inlet) {
      e.noalias() += state.S_k[static_cast<std::size_t>(rotor.frame)].template bottomRows<3>().transpose() * a;
    }
    state.U.template bottomRows<3>().noalias() += J * a * e.transpose();
    state.MbarR += J * e * e.transpose();
    if constexpr (scene.velocity) {
      Vector3<Scalar> omega = Vector3<Scalar>::Zero();
      Scalar bias = Scalar(0);
      if (!on_inlet) {
        omega = ws_.frame(node.frame + rotor.frame).omega;
        bias = a.dot(ws_.frame(node.frame + rotor.frame).bias.template tail<3>());
      } else if (node.inlet >= 0) {
        omega = ws_.frame(node.inlet).omega;
      }
      const Scalar spin = J * (a.dot(omega) + spin_ratio.dot(state.qd));
      const Vector3<Scalar> moment = spin * omega.cross(a) + J * bias * a;
      hg.template tail<3>() += moment;
      hq += J * bias * e;
      if (!on_inlet) {
        hq.noalias() += state.S_k[static_cast<std::size_t>(rotor.frame)].template bottomRows<3>().transpose() *
                        (spin * omega.cross(a));
      }
    }
  }

  const Tree& tree_;
  Workspace& ws_;
  Status status_ = Status::ok;
  Index subsystem_ = -1;
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
