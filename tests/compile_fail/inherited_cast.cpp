// A subsystem that inherits cast<T>() would lose in another Scalar what it adds to its base.
// EXPECT: it needs one of its own, not that of its base
#include <iim/iim.hpp>

template <class Scalar_>
struct Springy : iim::RevoluteLink<Scalar_> {
  Eigen::Matrix<Scalar_, 1, 1> internal_force(const Eigen::Matrix<Scalar_, 1, 1>& q,
                                              const Eigen::Matrix<Scalar_, 1, 1>&) const
  {
    return Scalar_(-5) * q;
  }
#ifdef IIM_CORRECT
  template <class T>
  Springy<T> cast() const
  {
    return {iim::RevoluteLink<Scalar_>::template cast<T>()};
  }
#endif
};

int main()
{
  iim::Assembly<Springy<double>> assembly;
  assembly.add("link", {}, Springy<double>{});
  static_cast<void>(assembly.cast<float>());
}
