// Side by side with other libraries: the neutral description of a model, and what an adapter of a library provides.
//
// An adapter is one source file, and a program of its own (peers/worker.hpp), that uses nothing but its library's
// public interface. It builds the library's model from `Model`, brings the states into the library's own form before
// any timing, and offers one `Path` for every way that a user of the library might choose from a state to q̈₀ and B̂.
#pragma once

#include <Eigen/Dense>

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace peers {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

enum class JointKind { revolute, prismatic, floating };

/// A body and the joint by which it hangs on its parent.
struct Joint {
  std::string name;
  int parent;  ///< index of a joint before this one; −1: the world
  JointKind kind;
  Matrix3d R;        ///< joint axes in the parent body's axes
  Vector3d p;        ///< joint origin in the parent body's axes [m]
  Vector3d axis;     ///< unit vector in joint axes (revolute, prismatic)
  double mass;       ///< [kg]
  Vector3d com;      ///< centre of mass, body axes, which are the joint's after its motion [m]
  Matrix3d inertia;  ///< about the centre of mass, body axes [kg m²]
  int q;             ///< first coordinate: 1, or 7 (position, quaternion x y z w)
  int v;             ///< first velocity: 1, or 6 (v, ω) in body axes

  int n_v() const { return kind == JointKind::floating ? 6 : 1; }
};

/// Point of a body on which the environment acts with a force in world axes.
struct Contact {
  std::string name;
  int joint;
  Vector3d p;  ///< body axes [m]
};

/// A robot and its inputs: columns of B̂ are first the torques on `motors`, then three per contact.
struct Model {
  std::string name;
  std::vector<Joint> joints;  ///< depth first, as iim numbers them
  std::vector<int> motors;    ///< velocities that a motor drives, ascending
  std::vector<Contact> contacts;
  Vector3d gravity;  ///< acceleration of free fall, world axes [m/s²]
  int n_q = 0;
  int n_v = 0;

  int columns() const { return static_cast<int>(motors.size() + 3 * contacts.size()); }
  /// Whether B̂ is M⁻¹ itself.
  bool fully_actuated() const { return static_cast<int>(motors.size()) == n_v && contacts.empty(); }
  bool is_chain() const
  {
    for (std::size_t k = 0; k < joints.size(); ++k) {
      if (joints[k].parent != static_cast<int>(k) - 1) { return false; }
    }
    return true;
  }
};

/// In iim's order and convention.
struct State {
  VectorXd q;
  VectorXd qd;
};

/// In iim's order and convention.
struct Result {
  VectorXd qdd0;
  MatrixXd Bhat;
};

/// One way from a state to q̈₀ and B̂.
struct Path {
  std::string name;
  std::function<void(std::size_t state)> compute;  ///< timed; leaves q̈₀ and B̂ in memory in the library's own order
  std::function<Result()> result;                  ///< of the last `compute`; not timed
};

/// A library's model of one robot and its pool of states.
class Peer {
public:
  virtual ~Peer() = default;
  /// Ways that make sense for this model, the likely best first. They share the peer's memory.
  virtual std::vector<Path> paths() = 0;
};

struct Library {
  std::string name;
  std::string version;
  /// Null if the library has no such models; throws what the library throws if it fails on this one.
  std::function<std::unique_ptr<Peer>(const Model&, const std::vector<State>&)> make;
};

}  // namespace peers
