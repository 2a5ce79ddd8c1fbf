// A motor-arm drives a joint with one velocity.
// EXPECT: drives a joint with one velocity
#include <iim/iim.hpp>

#ifdef IIM_CORRECT
iim::MotorArmOn<iim::Prismatic<double>> arm;
#else
iim::MotorArmOn<iim::Fixed<double>> arm;
#endif

int main() {}
