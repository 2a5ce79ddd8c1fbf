// PROGRAM: tests_types
// The law suite on motor-arms, whose rotors spin beside the link, and on a floating base in the middle of a tree.
#include "catch.hpp"
#include "type_laws.hpp"

using namespace iim;
using namespace iim::test;

TEST_CASE("Motor-arms obey the laws, with a rotor and with an armature")
{
  Random random(92);
  Motor<double> motor = random.motor(0);
  motor.mass = 0.6;
  motor.com = random.vector(0.3);
  motor.transverse_inertia = motor.axial_inertia * 0.8;
  obeys_the_laws("motor-arm", MotorArm<double>{{random.unit()}, random.body(), motor});
  obeys_the_laws("linear motor-arm", LinearMotorArm<double>{{random.unit()}, random.body(), motor});
  motor.armature = true;
  obeys_the_laws("motor-arm with armature", MotorArm<double>{{random.unit()}, random.body(), motor});
}

TEST_CASE("A floating base obeys the laws, also on a part that moves")
{
  Random random(93);
  LawOptions<FloatingBase<double>> options;
  options.coordinates = [](const auto& uniform) {
    Eigen::Matrix<double, 7, 1> q;
    for (double& x : q) { x = uniform(-1, 1); }
    q.tail<4>().normalize();
    return q;
  };
  obeys_the_laws("floating base", FloatingBase<double>{random.body()}, options);
}
