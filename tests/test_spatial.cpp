// Six-vector kernels against the dense matrices that they stand for.
#include <catch.hpp>
#include <iim/pass/articulated_inertia.hpp>
#include <iim/square_root/root_compress.hpp>
#include <iim/square_root/square_root.hpp>

#include <random>

using namespace iim;

namespace {

std::mt19937 random_source(7);

template <class M>
M random()
{
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  M m;
  for (Index i = 0; i < m.size(); ++i) { m(i) = static_cast<typename M::Scalar>(uniform(random_source)); }
  return m;
}

template <class Scalar>
Matrix6<Scalar> twist_transform(const Vector3<Scalar>& r)
{
  Matrix6<Scalar> X = Matrix6<Scalar>::Identity();
  X.template topRightCorner<3, 3>() = -skew(r);
  return X;
}

template <class Scalar>
SpatialInertia<Scalar> random_inertia()
{
  const Matrix6<Scalar> N = random<Matrix6<Scalar>>();
  const Matrix6<Scalar> A = N.transpose() * N;
  SpatialInertia<Scalar> inertia;
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i < 3; ++i) {
      inertia.M(i, j) = A(i, j);
      inertia.H(i, j) = A(i, j + 3);
      inertia.J(i, j) = A(i + 3, j + 3);
    }
  }
  return inertia;
}

template <class Scalar, int n>
Eigen::Matrix<Scalar, 6, n> dense(const detail::SixColumns<Scalar, n>& U)
{
  Eigen::Matrix<Scalar, 6, n> m;
  for (int d = 0; d < n; ++d) { U[d].put(&m(0, d)); }
  return m;
}

/// Wᵀ by columns.
template <class Scalar, int n>
detail::SixColumns<Scalar, n> six_columns(const Eigen::Matrix<Scalar, n, 6>& W)
{
  const Eigen::Matrix<Scalar, 6, n> Wt = W.transpose();
  detail::SixColumns<Scalar, n> columns;
  for (int d = 0; d < n; ++d) { columns[d] = detail::TriplePair<Scalar>(&Wt(0, d)); }
  return columns;
}

// A few roundings of numbers of size one to ten.
constexpr double tolerance = 64 * std::numeric_limits<double>::epsilon();

}  // namespace

// float and, with AVX2, double keep columns in registers; long double is any other Scalar.
TEMPLATE_TEST_CASE("shifts are X(r), its transpose and its congruence", "", float, double, long double)
{
  using Scalar = TestType;
  const Scalar slack = 64 * std::numeric_limits<Scalar>::epsilon();  // as above
  for (int k = 0; k < 20; ++k) {
    const auto r = random<Vector3<Scalar>>();
    const auto V = random<Vector6<Scalar>>();
    const Matrix6<Scalar> X = twist_transform(r);
    CHECK((shift_twist(r, V) - X * V).norm() < slack);
    CHECK((shift_wrench(r, V) - X.transpose() * V).norm() < slack);
    const SpatialInertia<Scalar> A = random_inertia<Scalar>();
    SpatialInertia<Scalar> sum = random_inertia<Scalar>();
    const Matrix6<Scalar> expected = sum.dense() + X.transpose() * A.dense() * X;
    sum.add_shifted(A, r);
    CHECK((sum.dense() - expected).norm() < slack);
    CHECK((A.shifted(r).dense() - X.transpose() * A.dense() * X).norm() < slack);
  }
}

template <class Scalar, int n, MotionPattern pattern>
void check_update()
{
  const Scalar slack = 64 * std::numeric_limits<Scalar>::epsilon();  // as above
  const SpatialInertia<Scalar> A = random_inertia<Scalar>();
  auto S = random<Eigen::Matrix<Scalar, 6, n>>();
  if (!pattern.linear) { S.template topRows<3>().setZero(); }
  if (!pattern.angular) { S.template bottomRows<3>().setZero(); }
  detail::SixColumns<Scalar, n> columns;
  detail::inertia_times<pattern>(A, S, columns);
  const Eigen::Matrix<Scalar, 6, n> U = dense(columns);
  CHECK((U - A.dense() * S).norm() < slack);
  const auto W = random<Eigen::Matrix<Scalar, n, 6>>();
  const Matrix6<Scalar> P = Matrix6<Scalar>::Identity() - S * W;
  CHECK((detail::projected<pattern>(A, S, columns, six_columns<Scalar, n>(W)).dense() - P.transpose() * A.dense() * P)
            .norm() < 8 * slack);
  SpatialInertia<Scalar> printed = A;
  const Eigen::Matrix<Scalar, n, 6> gain = (S.transpose() * U).inverse() * U.transpose();
  detail::subtract_product(columns, six_columns<Scalar, n>(gain), printed);
  CHECK((printed.dense() - (A.dense() - U * gain)).norm() < slack * (1 + U.norm() * gain.norm()));
  const auto z = random<Vector6<Scalar>>();
  SpatialInertia<Scalar> square = A;
  detail::add_square(Scalar(3), detail::TriplePair<Scalar>(z.data()), square);
  CHECK((square.dense() - A.dense() - 3 * z * z.transpose()).norm() < slack);
}

TEMPLATE_TEST_CASE("the projected inertia is the congruence, and what the printed update gives", "", float, double,
                   long double)
{
  for (int k = 0; k < 20; ++k) {
    check_update<TestType, 2, MotionPattern{}>();
    check_update<TestType, 1, MotionPattern{.linear = false}>();
    check_update<TestType, 1, MotionPattern{.angular = false}>();
  }
}

TEST_CASE("rows compressed to six keep NᵀN and Nᵀz, small rows beside large ones to their own size")
{
  constexpr std::size_t most = 17;
  for (int count : {3, 6, 7, 11, 17}) {
    for (double heavy : {1.0, 1e3, 1e12}) {
      detail::RootRows<double, most> rows;
      rows.open(count);
      Eigen::Matrix<long double, 7, 7> before = Eigen::Matrix<long double, 7, 7>::Zero();
      for (int r = 0; r < count; ++r) {
        const detail::RootRow<double> row = random<Eigen::Array<double, 8, 1>>() * (r % 3 == 1 ? heavy : 1.0);
        rows.put_row(r, row);
        const Eigen::Matrix<long double, 7, 1> n = row.head<7>().matrix().cast<long double>();
        before += n * n.transpose();
      }
      std::array<detail::RootRow<double>, 6> result;
      std::array<int, 6> pivot{};
      const int left = detail::compress<6>(rows, result, pivot);
      CHECK(left == std::min(count, 6));
      for (int r = 0; r < left; ++r) {
        for (int k = 0; k < r; ++k) {
          CHECK(result[static_cast<std::size_t>(r)](pivot[static_cast<std::size_t>(k)]) == 0);
        }
      }
      Eigen::Matrix<long double, 7, 7> after = Eigen::Matrix<long double, 7, 7>::Zero();
      for (int r = 0; r < left; ++r) {
        const Eigen::Matrix<long double, 7, 1> n =
            result[static_cast<std::size_t>(r)].head<7>().matrix().cast<long double>();
        after += n * n.transpose();
      }
      const auto error = (after - before).topRows<6>().norm() / before.norm();
      CHECK(static_cast<double>(error) < tolerance);
      if (count >= 11) {
        // The Schur complement of three heavy directions is light: it must not drown in them.
        const Eigen::Matrix<long double, 6, 6> exact = before.topLeftCorner<6, 6>().inverse();
        const Eigen::Matrix<long double, 6, 6> computed = after.topLeftCorner<6, 6>().inverse();
        // (The check itself, on NᵀN in long double, loses 1e6 of 1e-19; a QR that is stable only as a whole, 1e-10.)
        if (heavy == 1e3) { CHECK(static_cast<double>((computed - exact).norm() / exact.norm()) < 3e-12); }
      }
    }
  }
}

TEST_CASE("rows with v first: T, N₁, z₁ and then [N' | z' | 0], nothing drowned")
{
  for (int count : {2, 6, 7, 11, 17}) {
    for (double heavy : {1.0, 1e3, 1e12}) {
      detail::RootRows<double, 17> rows;
      rows.open(count);
      Eigen::Matrix<long double, 8, 8> before = Eigen::Matrix<long double, 8, 8>::Zero();
      for (int r = 0; r < count; ++r) {
        const detail::RootRow<double> row = random<Eigen::Array<double, 8, 1>>() * (r % 3 == 1 ? heavy : 1.0);
        rows.put_row(r, row);
        const Eigen::Matrix<long double, 8, 1> n = row.matrix().cast<long double>();
        before += n * n.transpose();
      }
      detail::Reflection<double, 8> reflection;
      REQUIRE(detail::find_reflection<true>(rows, detail::along_S, reflection));
      detail::reflect(rows, reflection, [](const auto&, Eigen::Index) {});
      const detail::RootRow<double> top = reflection.row();
      const Eigen::Matrix<long double, 8, 1> first = top.matrix().cast<long double>();
      Eigen::Matrix<long double, 8, 8> after = first * first.transpose();
      for (int r = 0; r < count; ++r) {
        CHECK(*rows.at(detail::along_S, r) == 0);
        Eigen::Matrix<long double, 8, 1> n;
        for (int c = 0; c < 8; ++c) {
          n(c) = *rows.at(c, r);
          if (r == reflection.pivot) { CHECK(n(c) == 0); }
        }
        after += n * n.transpose();
      }
      for (int i = 0; i < 8; ++i) {
        for (int j = 0; j < 8; ++j) {
          const auto size = std::sqrt(before(i, i) * before(j, j));
          CHECK(static_cast<double>(std::abs(after(i, j) - before(i, j)) / size) < tolerance);
        }
      }
    }
  }
}

TEST_CASE("principal axes: an orthogonal matrix and the moments, small ones to their own size")
{
  for (const double ratio : {1.0, 1e-4, 1e-10}) {
    for (int k = 0; k < 20; ++k) {
      const Eigen::Quaterniond turn(random<Eigen::Vector4d>().normalized());
      const Matrix3<double> R = turn.toRotationMatrix();
      const Vector3<double> expected(1.0, 1.0 + ratio / 2, ratio);
      const Matrix3<double> half = expected.cwiseSqrt().asDiagonal() * R.transpose();
      const Matrix3<double> I = half.transpose() * half;
      Vector3<double> moment;
      Matrix3<double> axes;
      detail::principal_axes(I, moment, axes);
      CHECK((axes.transpose() * axes - Matrix3<double>::Identity()).norm() < tolerance);
      CHECK((axes * moment.asDiagonal() * axes.transpose() - I).norm() < tolerance);
      CHECK(std::abs(moment.minCoeff() - ratio) < tolerance);
    }
  }
}

TEST_CASE("bodies of any size: principal axes, and two bodies on one frame")
{
  const Vector3<double> moments(1, 2, 2.5);
  const Matrix3<double> R = Eigen::Quaterniond(random<Eigen::Vector4d>().normalized()).toRotationMatrix();
  const Matrix3<double> I = R * moments.asDiagonal() * R.transpose();
  for (const double size : {1e-200, 1.0, 1e200}) {
    CAPTURE(size);
    Vector3<double> moment;
    Matrix3<double> axes;
    detail::principal_axes<double>(size * I, moment, axes);
    CHECK((axes * (moment / size).asDiagonal() * axes.transpose() - I).norm() < tolerance);
    Body<double> body;
    body.mass = size;
    FrameMass<double> two;
    for (const double side : {-1.0, 1.0}) {
      body.com.x() = side;
      two.add(body);
    }
    CHECK(two.mass == 2 * size);
    CHECK((two.central_inertia / size - 2 * Matrix3<double>(Vector3<double>(0, 1, 1).asDiagonal())).norm() < tolerance);
  }
}

TEST_CASE("a rotor across its axis has two moments, whatever the matrix rounds; a thin rod has three")
{
  FrameMass<double> body;
  body.present = true;
  body.mass = 1;
  for (int k = 0; k < 50; ++k) {
    const Vector3<double> a = random<Vector3<double>>().normalized();
    body.central_inertia = 3e-5 * (Matrix3<double>::Identity() - a * a.transpose());
    const detail::BodyRoot<double> root(body);
    CHECK(root.rows == 5);
    CHECK(root.root_moment(2) == 0);
  }
  body.central_inertia = Vector3<double>(1, 1, 1e-18).asDiagonal();
  CHECK(detail::BodyRoot<double>(body).rows == 6);
}
