// Task rows (3): what points, frames, the centre of mass and the momentum of a robot do under the inputs,
//
//     V̇_t = J_t q̈ + J̇_t q̇ = J_t B̂ u + V̇_t0,     V̇_t0 = J_t q̈₀ + J̇_t q̇                                    (3)
//
// A point is seen from every coupling point i on its path: with x from there to the point and k the frame that carries
// the path onward,
//
//     J_t(:, i) = X(x) S_k,     J̇_t q̇ = Σ_i X(x) (bias_k + (c_i; 0)) + (ω × (ω × x_tip); 0)           (8), (19)
//
// and V̇_t0 is the tip's acceleration in the O(n) pass. Centre of mass and momentum: mass_matrix/centroidal.hpp.
// Accelerations are those of an observer at rest: gravity is contained in V̇_t0 as the fall that it causes.
#pragma once

#include <iim/affine_dynamics.hpp>
#include <iim/errors.hpp>
#include <iim/inputs.hpp>
#include <iim/mass_matrix/centroidal.hpp>
#include <iim/numerics/array.hpp>
#include <iim/receipt.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/tree.hpp>
#include <iim/workspace.hpp>

#include <array>
#include <cassert>
#include <concepts>
#include <cstddef>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace iim {

/// What a block of task rows is about.
enum class TaskKind {
  point,    ///< velocity of a point, 3 rows [m/s]
  frame,    ///< velocity (3) of a point and angular velocity (3) of its body [m/s, rad/s]
  com,      ///< velocity of the centre of mass of all bodies of the tree, 3 rows [m/s]
  momentum  ///< linear momentum (3) and angular momentum about the centre of mass (3) [kg m/s, kg m²/s]
};

/// One block of task rows.
template <class Scalar>
struct Task {
  TaskKind kind;
  std::string name;
  Index size;                                       ///< number of rows
  Index frame = -1;                                 ///< that carries it (point, frame)
  Vector3<Scalar> point = Vector3<Scalar>::Zero();  ///< in that frame [m] (point, frame)
  Matrix3<Scalar> R = Matrix3<Scalar>::Identity();  ///< axes of a named frame on that frame (point, frame)
  Axes axes = Axes::world;
  bool active = true;
  std::vector<Index> velocities{};  ///< columns of J_t that are not zero
};

/// V̇_t = JB·u + Vdot0 = J·q̈ + Jdot_qd at one state, active tasks one below the other in the order of adding. Refers to
/// memory of the Tasks that made it; good until their next use. If status is not ok, all entries are NaN.
template <class Scalar>
struct [[nodiscard]] TaskRows {
  using Rows = Eigen::Map<const MatrixX<Scalar>, 0, Eigen::OuterStride<>>;

  Rows J;                                     ///< J_t, rows × n_v: V_t = J q̇
  Eigen::Map<const VectorX<Scalar>> Jdot_qd;  ///< J̇_t q̇
  Rows JB;                                    ///< J_t B̂, rows × m
  Eigen::Map<const VectorX<Scalar>> Vdot0;    ///< V̇_t0
  Status status;
  Index subsystem;  ///< that status is about; −1: none

  bool ok() const { return status == Status::ok; }
};

/// The tasks of a tree, block by block in the order of adding. Set-up may allocate and throw ModelError; evaluating and
/// set_active do neither. Refers to the tree and the inputs. `scene`: that of the forward_dynamics whose receipts it
/// gets.
template <class Tree, Scene scene = Scene{}>
class Tasks {
public:
  using Scalar = typename Tree::Scalar;
  using Id = Index;  ///< number of a block, in the order of adding

  /// With room for J_t B̂ of these inputs.
  Tasks(const Tree& tree, const Inputs<Tree>& inputs) : tree_(&tree), inputs_(&inputs), centroidal_(tree)
  {
    J_.resize(0, tree.n_v());
    JB_.resize(0, inputs.max_columns_on(tree));
  }
  Tasks(const Tree&&, const Inputs<Tree>&) = delete;
  Tasks(const Tree&, const Inputs<Tree>&&) = delete;

  /// Velocity of a point of a named frame, 3 rows. Throws ModelError if there is no such frame or the world carries it.
  /// Axes::body: the same vectors, resolved in the axes that the frame has at this instant.
  Id add_point(const std::string& frame, const FramePoint<Scalar>& point = {}, Axes axes = Axes::world)
  {
    return append(on_frame(TaskKind::point, 3, frame, point.at, axes));
  }
  Id add_point(const std::string& frame, Axes axes) { return add_point(frame, FramePoint<Scalar>(), axes); }

  /// Velocity of a point of a named frame and the frame's angular velocity, 6 rows; otherwise as add_point.
  Id add_frame(const std::string& frame, const FramePoint<Scalar>& point = {}, Axes axes = Axes::world)
  {
    return append(on_frame(TaskKind::frame, 6, frame, point.at, axes));
  }
  Id add_frame(const std::string& frame, Axes axes) { return add_frame(frame, FramePoint<Scalar>(), axes); }

  /// Velocity of the centre of mass of all bodies in the tree, 3 rows. Throws ModelError if there are none.
  Id add_com() { return append(of_all(TaskKind::com, 3, "centre of mass")); }

  /// Momentum of all bodies in the tree (linear, angular about their centre of mass), 6 rows: J = A_G. Throws as
  /// add_com.
  Id add_momentum() { return append(of_all(TaskKind::momentum, 6, "momentum")); }

  /// Switches a block of rows on or off. Rows of inactive blocks do not exist: those below them move up. (Of a number
  /// that is none of a block's, with assertions off: nothing.)
  void set_active(Id id, bool active)
  {
    assert(id >= 0 && id < blocks() && "no such task");
    if (id < 0 || id >= blocks()) { return; }
    tasks_[static_cast<std::size_t>(id)].active = active;
    arrange();
  }

  const Tree& tree() const { return *tree_; }
  Index rows() const { return rows_; }          ///< active rows
  Index max_rows() const { return max_rows_; }  ///< rows if all blocks are active
  Index blocks() const { return static_cast<Index>(tasks_.size()); }
  const Task<Scalar>& block(Id id) const
  {
    assert(id >= 0 && id < blocks() && "no such task");
    return tasks_[static_cast<std::size_t>(id)];
  }
  const Scalar& mass() const { return centroidal_.mass(); }  ///< of all bodies in the tree [kg]

  /// First row of a block; −1 while it is inactive.
  Index row(Id id) const
  {
    assert(id >= 0 && id < blocks() && "no such task");
    Index row = 0;
    for (Id k = 0; k < id; ++k) {
      if (block(k).active) { row += block(k).size; }
    }
    return block(id).active ? row : -1;
  }

  /// Where an active block was at the last evaluation: its point in the world, and the axes of its frame (point,
  /// frame); NaN if that had no result.
  const Placement<Scalar>& placement(Id id) const
  {
    assert(id >= 0 && id < blocks() && "no such task");
    return placements_[static_cast<std::size_t>(id)];
  }

  /// All of (3). `affine`: from the same receipt, by any method.
  template <class Workspace>
    requires std::same_as<typename Workspace::Tree, Tree>
  TaskRows<Scalar> operator()(const ForwardDynamics<Workspace>& fd, const AffineDynamics<Scalar>& affine) &
  {
    const bool fits = affine.Bhat.rows() == tree_->n_v() && (tasks_.empty() || affine.Bhat.cols() <= JB_.cols());
    assert(fits && "B̂ of another tree, or inputs were added after the last task");
    const Status status = fits ? fd.status_on(*tree_, scene) : Status::mismatch;
    if (status != Status::ok) { return result(fits ? affine.Bhat.cols() : 0, status, fd.subsystem()); }
    if (!affine.ok()) { return result(affine.Bhat.cols(), affine.status, affine.subsystem); }
    evaluate(fd);
    multiply(affine.Bhat);
    return checked(affine.Bhat.cols());
  }

  /// The same of a pass and a method in one call.
  template <class Workspace>
    requires std::same_as<typename Workspace::Tree, Tree>
  TaskRows<Scalar> operator()(const StateDynamics<Workspace>& dynamics) &
  {
    return (*this)(dynamics.fd, dynamics);
  }

  /// Without J_t B̂: JB has no columns.
  template <class Workspace>
    requires std::same_as<typename Workspace::Tree, Tree>
  TaskRows<Scalar> operator()(const ForwardDynamics<Workspace>& fd) &
  {
    const Status status = fd.status_on(*tree_, scene);
    if (status != Status::ok) { return result(0, status, fd.subsystem()); }
    evaluate(fd);
    return checked(0);
  }

private:
  static constexpr int lanes = std::is_floating_point_v<Scalar> ? 8 : 1;  ///< rows that one step of the product treats
  static constexpr int tile = 4;                                          ///< columns that share one load of J
  using Strip = Eigen::Array<Scalar, lanes, 1>;

  Task<Scalar> on_frame(TaskKind kind, Index size, const std::string& name, const Vector3<Scalar>& point,
                        Axes axes) const
  {
    const FrameReference<Scalar>& frame = tree_->frame(name);
    if (frame.frame < 0) { detail::refuse({"frame '", name, "' is fixed to the world: it cannot have a task"}); }
    if (!detail::all_finite(point)) {
      detail::refuse({"point on frame '", name, "' must be finite, got ", detail::to_text(point)});
    }
    Task<Scalar> task{kind, name, size, frame.frame};
    task.point = frame.at.R * point + frame.at.p;
    task.R = frame.at.R;
    task.axes = axes;
    for (Index f = frame.frame; f >= 0; f = tree_->node(tree_->owner(f)).inlet) {
      tree_->visit(tree_->owner(f), [&]<class N, class S>(const N& node, const S&) {
        for (int d = S::n_i - 1; d >= 0; --d) { task.velocities.push_back(node.v + d); }
      });
    }
    return task;
  }

  Task<Scalar> of_all(TaskKind kind, Index size, const std::string& name) const
  {
    if (!(mass() > Scalar(0))) { detail::refuse({"a tree without a body has no ", name}); }
    Task<Scalar> task{kind, name, size};
    for (Index v = 0; v < tree_->n_v(); ++v) { task.velocities.push_back(v); }
    return task;
  }

  Id append(Task<Scalar>&& task)
  {
    max_rows_ += task.size;
    tasks_.push_back(std::move(task));
    placements_.emplace_back();
    const Index padded = (max_rows_ + lanes - 1) / lanes * lanes;
    J_.setZero(padded, tree_->n_v());
    JB_.setZero(padded, inputs_->max_columns());
    Jdot_qd_.setZero(max_rows_);
    Vdot0_.setZero(max_rows_);
    used_.assign(detail::at(padded / lanes), detail::Array<Index>());
    for (detail::Array<Index>& used : used_) { used.reserve(detail::at(tree_->n_v())); }
    marked_.assign(detail::at(tree_->n_v()), 0);
    arrange();
    return blocks() - 1;
  }

  /// Which columns of J are not zero in each step of the product.
  void arrange()
  {
    rows_ = 0;
    for (const Task<Scalar>& task : tasks_) { rows_ += task.active ? task.size : 0; }
    for (std::size_t step = 0; step < used_.size(); ++step) {
      used_[step].clear();
      const Index begin = static_cast<Index>(step) * lanes;
      Index row = 0;
      for (const Task<Scalar>& task : tasks_) {
        if (!task.active) { continue; }
        if (row < begin + lanes && row + task.size > begin) {
          for (const Index v : task.velocities) { marked_[detail::at(v)] = 1; }
        }
        row += task.size;
      }
      for (Index v = 0; v < tree_->n_v(); ++v) {
        if (marked_[detail::at(v)] != 0) { used_[step].push_back(v); }
        marked_[detail::at(v)] = 0;
      }
    }
  }

  template <class Workspace>
  void evaluate(const ForwardDynamics<Workspace>& fd)
  {
    J_.setZero();
    bool momentum_known = false;
    Index row = 0;
    for (std::size_t id = 0; id < tasks_.size(); ++id) {
      const Task<Scalar>& task = tasks_[id];
      if (!task.active) { continue; }
      if (task.kind == TaskKind::point || task.kind == TaskKind::frame) {
        walk(fd.workspace(), task, row, placements_[id]);
      } else {
        if (!momentum_known) { centroidal_(fd.workspace()); }
        momentum_known = true;
        write_centroidal(fd.qdd0(), task, row);
        placements_[id] = {Matrix3<Scalar>::Identity(), centroidal_.com()};
      }
      row += task.size;
    }
  }

  /// Rows of a point or frame, from the tip to the world.
  template <class Workspace>
  void walk(const Workspace& ws, const Task<Scalar>& task, Index row, Placement<Scalar>& placement)
  {
    const FrameState<Scalar>& tip = ws.frame(task.frame);
    detail::multiply(tip.R, task.R, placement.R);
    const Matrix3<Scalar>* axes = task.axes == Axes::body ? &placement.R : nullptr;
    Vector3<Scalar> x = tip.r;
    detail::add(x, detail::times(tip.R, task.point));

    Vector6<Scalar> Vdot = shift_twist(x, tip.Vdot);
    Vector6<Scalar> bias;
    bias.setZero();
    if constexpr (scene.velocity) {
      const Vector3<Scalar> inward = detail::cross(tip.omega, detail::cross(tip.omega, x));
      for (int i = 0; i < 3; ++i) {
        Vdot(i) += inward(i);
        bias(i) += inward(i);
      }
    }
    if constexpr (scene.gravity) {
      for (int i = 0; i < 3; ++i) { Vdot(i) += tree_->gravity()(i); }
    }

    for (Index frame = task.frame; frame >= 0;) {
      tree_->visit(tree_->owner(frame), [&]<class N, class S>(const N& node, const S&) {
        const NodeState<S>& state = ws.template node<S>(node);
        const auto& S_k = state.S_k[detail::at(frame - node.frame)];
        for (int d = 0; d < S::n_i; ++d) {
          write(shift_twist(x, detail::column(S_k, d)), axes, task.size, J_.data() + (node.v + d) * J_.rows() + row);
        }
        if constexpr (scene.velocity) {
          Vector6<Scalar> a = ws.frame(frame).bias;
          for (int i = 0; i < 3; ++i) { a(i) += state.c(i); }
          detail::add(bias, shift_twist(x, a));
        }
        detail::add(x, state.r);
        frame = node.inlet;
      });
    }
    write(bias, axes, task.size, Jdot_qd_.data() + row);
    write(Vdot, axes, task.size, Vdot0_.data() + row);
    placement.p = x;
  }

  /// The first `size` components of V, in `axes` if there are any.
  static void write(const Vector6<Scalar>& V, const Matrix3<Scalar>* axes, Index size, Scalar* target)
  {
    for (int i = 0; i < static_cast<int>(size); ++i) {
      const int first = i < 3 ? 0 : 3;
      if (axes == nullptr) {
        target[i] = V(i);
      } else {
        target[i] = (*axes)(0, i - first) * V(first) + (*axes)(1, i - first) * V(first + 1) +
                    (*axes)(2, i - first) * V(first + 2);
      }
    }
  }

  void write_centroidal(const VectorX<Scalar>& qdd0, const Task<Scalar>& task, Index row)
  {
    const Scalar divisor = task.kind == TaskKind::com ? centroidal_.mass() : Scalar(1);
    for (Index i = 0; i < task.size; ++i) {
      Jdot_qd_(row + i) = centroidal_.Adot_G_qd()(i) / divisor;
      Scalar sum = Jdot_qd_(row + i);
      for (Index v = 0; v < tree_->n_v(); ++v) {
        J_(row + i, v) = centroidal_.A_G()(i, v) / divisor;
        sum += J_(row + i, v) * qdd0(v);
      }
      Vdot0_(row + i) = sum;
    }
  }

  /// J_t B̂ without the zeros of J_t.
  template <class Matrix>
  void multiply(const Matrix& Bhat)
  {
    const Index m = Bhat.cols();
    Index j = 0;
    for (; j + tile <= m; j += tile) {
      multiply_tile<tile>(Bhat.data() + j * Bhat.outerStride(), Bhat.outerStride(), j);
    }
    for (; j < m; ++j) { multiply_tile<1>(Bhat.data() + j * Bhat.outerStride(), Bhat.outerStride(), j); }
  }

  template <int count>
  void multiply_tile(const Scalar* Bhat, Index stride, Index column)
  {
    for (Index row = 0; row < rows_; row += lanes) {
      std::array<Strip, count> sum;
      for (Strip& s : sum) { s.setZero(); }
      for (const Index v : used_[detail::at(row / lanes)]) {
        const Strip J = Eigen::Map<const Strip>(J_.data() + v * J_.rows() + row);
        for (int c = 0; c < count; ++c) { sum[detail::at(c)] += J * Bhat[c * stride + v]; }
      }
      for (int c = 0; c < count; ++c) {
        Eigen::Map<Strip>(JB_.data() + (column + c) * JB_.rows() + row) = sum[detail::at(c)];
      }
    }
  }

  TaskRows<Scalar> checked(Index m)
  {
    const bool finite =
        rows_ == 0 || (detail::all_finite(J_) && detail::all_finite(JB_.topLeftCorner(rows_, m)) &&
                       detail::all_finite(Jdot_qd_.head(rows_)) && detail::all_finite(Vdot0_.head(rows_)));
    return result(m, finite ? Status::ok : Status::not_finite, -1);
  }

  TaskRows<Scalar> result(Index m, Status status, Index subsystem)
  {
    if (status != Status::ok) {
      const Scalar nan = detail::not_a_number<Scalar>();
      J_.setConstant(nan);
      JB_.setConstant(nan);
      Jdot_qd_.setConstant(nan);
      Vdot0_.setConstant(nan);
      for (Placement<Scalar>& placement : placements_) {
        placement.R.setConstant(nan);
        placement.p.setConstant(nan);
      }
    }
    using Stride = Eigen::OuterStride<>;
    return {{J_.data(), rows_, J_.cols(), Stride(J_.rows())},
            {Jdot_qd_.data(), rows_},
            {JB_.data(), rows_, m, Stride(JB_.rows())},
            {Vdot0_.data(), rows_},
            status,
            status == Status::mismatch ? -1 : subsystem};
  }

  const Tree* tree_;
  const Inputs<Tree>* inputs_;
  detail::CentroidalPass<Tree, scene> centroidal_;
  detail::Array<Task<Scalar>> tasks_;
  detail::Array<Placement<Scalar>> placements_;
  Index rows_ = 0;
  Index max_rows_ = 0;
  MatrixX<Scalar> J_;   // padded rows × n_v; zero below the active rows
  MatrixX<Scalar> JB_;  // padded rows × columns
  VectorX<Scalar> Jdot_qd_, Vdot0_;
  detail::Array<detail::Array<Index>> used_;  // per `lanes` rows of J: its columns that are not zero, ascending
  detail::Array<char> marked_;                // per column; all zero between calls
};

template <class Tree>
Tasks(const Tree&, const Inputs<Tree>&) -> Tasks<Tree>;

}  // namespace iim
