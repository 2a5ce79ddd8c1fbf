// Error against run time: scenes, plain and extreme, and what every variant of the library makes of them.
#pragma once

#include "errors.hpp"
#include "pool.hpp"

#include <iim/iim.hpp>

#include <string>
#include <vector>

namespace bench {

/// A robot at a pool of states; all motors are inputs, and 3 columns for every named point.
struct AccuracyScene {
  std::string name;
  std::string group;     ///< "plain", "length", "mass ratio", "distance", "extreme"
  double parameter = 0;  ///< what a picture has on its abscissa
  iim::StandardAssembly<double> parts;
  std::vector<std::string> points{};
  std::vector<State<double>> states{};
  bool timed = false;
};

/// q̈₀ and B̂ in many digits, and how far both move if every number of the model and of q moves by one ε of double.
struct AccuracyReference {
  std::vector<Reference> values;
  double Bhat_sensitivity = 0;
  double qdd0_sensitivity = 0;
  std::string failure{};  ///< why there is no reference: a status
};

/// What one variant makes of one scene.
struct Outcome {
  std::string variant;  ///< method and update
  std::string scalar;
  double Bhat_error = 0;  ///< relative, Frobenius, worst of the states that were not refused
  double qdd0_error = 0;
  int refused = 0;      ///< states that came back with a status
  std::string status{};  ///< of the first one refused
  double time = 0;      ///< µs per state, median; 0 if not measured
};

std::vector<AccuracyScene> accuracy_scenes(bool quick);
AccuracyReference accuracy_reference(const AccuracyScene& scene);

/// All variants in one Scalar. float, double and long double are compiled apart.
template <class Scalar>
std::vector<Outcome> accuracy_outcomes(const AccuracyScene& scene, const AccuracyReference& reference);

/// The scene's inputs on a tree of any Scalar.
template <class TreeType>
iim::Inputs<TreeType> accuracy_inputs(const AccuracyScene& scene, const TreeType& tree)
{
  iim::Inputs<TreeType> inputs(tree);
  for (const std::string& point : scene.points) { inputs.add_force(point); }
  return inputs;
}

}  // namespace bench
