// Many states of one robot: one state per lane of a register, the text of the recursions unchanged (lanes.hpp).
//
//     iim::SeveralStates several(assembly, inputs);       // one per thread; the assembly from which inputs' tree was made
//     several.accelerations(q, qd, u, qdd, outcomes);     // q̈ of N states, a column each
//     several.evaluate(q, qd, qdd0, Bhat, outcomes);      // q̈₀ and B̂ of N states
//     several.for_each(q, qd, [&](Index state, const auto& dynamics) { … });         // while it is in the cache
//     several.for_each_pack(q, qd, [&](const auto& pack) { … });                     // and without leaving the lanes
//
// Wrong sizes of q, q̇ or u, and inputs that were added since, are a Status::mismatch of every state.
//
// The last pack is filled up with copies of the last state. A pack with a lane that has no result, or whose lanes would
// have to take different branches, is computed again state by state: statuses are those of the single-state path.
#pragma once

#include <iim/assembly.hpp>
#include <iim/errors.hpp>
#include <iim/forward_dynamics.hpp>
#include <iim/implicit_inversion.hpp>
#include <iim/inputs.hpp>
#include <iim/numerics/array.hpp>
#include <iim/numerics/lanes.hpp>
#include <iim/numerics/transpose.hpp>
#include <iim/scalar.hpp>
#include <iim/tree.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

namespace iim {

/// How the computation of one state ended.
struct Outcome {
  Status status = Status::ok;
  Index subsystem = -1;  ///< that status is about; −1: none

  bool ok() const { return status == Status::ok; }
  bool operator==(const Outcome&) const = default;
};

namespace detail {

/// The type of the same tree in another Scalar.
template <class Tree, class Scalar>
struct TreeIn;
template <class... S, class Scalar>
struct TreeIn<DynamicTree<S...>, Scalar> {
  using Type = DynamicTree<typename InScalar<S, Scalar>::Type...>;
};
template <class... Nodes, class Scalar>
struct TreeIn<StaticTree<Nodes...>, Scalar> {
  template <class N>
  using In = On<N::parent, typename InScalar<typename N::Subsystem, Scalar>::Type, N::outlet>;
  using Type = StaticTree<In<Nodes>...>;
};

/// Entry r of lane l to targets[l][r], for l < count.
template <class T, int N>
void from_lanes(const iim::Lanes<T, N>* rows, Index size, int count, T* target, Index stride)
{
  Index r = 0;
  if constexpr (N > 1) {
    std::array<T, N> beyond;
    for (; r < size && size >= N; r += N) {
      const Index begin = std::min(r, size - N);  // the last rows may be written twice
      transpose<T, N>([&](auto k) __attribute__((always_inline)) { return rows[begin + k].data(); },
                      [&](auto l) __attribute__((always_inline)) {
                        return l < count ? target + l * stride + begin : beyond.data();
                      });
    }
  }
  for (; r < size; ++r) {
    for (int l = 0; l < count; ++l) { target[l * stride + r] = rows[r][l]; }
  }
}

}  // namespace detail

/// q̈₀ and B̂, or q̈ under inputs, of many states. Construction allocates; nothing after it does. One per thread: it is
/// the workspace. Refers to `inputs` and its tree, and follows which inputs are active.
template <class Tree, Update update = Update::projected>
class SeveralStates {
  static_assert(update != Update::square_root, "the square-root form decides about pivots for each state by itself");

public:
  using Scalar = typename Tree::Scalar;
  using Pack = Lanes<Scalar>;
  static constexpr int lanes = Pack::size;

  /// Results of up to `lanes` states at once, in lanes. Refers to memory of SeveralStates; good until its next use.
  struct PackDynamics {
    Index first;                           ///< lane l holds state first + l
    int count;                             ///< lanes that hold a state
    Eigen::Map<const VectorX<Pack>> qdd0;  ///< n_v; NaN in lanes without a result
    Eigen::Map<const MatrixX<Pack>> Bhat;  ///< n_v × m; the same
    const std::array<Outcome, static_cast<std::size_t>(lanes)>& outcome;
  };

  /// The assembly from which inputs.tree() was made: ModelError where it has other parts, of other names, in other
  /// places, with other bodies or another gravity. (Axes of joints, motors and springs are not compared.)
  template <class AssemblyType>
  SeveralStates(const AssemblyType& assembly, const Inputs<Tree>& inputs)
      : inputs_(&inputs), workspace_(inputs.tree()), method_(inputs.tree(), inputs),
        lane_tree_(assembly.template cast<Pack>()),
        lane_inputs_((check_tree(longest(assembly)), inputs.on(lane_tree_))), lane_workspace_(lane_tree_),
        lane_method_(lane_tree_, lane_inputs_), q_(lane_tree_.n_q()), qd_(lane_tree_.n_v()), u_(inputs.max_columns()),
        qdd_(lane_tree_.n_v()), Bhat_(lane_tree_.n_v() * inputs.max_columns()), one_q_(lane_tree_.n_q()),
        one_qd_(lane_tree_.n_v()), one_u_(inputs.max_columns()),
        states_((whole_registers(lane_tree_.n_v()) + whole_registers(Bhat_.size())) * lanes)
  {
  }
  template <class AssemblyType>
  SeveralStates(const AssemblyType&, const Inputs<Tree>&&) = delete;
  SeveralStates(const SeveralStates&) = delete;
  SeveralStates& operator=(const SeveralStates&) = delete;

  const Tree& tree() const { return inputs_->tree(); }
  const Inputs<Tree>& inputs() const { return *inputs_; }

  /// Calls f(const PackDynamics&) for the states (q, q̇), a column each: n_q × N and n_v × N. (Without velocity in the
  /// scene q̇ is not read, here and below.)
  template <Scene scene = Scene{}, class Q, class V, class F>
  void for_each_pack(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd, F&& f)
  {
    const bool fit = fits<scene>(q, qd);
    if (fit) { follow_inputs(); }
    for (Index first = 0; first < q.cols(); first += lanes) {
      const int count = static_cast<int>(std::min<Index>(lanes, q.cols() - first));
      if (!fit) {
        outcome_.fill(Outcome{Status::mismatch, -1});
        qdd_.setConstant(detail::not_a_number<Scalar>());
        Bhat_.setConstant(detail::not_a_number<Scalar>());
        const Index m = std::min(inputs_->columns(), lane_inputs_.max_columns());
        f(PackDynamics{first, count, {qdd_.data(), qdd_.size()}, {Bhat_.data(), qdd_.size(), m}, outcome_});
        continue;
      }
      load(q.derived(), first, count, q_);
      if constexpr (scene.velocity) { load(qd.derived(), first, count, qd_); }
      LaneVote::reset();
      const AffineDynamics<Pack> result = lane_method_(forward_dynamics<scene>(q_, qd_, lane_workspace_));
      const Index m = result.Bhat.cols();
      if (result.ok() && !LaneVote::divided()) {
        outcome_.fill(Outcome{});
        f(PackDynamics{first, count, result.qdd0, {result.Bhat.data(), qdd_.size(), m}, outcome_});
        continue;
      }
      for (int l = 0; l < count; ++l) {
        one_q_ = q.col(first + l);
        if constexpr (scene.velocity) { one_qd_ = qd.col(first + l); }
        const AffineDynamics<Scalar> one = method_(forward_dynamics<scene>(one_q_, one_qd_, workspace_));
        outcome_[detail::at(l)] = {one.status, one.subsystem};
        for (Index i = 0; i < qdd_.size(); ++i) { qdd_(i).set(l, one.qdd0(i)); }
        for (Index j = 0; j < m; ++j) {
          for (Index i = 0; i < qdd_.size(); ++i) { Bhat_(j * qdd_.size() + i).set(l, one.Bhat(i, j)); }
        }
      }
      f(PackDynamics{first, count, {qdd_.data(), qdd_.size()}, {Bhat_.data(), qdd_.size(), m}, outcome_});
    }
  }

  /// Calls f(state, const AffineDynamics<Scalar>&) for each state in turn.
  template <Scene scene = Scene{}, class Q, class V, class F>
  void for_each(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd, F&& f)
  {
    const Index n = tree().n_v();
    for_each_pack<scene>(q, qd, [&](const PackDynamics& pack) {
      const Index m = pack.Bhat.cols();
      // q̈₀ and B̂ begin at a register's boundary.
      const Index Bhat = whole_registers(n), size = Bhat + whole_registers(n * m);
      detail::from_lanes(pack.qdd0.data(), n, pack.count, states_.data(), size);
      detail::from_lanes(pack.Bhat.data(), n * m, pack.count, states_.data() + Bhat, size);
      for (int l = 0; l < pack.count; ++l) {
        const Scalar* state = states_.data() + l * size;
        const Outcome& outcome = pack.outcome[detail::at(l)];
        f(pack.first + l,
          AffineDynamics<Scalar>{
              {state, n}, {state + Bhat, n, m, Eigen::OuterStride<>(n)}, outcome.status, outcome.subsystem});
      }
    });
  }

  /// A matrix of the caller's, or columns of one.
  using Results = Eigen::Ref<MatrixX<Scalar>, 0, Eigen::OuterStride<>>;

  /// qdd0: n_v × N. Bhat: (n_v·m) × N, a state's B̂ column by column in each. outcomes: N. NaN where a state has no
  /// result. Returns how many have none.
  template <Scene scene = Scene{}, class Q, class V>
  [[nodiscard]] Index evaluate(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd, Results qdd0,
                               Results Bhat, std::span<Outcome> outcomes)
  {
    const Index n = tree().n_v(), states = q.cols();
    const bool qdd0_fits = qdd0.rows() == n && qdd0.cols() == states,
               Bhat_fits = Bhat.rows() == n * inputs_->columns() && Bhat.cols() == states,
               outcomes_fit = static_cast<Index>(outcomes.size()) == states;
    assert(qdd0_fits && "qdd0 must be n_v × N");
    assert(Bhat_fits && "Bhat must be (n_v·m) × N");
    assert(outcomes_fit && "outcomes must be as many as states");
    Index failed = 0;
    if (!qdd0_fits || !Bhat_fits || !outcomes_fit || !fits<scene>(q, qd)) {
      qdd0.setConstant(detail::not_a_number<Scalar>());
      Bhat.setConstant(detail::not_a_number<Scalar>());
      return refuse(outcomes, states);
    }
    for_each_pack<scene>(q, qd, [&](const PackDynamics& pack) {
      detail::from_lanes(pack.qdd0.data(), n, pack.count, qdd0.data() + pack.first * qdd0.outerStride(),
                         qdd0.outerStride());
      detail::from_lanes(pack.Bhat.data(), Bhat.rows(), pack.count, Bhat.data() + pack.first * Bhat.outerStride(),
                         Bhat.outerStride());
      failed += note(pack.first, pack.count, outcomes);
    });
    return failed;
  }

  /// q̈ (n_v × N) of the states under the inputs u (m × N), by the O(n) pass. outcomes: N. NaN where a state has no
  /// result. Returns how many have none.
  template <Scene scene = Scene{}, class Q, class V, class U>
  [[nodiscard]] Index accelerations(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd,
                                    const Eigen::MatrixBase<U>& u, Results qdd, std::span<Outcome> outcomes)
  {
    const Index m = inputs_->columns(), n = tree().n_v(), states = q.cols();
    const bool u_fits = u.rows() == m && u.cols() == states, qdd_fits = qdd.rows() == n && qdd.cols() == states,
               outcomes_fit = static_cast<Index>(outcomes.size()) == states;
    assert(u_fits && "u must be m × N");
    assert(qdd_fits && "qdd must be n_v × N");
    assert(outcomes_fit && "outcomes must be as many as states");
    if (!u_fits || !qdd_fits || !outcomes_fit || !fits<scene>(q, qd)) {
      qdd.setConstant(detail::not_a_number<Scalar>());
      return refuse(outcomes, states);
    }
    follow_inputs();
    Index failed = 0;
    for (Index first = 0; first < q.cols(); first += lanes) {
      const int count = static_cast<int>(std::min<Index>(lanes, q.cols() - first));
      load(q.derived(), first, count, q_);
      if constexpr (scene.velocity) { load(qd.derived(), first, count, qd_); }
      load(u.derived(), first, count, u_);
      LaneVote::reset();
      const Acceleration<Pack> result = forward_dynamics<scene>(q_, qd_, lane_inputs_, u_.head(m), lane_workspace_);
      if (result.status == Status::ok && !LaneVote::divided()) {
        outcome_.fill(Outcome{});
        detail::from_lanes(result.qdd.data(), n, count, qdd.data() + first * qdd.outerStride(), qdd.outerStride());
      } else {
        for (int l = 0; l < count; ++l) {
          one_q_ = q.col(first + l);
          if constexpr (scene.velocity) { one_qd_ = qd.col(first + l); }
          one_u_.head(m) = u.col(first + l);
          const Acceleration<Scalar> one =
              forward_dynamics<scene>(one_q_, one_qd_, *inputs_, one_u_.head(m), workspace_);
          outcome_[detail::at(l)] = {one.status, one.subsystem};
          if (one.status == Status::ok) {
            qdd.col(first + l) = one.qdd;
          } else {
            qdd.col(first + l).setConstant(detail::not_a_number<Scalar>());
          }
        }
      }
      failed += note(first, count, outcomes);
    }
    return failed;
  }

private:
  using LaneTree = typename detail::TreeIn<Tree, Pack>::Type;

  static constexpr Index whole_registers(Index numbers) { return (numbers + lanes - 1) / lanes * lanes; }

  /// Of the vectors that its parts and frames are placed by.
  template <class AssemblyType>
  static Scalar longest(const AssemblyType& assembly)
  {
    Scalar length(0);
    for (const auto& part : assembly.parts()) { length = std::max(length, Scalar(part.on.p.cwiseAbs().maxCoeff())); }
    for (const auto& frame : assembly.named_frames()) {
      length = std::max(length, Scalar(frame.on.p.cwiseAbs().maxCoeff()));
    }
    return length;
  }

  /// Up to the roundings in which placements, in frames of frames, and bodies were merged. length: longest.
  [[gnu::cold]] void check_tree(const Scalar& length) const
  {
    using std::abs;
    const Scalar roundings = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon();
    if (!lane_tree_.is_shaped_as(tree())) { detail::refuse({"the assembly has other parts than the inputs' tree"}); }
    const auto differs = [](const Scalar& a, const Pack& b) { return a != b[0]; };
    for (int k = 0; k < 3; ++k) {
      if (differs(tree().gravity()(k), lane_tree_.gravity()(k))) {
        detail::refuse({"the assembly has another gravity than the inputs' tree"});
      }
    }
    for (const Node& node : tree().nodes()) {
      const auto& own = tree().placement(node.index);
      const auto& other = lane_tree_.placement(node.index);
      bool same = tree().name(node.index) == lane_tree_.name(node.index);
      for (int k = 0; k < 9; ++k) { same = same && abs(own.R.data()[k] - other.R.data()[k][0]) <= roundings; }
      for (int k = 0; k < 3; ++k) { same = same && abs(own.p(k) - other.p(k)[0]) <= roundings * length; }
      same = same && bodies_agree(tree().inlet_mass(node.index), lane_tree_.inlet_mass(node.index), length);
      for (Index f = node.frame; f < tree().end_of_frames(node.index); ++f) {
        same = same && bodies_agree(tree().frame_mass(f), lane_tree_.frame_mass(f), length);
      }
      if (!same) {
        detail::refuse(
            {"subsystem '", tree().name(node.index),
             "' has another name, place or body in the assembly than in the inputs' tree (bodies of FixedLinks are "
             "part of what carries them)"});
      }
    }
  }

  static bool bodies_agree(const FrameMass<Scalar>& a, const FrameMass<Pack>& b, const Scalar& length)
  {
    using std::abs;
    const Scalar roundings = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon();
    const auto agree = [&](const Scalar& x, const Pack& y, const Scalar& size) {
      return x == y[0] || abs(x - y[0]) <= roundings * size;
    };
    const Scalar moment = std::max(Scalar(a.first_moment.cwiseAbs().maxCoeff()), Scalar(a.mass * length));
    bool same = a.present == b.present && agree(a.mass, b.mass, abs(a.mass));
    for (int k = 0; k < 3; ++k) { same = same && agree(a.first_moment(k), b.first_moment(k), moment); }
    for (int k = 0; k < 9; ++k) {
      same = same && agree(a.inertia.data()[k], b.inertia.data()[k], a.inertia.cwiseAbs().maxCoeff());
    }
    return same;
  }

  /// Whether q and q̇ have the tree's sizes, and the inputs are those that this was made for.
  template <Scene scene, class Q, class V>
  bool fits(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd) const
  {
    const bool q_fits = q.rows() == lane_tree_.n_q(),
               qd_fits = !scene.velocity || (qd.rows() == lane_tree_.n_v() && qd.cols() == q.cols()),
               same = inputs_->id() == inputs_id_;
    assert(q_fits && "q must have n_q rows");
    assert(qd_fits && "qd must be n_v × N");
    assert(same && "inputs were added, or others assigned, after SeveralStates was made");
    return q_fits && qd_fits && same;
  }
  static Index refuse(std::span<Outcome> outcomes, Index states)
  {
    std::fill(outcomes.begin(), outcomes.end(), Outcome{Status::mismatch, -1});
    return states;
  }

  void follow_inputs()
  {
    for (Index id = 0; id < inputs_->blocks(); ++id) {
      const bool active = inputs_->block(id).active;
      if (lane_inputs_.block(id).active != active) { lane_inputs_.set_active(id, active); }
    }
  }

  /// Columns first … first + count as lanes; the last one again in the lanes that are left.
  template <class Matrix>
  static void load(const Matrix& m, Index first, int count, VectorX<Pack>& rows)
  {
    Index i = 0;
    if constexpr (requires { m.data(); } && !Matrix::IsRowMajor && lanes > 1) {
      if (m.innerStride() == 1) {  // squares of numbers, turned (2 % of the time of a biped, 3 % with clang)
        for (; i < m.rows() && m.rows() >= lanes; i += lanes) {
          const Index begin = std::min(i, m.rows() - lanes);  // the last rows may be read twice
          detail::transpose<Scalar, lanes>(
              [&](int l) __attribute__((always_inline)) {
                return m.data() + (first + std::min(l, count - 1)) * m.outerStride() + begin;
              },
              [&](auto k) __attribute__((always_inline)) { return rows(begin + k).data(); });
        }
      }
    }
    for (; i < m.rows(); ++i) {
      Scalar* row = rows(i).data();
      for (int l = 0; l < lanes; ++l) { row[l] = m.coeff(i, first + std::min(l, count - 1)); }
    }
  }

  Index note(Index first, int count, std::span<Outcome> outcomes) const
  {
    std::copy(outcome_.begin(), outcome_.begin() + count, outcomes.begin() + first);
    return std::count_if(outcome_.begin(), outcome_.begin() + count, [](const Outcome& o) { return !o.ok(); });
  }

  const Inputs<Tree>* inputs_;
  std::uint64_t inputs_id_ = inputs_->id();
  Workspace<Tree, update> workspace_;  // for states by themselves
  ImplicitInversion<Tree> method_;
  LaneTree lane_tree_;
  Inputs<LaneTree> lane_inputs_;
  Workspace<LaneTree, update> lane_workspace_;
  ImplicitInversion<LaneTree> lane_method_;
  VectorX<Pack> q_, qd_, u_;
  VectorX<Pack> qdd_, Bhat_;  // of a pack that was computed state by state
  VectorX<Scalar> one_q_, one_qd_, one_u_;
  VectorX<Scalar> states_;  // q̈₀ and B̂ of a pack, one state after the other
  std::array<Outcome, static_cast<std::size_t>(lanes)> outcome_;
};

template <class AssemblyType, class Tree>
SeveralStates(const AssemblyType&, const Inputs<Tree>&) -> SeveralStates<Tree>;

}  // namespace iim
