// EXPECT: does not meet the requirements on a Subsystem
#include <iim/iim.hpp>

struct Hinge {
  using Scalar = double;
  static constexpr int n_q = 1, n_i = 1, n_u = 1, n_frames = 1;
#ifdef IIM_CORRECT
  static constexpr iim::MotionPattern pattern{};
#endif
  void prepare(const std::string&) {}
  bool motion(const iim::Matrix3<double>&, const Eigen::Matrix<double, 1, 1>&, const Eigen::Matrix<double, 1, 1>&,
              std::array<iim::FrameMotion<double, 1>, 1>&) const
  {
    return true;
  }
  std::array<iim::CarriedBody<double>, 1> bodies() const { return {}; }
  Eigen::Matrix<double, 1, 1> Bbar(const Eigen::Matrix<double, 1, 1>&) const { return {}; }
};

int main() { return iim::Assembly<Hinge>().parts().empty() ? 0 : 1; }
