// A type is a subsystem only if it says how its frames move.
// EXPECT: static assertion failed|static_assert failed
#include <iim/iim.hpp>

struct Spring {
  using Scalar = double;
  static constexpr int n_q = 1;
  static constexpr int n_i = 1;
  static constexpr int n_u = 0;
  static constexpr int n_frames = 1;
  static constexpr iim::MotionPattern pattern{};
  void prepare(const std::string&) {}
#ifdef IIM_CORRECT
  bool motion(const iim::Matrix3<double>& R, const Eigen::Matrix<double, 1, 1>& q, const Eigen::Matrix<double, 1, 1>&,
              std::array<iim::FrameMotion<double, 1>, 1>& frames) const
  {
    frames[0].R = R;
    frames[0].r = q(0) * R.col(2);
    return true;
  }
#endif
  std::array<iim::CarriedBody<double>, 1> bodies() const { return {}; }
  Eigen::Matrix<double, 1, 0> Bbar(const Eigen::Matrix<double, 1, 1>&) const { return {}; }
};
static_assert(iim::Subsystem<Spring>);

int main() {}
