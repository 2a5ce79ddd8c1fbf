// Robots around a subsystem under test, for the law suite.
#pragma once

#include <iim/iim.hpp>
#include <iim/law_suite/checks.hpp>

#include <Eigen/Geometry>

#include <cstdint>
#include <random>
#include <string>
#include <type_traits>

namespace iim::detail {

/// Uniform numbers that are the same on every machine.
class LawRandom {
public:
  explicit LawRandom(std::uint64_t seed) : bits_(seed) {}
  double operator()(double low, double high)
  {
    return low + (high - low) * static_cast<double>(bits_() >> 11) * 0x1p-53;
  }
  Eigen::Vector3d vector(double size)
  {
    const double x = (*this)(-size, size), y = (*this)(-size, size), z = (*this)(-size, size);
    return {x, y, z};
  }
  Eigen::Matrix3d rotation()
  {
    const Eigen::Vector3d w = vector(2);
    return Eigen::AngleAxisd(w.norm(), w.normalized()).toRotationMatrix();
  }

private:
  std::mt19937_64 bits_;
};

/// A link that a FixedLink is a subsystem on, and no frame.
struct LawHolder : RevoluteLink<double> {
  Body<double>& fixed_body() = delete;
};

template <class S>
struct LawTrees {
  using Link = std::conditional_t<is_fixed<S>(), LawHolder, RevoluteLink<double>>;
  using Dynamic = DynamicTree<S, Link>;
  using Static = StaticTree<On<-1, Link>, On<0, S>, On<1, Link>>;
};
template <>
struct LawTrees<RevoluteLink<double>> {
  using Link = RevoluteLink<double>;
  using Dynamic = DynamicTree<Link>;
  using Static = StaticTree<On<-1, Link>, On<0, Link>, On<1, Link>>;
};

/// A tree with what computes q̈₀ and B̂ of it, for a wrench at `law_tip` of each load.
template <class Tree>
struct LawRobot {
  Tree tree;
  Inputs<Tree> inputs;
  Workspace<Tree> ws;
  ImplicitInversion<Tree> method;

  template <class Parts>
  LawRobot(const Parts& parts, int loads)
      : tree(parts), inputs(with_wrenches(tree, loads)), ws(tree), method(tree, inputs)
  {
  }
  LawRobot(const LawRobot&) = delete;

  static Inputs<Tree> with_wrenches(const Tree& tree, int loads)
  {
    Inputs<Tree> inputs(tree);
    for (int k = 0; k < loads; ++k) { inputs.add_wrench("load" + std::to_string(k), law_tip, Axes::body); }
    return inputs;
  }
};

/// The part on a base of three hinged links, the first of them light, with a hinged load on each of its frames; the
/// same robot turned by Q and moved, gravity too; and the part between one link and one load.
template <class S>
struct LawParts {
  using Parts = typename LawTrees<S>::Dynamic::Parts;
  using Link = typename LawTrees<S>::Link;
  static constexpr Index number = law_number;
  static constexpr double lightest = 5e-4;  ///< of the base's first link: loads are heavy against it (unit_rows.hpp)

  Parts robot, elsewhere, slim;

  LawParts(const S& part, LawRandom& random)
  {
    const Eigen::Matrix3d Q = random.rotation();
    const Eigen::Vector3d shift = random.vector(3);
    Body<double> box{2, Eigen::Vector3d(0.1, -0.05, 0.08), Eigen::Vector3d(0.03, 0.04, 0.05).asDiagonal(), false};
    for (int k = 0; k < number; ++k) {
      const std::string name = k + 1 == number ? "base" : "base" + std::to_string(k);
      Link link;
      link.joint.axis = random.vector(1).normalized();
      link.body = box;
      if (k == 0) {
        link.body.mass *= lightest;
        link.body.inertia *= lightest;
      }
      Attachment<double> on{k == 0 ? "world" : "base" + std::to_string(k - 1), random.rotation(), random.vector(0.3),
                            0};
      robot.add(name, on, link);
      if (k == 0) {
        on.R = Q * on.R;
        on.p = Q * on.p + shift;
      }
      elsewhere.add(name, on, link);
      if (k + 1 == number) { slim.add(name, {}, link); }
    }
    const Attachment<double> at_base{"base", random.rotation(), random.vector(0.3), 0};
    for (Parts* parts : {&robot, &elsewhere, &slim}) { parts->add("part", at_base, part); }
    box.mass = 0.5;
    for (int k = 0; k < S::n_frames; ++k) {
      const Attachment<double> on{"part", random.rotation(), random.vector(0.3), k};
      Link load;
      load.joint.axis = random.vector(1).normalized();
      load.body = box;
      const std::string name = "load" + std::to_string(k);
      robot.add(name, on, load);
      elsewhere.add(name, on, load);
      if (k == 0) { slim.add(name, on, load); }
    }
    robot.set_gravity(Eigen::Vector3d(3, -4, -8));
    elsewhere.set_gravity(Q * robot.gravity());
  }
};

}  // namespace iim::detail
