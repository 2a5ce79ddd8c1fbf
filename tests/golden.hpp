// The reference values of IIM_SHARED_DIR/golden: models, states, q̈₀ and B̂, computed in long double by Pinocchio 3.7.0.
#pragma once

#include <iim/iim.hpp>
#include <iim/unit_force.hpp>

#include "catch.hpp"
#include "worst.hpp"

#include <nlohmann/json.hpp>

#include <array>
#include <fstream>
#include <limits>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#ifndef IIM_SHARED_DIR
#define IIM_SHARED_DIR ""
#endif

namespace iim::test {

inline constexpr std::array<const char*, 5> golden_models{"chain5", "chain20", "panda", "anymal", "biped"};

/// 9.1e-13: what every method has to keep on these models, 1e-12. Cholesky comes nearest: cond(M)·ε.
inline constexpr double golden_bound = 4096 * std::numeric_limits<double>::epsilon();

/// 5.7e-14: what methods keep that hold the error at a few ε; so many of them since a column of B̂ may be small beside
/// the others, and its error is theirs.
inline constexpr double few = 256 * std::numeric_limits<double>::epsilon();

struct GoldenState {
  VectorX<double> q, v, qdd0;
  MatrixX<double> Bhat;
};

struct GoldenContact {
  std::string name;
  std::string subsystem;
  Vector3<double> point;
};

/// The types of subsystem that occur, and no more: they are what a test of many methods takes to compile.
using GoldenAssembly = Assembly<RevoluteLink<double>, FloatingBase<double>, PrismaticLink<double>>;

struct Golden {
  GoldenAssembly assembly;  ///< subsystems named as the file's joints
  std::vector<GoldenContact> contacts;
  std::vector<GoldenState> states;
};

namespace detail {

inline MatrixX<double> matrix(const nlohmann::json& values, Index rows, Index cols)
{
  MatrixX<double> m(rows, cols);
  for (Index i = 0; i < rows; ++i) {
    for (Index j = 0; j < cols; ++j) { m(i, j) = values.at(static_cast<std::size_t>(i * cols + j)).get<double>(); }
  }
  return m;
}

inline MatrixX<double> matrix_of_rows(const nlohmann::json& rows, Index cols)
{
  MatrixX<double> m(static_cast<Index>(rows.size()), cols);
  for (Index i = 0; i < m.rows(); ++i) { m.row(i) = matrix(rows.at(static_cast<std::size_t>(i)), 1, cols); }
  return m;
}

inline VectorX<double> vector(const nlohmann::json& values)
{
  return matrix(values, static_cast<Index>(values.size()), 1);
}

}  // namespace detail

/// Nothing, with a message, where the folder is absent.
inline std::optional<Golden> read_golden(const std::string& model_name)
{
  const std::string path = std::string(IIM_SHARED_DIR) + "/golden/" + model_name + ".json";
  std::ifstream file(path);
  if (!file) {
    WARN("skipped: there is no " << path);
    return {};
  }
  const nlohmann::json json = nlohmann::json::parse(file);
  const nlohmann::json& model = json.at("model");
  Golden golden;
  golden.assembly.set_gravity(detail::vector(model.at("gravity")));
  std::vector<std::string> names{"world"};
  for (const nlohmann::json& joint : model.at("joints")) {
    names.push_back(joint.at("name"));
    Attachment<double> on;
    on.parent = names.at(joint.at("parent").get<std::size_t>());
    on.R = detail::matrix(joint.at("R"), 3, 3);
    on.p = detail::vector(joint.at("p"));
    Body<double> body;
    body.mass = joint.at("mass");
    body.com = detail::vector(joint.at("com"));
    body.inertia = detail::matrix(joint.at("inertia_com"), 3, 3);
    const std::string type = joint.at("type");
    if (type == "free_flyer") {
      golden.assembly.add(names.back(), on, FloatingBase<double>{body});
    } else if (type == "revolute") {
      golden.assembly.add(names.back(), on, RevoluteLink<double>{{detail::vector(joint.at("axis"))}, body});
    } else {
      REQUIRE(type == "prismatic");
      golden.assembly.add(names.back(), on, PrismaticLink<double>{{detail::vector(joint.at("axis"))}, body});
    }
  }
  for (const nlohmann::json& contact : model.at("contacts")) {
    golden.contacts.push_back(
        {contact.at("name"), names.at(contact.at("joint").get<std::size_t>()), detail::vector(contact.at("p"))});
  }
  for (const nlohmann::json& state : json.at("states")) {
    golden.states.push_back({detail::vector(state.at("q")), detail::vector(state.at("v")),
                             detail::vector(state.at("qdd0")),
                             detail::matrix_of_rows(state.at("Bhat"), model.at("m").get<Index>())});
  }
  REQUIRE(golden.states.size() == 5);
  return golden;
}

/// The inputs of the file: all motors, then the contacts' forces in world axes.
template <class Tree>
Inputs<Tree> golden_inputs(const Tree& tree, const Golden& golden)
{
  Inputs<Tree> inputs(tree);
  for (const GoldenContact& contact : golden.contacts) { inputs.add_force(contact.subsystem, contact.point); }
  return inputs;
}

/// Relative errors; infinite if one is not a number.
struct GoldenError {
  double qdd0 = 0;     ///< ‖Δq̈₀‖/‖q̈₀‖
  double Bhat = 0;     ///< ‖ΔB̂‖/‖B̂‖ (Frobenius)
  double columns = 0;  ///< largest of the columns of B̂, each against its own norm

  void take(const AffineDynamics<double>& found, const GoldenState& expected)
  {
    REQUIRE(found.Bhat.rows() == expected.Bhat.rows());
    REQUIRE(found.Bhat.cols() == expected.Bhat.cols());
    keep_worst(qdd0, (found.qdd0 - expected.qdd0).norm() / expected.qdd0.norm());
    keep_worst(Bhat, (found.Bhat - expected.Bhat).norm() / expected.Bhat.norm());
    for (Index j = 0; j < expected.Bhat.cols(); ++j) {
      keep_worst(columns, (found.Bhat.col(j) - expected.Bhat.col(j)).norm() / expected.Bhat.col(j).norm());
    }
  }
};

inline std::ostream& operator<<(std::ostream& out, const GoldenError& error)
{
  return out << "relative error of q̈₀ " << error.qdd0 << ", of B̂ " << error.Bhat << ", of its columns "
             << error.columns;
}

/// The largest errors of a method over the states.
template <Update update, class Method, class Tree>
GoldenError golden_error(Method& method, const Tree& tree, const Golden& golden)
{
  Workspace<Tree, update> ws(tree);
  GoldenError error;
  for (const GoldenState& state : golden.states) {
    const auto fd = forward_dynamics(state.q, state.v, ws);
    const auto result = affine_dynamics(method, fd, state.q, state.v);
    REQUIRE(result.ok());
    error.take(result, state);
  }
  return error;
}

}  // namespace iim::test
