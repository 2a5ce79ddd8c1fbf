// PROGRAM: iim_peers_simbody
// REQUIRES: simbody
// Simbody. Its free mobilizer has the quaternion's scalar first and the velocities (ω, v) in the parent's axes.
#include "peers.hpp"
#include "worker.hpp"

// Debian and Ubuntu build Simbody with assertions, and its State is laid out by that.
#undef NDEBUG

// Simbody 3.7 compares its index types by conversion to an integer, of which C++20, trying both orders of the operands,
// finds too many. This one is closer than any of them.
namespace SimTK {
template <class Index>
  requires requires {
    Index::Invalid();
    Index().isValid();
  }
bool operator==(const Index& a, const Index& b)
{
  return static_cast<int>(a) == static_cast<int>(b);
}
}  // namespace SimTK

// Its vectors of incomplete types are no C++20 either; left out by its own include guard.
#define SimTK_SIMMATH_MULTIBODY_GRAPH_MAKER_H_

#include <simbody/internal/Force_Gravity.h>
#include <simbody/internal/GeneralForceSubsystem.h>
#include <simbody/internal/MobilizedBody_Free.h>
#include <simbody/internal/MobilizedBody_Ground.h>
#include <simbody/internal/MobilizedBody_Pin.h>
#include <simbody/internal/MobilizedBody_Slider.h>
#include <simbody/internal/MultibodySystem.h>
#include <simbody/internal/SimbodyMatterSubsystem.h>

namespace peers {
namespace {

namespace st = SimTK;

st::Vec3 vec3(const Vector3d& x) { return {x(0), x(1), x(2)}; }

st::Mat33 mat33(const Matrix3d& A)
{
  return {A(0, 0), A(0, 1), A(0, 2), A(1, 0), A(1, 1), A(1, 2), A(2, 0), A(2, 1), A(2, 2)};
}

st::Rotation rotation(const Matrix3d& R) { return st::Rotation(mat33(R), true); }

/// A rotation that takes unit vector e_k to `axis`.
st::Rotation rotation_to(const Vector3d& axis, int k)
{
  return rotation(Eigen::Quaterniond::FromTwoVectors(Vector3d::Unit(k), axis).toRotationMatrix());
}

class SimbodyPeer : public Peer {
public:
  SimbodyPeer(const Model& model, const std::vector<State>& states)
      : from_(model), matter_(system_), forces_(system_), gravity_(forces_, matter_, vec3(model.gravity)),
        states_(states)
  {
    for (const Joint& joint : model.joints) {
      const st::Inertia central(st::SymMat33(st::Mat33(mat33(joint.inertia))));
      const st::Vec3 com = vec3(joint.com);
      const st::Body::Rigid body(st::MassProperties(joint.mass, com, central.shiftFromMassCenter(com, joint.mass)));
      st::MobilizedBody& parent = joint.parent < 0 ? static_cast<st::MobilizedBody&>(matter_.updGround())
                                                   : bodies_[static_cast<std::size_t>(joint.parent)];
      const st::Rotation R = rotation(joint.R);
      if (joint.kind == JointKind::floating) {
        bodies_.push_back(st::MobilizedBody::Free(parent, st::Transform(R, vec3(joint.p)), body, st::Transform()));
      } else if (joint.kind == JointKind::revolute) {  // about the z axis of its frames
        const st::Rotation turn = rotation_to(joint.axis, 2);
        bodies_.push_back(
            st::MobilizedBody::Pin(parent, st::Transform(R * turn, vec3(joint.p)), body, st::Transform(turn)));
      } else {  // along the x axis of its frames
        const st::Rotation turn = rotation_to(joint.axis, 0);
        bodies_.push_back(
            st::MobilizedBody::Slider(parent, st::Transform(R * turn, vec3(joint.p)), body, st::Transform(turn)));
      }
    }
    state_ = system_.realizeTopology();
    matter_.setUseEulerAngles(state_, false);
    system_.realizeModel(state_);

    // Simbody may number the coordinates as it likes.
    order_.resize(static_cast<std::size_t>(model.n_v));
    for (std::size_t k = 0; k < bodies_.size(); ++k) {
      const int first = bodies_[k].getFirstUIndex(state_);
      const Joint& joint = model.joints[k];
      for (int d = 0; d < joint.n_v(); ++d) {
        order_[static_cast<std::size_t>(joint.v + d)] = first + (joint.kind == JointKind::floating ? (d + 3) % 6 : d);
      }
    }
    for (const State& x : states) {
      q_.emplace_back(state_.getNQ(), 0.0);
      u_.emplace_back(state_.getNU(), 0.0);
      for (std::size_t k = 0; k < bodies_.size(); ++k) {
        const Joint& joint = model.joints[k];
        const int first = bodies_[k].getFirstQIndex(state_);
        if (joint.kind == JointKind::floating) {
          const Matrix3d E = turn_of(x, joint);
          const int from[7] = {6, 3, 4, 5, 0, 1, 2};
          for (int d = 0; d < 7; ++d) { q_.back()[first + d] = x.q(joint.q + from[d]); }
          const Vector3d v = E * x.qd.segment<3>(joint.v);
          const Vector3d omega = E * x.qd.segment<3>(joint.v + 3);
          for (int d = 0; d < 3; ++d) {
            u_.back()[order_[static_cast<std::size_t>(joint.v + d)]] = v(d);
            u_.back()[order_[static_cast<std::size_t>(joint.v + 3 + d)]] = omega(d);
          }
        } else {
          q_.back()[first] = x.q(joint.q);
          u_.back()[order_[static_cast<std::size_t>(joint.v)]] = x.qd(joint.v);
        }
      }
    }
    columns_.assign(static_cast<std::size_t>(model.columns()), st::Vector(model.n_v, 0.0));
    force_.resize(model.n_v);
  }

  std::vector<Path> paths() override
  {
    return {
        {"realize acceleration, multiplyByMInv", [this](std::size_t k) { compute(k); }, [this] { return result(); }}};
  }

private:
  static Matrix3d turn_of(const State& x, const Joint& joint)
  {
    return Eigen::Quaterniond(x.q(joint.q + 6), x.q(joint.q + 3), x.q(joint.q + 4), x.q(joint.q + 5))
        .normalized()
        .toRotationMatrix();
  }

  void compute(std::size_t k)
  {
    state_.updQ() = q_[k];
    state_.updU() = u_[k];
    last_ = k;
    system_.realize(state_, st::Stage::Acceleration);
    std::size_t column = 0;
    force_ = 0.0;
    for (const int v : from_.motors) {
      st::Real& torque = force_[order_[static_cast<std::size_t>(v)]];
      torque = 1;
      matter_.multiplyByMInv(state_, force_, columns_[column++]);
      torque = 0;
    }
    for (const Contact& contact : from_.contacts) {
      const st::MobilizedBodyIndex body = bodies_[static_cast<std::size_t>(contact.joint)].getMobilizedBodyIndex();
      for (int axis = 0; axis < 3; ++axis) {
        st::Vec3 direction(0);
        direction[axis] = 1;
        matter_.multiplyByStationJacobianTranspose(state_, body, vec3(contact.p), direction, force_);
        matter_.multiplyByMInv(state_, force_, columns_[column++]);
      }
    }
  }

  Result result() const
  {
    const Index m = from_.columns();
    Result result{VectorXd(from_.n_v), MatrixXd(from_.n_v, m)};
    const st::Vector& udot = state_.getUDot();
    for (int v = 0; v < from_.n_v; ++v) {
      const int own = order_[static_cast<std::size_t>(v)];
      result.qdd0(v) = udot[own];
      for (Index c = 0; c < m; ++c) { result.Bhat(v, c) = columns_[static_cast<std::size_t>(c)][own]; }
    }
    const State& x = states_[last_];
    for (const Joint& joint : from_.joints) {
      if (joint.kind != JointKind::floating) { continue; }
      // In parent axes: (ω)˙ = R ω̇, (R v)˙ = R (v̇ + ω × v)
      const Matrix3d Et = turn_of(x, joint).transpose();
      const Vector3d v = x.qd.segment<3>(joint.v);
      const Vector3d omega = x.qd.segment<3>(joint.v + 3);
      for (const int part : {0, 3}) {
        result.qdd0.segment<3>(joint.v + part) = (Et * result.qdd0.segment<3>(joint.v + part)).eval();
        result.Bhat.middleRows<3>(joint.v + part) = (Et * result.Bhat.middleRows<3>(joint.v + part)).eval();
      }
      result.qdd0.segment<3>(joint.v) -= omega.cross(v);
    }
    return result;
  }

  Model from_;
  st::MultibodySystem system_;
  st::SimbodyMatterSubsystem matter_;
  st::GeneralForceSubsystem forces_;
  st::Force::Gravity gravity_;
  std::vector<st::MobilizedBody> bodies_;
  st::State state_;
  std::vector<State> states_;
  std::vector<st::Vector> q_, u_;  // the same in Simbody's form
  std::vector<int> order_;         // index in Simbody of each velocity
  st::Vector force_;
  std::vector<st::Vector> columns_;
  std::size_t last_ = 0;
};

std::string version()
{
  int major = 0, minor = 0, build = 0;
  SimTK_version_simbody(&major, &minor, &build);
  return std::to_string(major) + '.' + std::to_string(minor) + '.' + std::to_string(build);
}

}  // namespace
}  // namespace peers

int main(int argc, char** argv)
{
  using namespace peers;
  return serve({"Simbody", version(),
                [](const Model& model, const std::vector<State>& states) -> std::unique_ptr<Peer> {
                  return std::make_unique<SimbodyPeer>(model, states);
                }},
               argc, argv);
}
