// Error against run time: scenes, plain and extreme, and what every variant makes of them.
#pragma once

#include "../common/errors.hpp"
#include "../common/pool.hpp"

#include <iim/iim.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

namespace bench {

/// A robot at a pool of states; all motors are inputs, and 3 columns for every named point.
struct AccuracyScene {
  std::string name;
  std::string group;     ///< "plain", "length", "mass ratio", "distance", "extreme", "robot"
  double parameter = 0;  ///< what a picture has on its abscissa
  iim::StandardAssembly<double> parts;
  std::vector<std::string> points{};
  std::vector<State<double>> states{};
  bool timed = false;
};

/// What errors at one state are measured with.
struct Yardstick {
  using MatrixXld = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
  MatrixXld M, B;
  Eigen::VectorXd row;     ///< √(M⁻¹)_ii
  Eigen::VectorXd column;  ///< √(Bᵀ M⁻¹ B)_jj
  double condition = 0;    ///< of M, in the spectral norm
  /// Relative change if every number of the model, of q and of q̇ moves by one ε of double.
  double Bhat_sensitivity = 0;
  double qdd0_sensitivity = 0;
};

/// q̈₀ and B̂ in 80 digits, per state.
struct AccuracyReference {
  std::vector<Reference> values;
  std::vector<Yardstick> yardsticks;
  std::string failure{};  ///< why there is no reference: a status

  double worst(double Yardstick::* number) const
  {
    double worst = 0;
    for (const Yardstick& y : yardsticks) { worst = std::max(worst, y.*number); }
    return worst;
  }
};

/// What one variant makes of one scene: the worst of the states that were not refused.
struct Outcome {
  std::string variant;
  std::string scalar;
  double Bhat_error = 0;     ///< relative, Frobenius norm
  double componentwise = 0;  ///< max |ΔB̂_ij| / √(M⁻¹_ii (BᵀM⁻¹B)_jj)
  double residual = 0;       ///< ‖M b̂ − b‖₁ / (‖M‖₁ ‖b̂‖₁ ε), as LAPACK's tests; the worst column b
  double qdd0_error = 0;
  double Bhat_excess = 0;  ///< error / what one ε of the scalar in the data does at that state
  double qdd0_excess = 0;
  int silent = 0;        ///< states ok but off by more than 10⁻², where one ε in the data moves it by less than 10⁻⁴
  int refused = 0;       ///< states that came back with a status
  std::string status{};  ///< of the first one refused
  double time = 0;       ///< µs per state, median; 0 if not measured
};

/// All scenes. states: so many for each; 0: as many as the report needs.
std::vector<AccuracyScene> accuracy_scenes(bool quick, int states = 0);

/// Throws std::runtime_error if the library with 80 digits and the paper's formulas as printed do not agree at the
/// first state (n_v ≤ 64).
AccuracyReference accuracy_reference(const AccuracyScene& scene);

/// All variants in one Scalar. float, double and long double are compiled apart.
template <class Scalar>
std::vector<Outcome> accuracy_outcomes(const AccuracyScene& scene, const AccuracyReference& reference);

/// One variant once through the states of a scene.
struct Pass {
  std::string variant;
  std::string scalar;
  std::size_t states;
  std::function<void()> run;
};

/// All variants in one Scalar on memory of their own.
template <class Scalar>
std::vector<Pass> accuracy_passes(const AccuracyScene& scene);

/// Worst errors of one case over many states, in ε of the scalar; against the square-root form in long double.
struct Bound {
  std::string name;
  int states = 0;
  struct Worst {
    double error = 0;        ///< in ε
    double sensitivity = 0;  ///< at that state, in ε
    int state = -1;
    int refused = 0;
  };
  struct Tier {
    Worst Bhat, qdd0;
  };
  std::array<std::array<Tier, 3>, 2> tiers{};  ///< double, float; printed, projected, square root
};

/// For every scene that has a solution, but the one arm at many places in the world only once.
std::vector<Bound> accuracy_bounds(const std::vector<AccuracyScene>& scenes);

/// The scene's inputs on a tree of any Scalar.
template <class TreeType>
iim::Inputs<TreeType> accuracy_inputs(const AccuracyScene& scene, const TreeType& tree)
{
  iim::Inputs<TreeType> inputs(tree);
  for (const std::string& point : scene.points) { inputs.add_force(point); }
  return inputs;
}

}  // namespace bench
