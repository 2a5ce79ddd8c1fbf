// EXPECT: motors act on a subsystem's velocities
#include <iim/iim.hpp>

/// A locked joint.
struct Locked {
  using Scalar = double;
#ifdef IIM_CORRECT
  static constexpr int n_u = 0;
#else
  static constexpr int n_u = 1;
#endif
  static constexpr int n_q = 0, n_i = 0, n_frames = 1;
  static constexpr iim::MotionPattern pattern{.linear = false, .angular = false, .offset = false, .bias = false};
  using None = Eigen::Matrix<double, 0, 1>;

  iim::Body<double> body{};
  void prepare(const std::string& name) { iim::validate(body, name); }
  bool motion(const iim::Matrix3<double>& R, const None&, const None&,
              std::array<iim::FrameMotion<double, 0>, 1>& frame) const
  {
    frame[0].R = R;
    return true;
  }
  std::array<iim::CarriedBody<double>, 1> bodies() const { return {{{0, body}}}; }
  Eigen::Matrix<double, 0, n_u> Bbar(const None&) const { return {}; }
};

int main()
{
  const iim::DynamicTree tree(iim::Assembly<Locked>().add("lock", {}, Locked()));
  return tree.n_v() == 0 ? 0 : 1;
}
