// The square-root form of the O(n) pass: the articulated inertia as N with A = NᵀN, never A itself.
//
// By Gauss's principle the accelerations a_b of all bodies minimise Σ_b ‖N_b a_b − z_b‖² (less the work of applied
// forces), where N_bᵀN_b is the inertia of body b and z_b = N_b × (its acceleration if it were free). With the rows
// [N | z] of all that a subsystem's frames carry, a_k = y + bias_k + S_k q̈ and v = N S, one orthogonal Q gives
//
//     Q [ v  N  z − N bias ] = [ T  N₁  z₁ ]        D = M̄_R = TᵀT,   W = T⁻¹N₁,   q̈ = T⁻¹z₁ − W y      (17), (18)
//                              [ 0  N'  z' ]        A' = A − U W = N'ᵀN'                               (14), (16)
//
// so that the rows below are what the parent sees; the rows [N' X(r) | z' − N' c] are stacked on the parent's own and
// reduced to six by one more Q. Nothing is subtracted from anything of its own size: the error of A' is relative to each
// row, whatever the other rows weigh, if rows and columns are pivoted (Powell and Reid 1969; Cox and Higham 1998,
// "Stability of Householder QR factorization for weighted least squares problems").
// Applied forces have no square root; they stay a wrench p beside N, p' = p − Wᵀ (Sᵀp − τ).
#pragma once

#include <iim/body.hpp>
#include <iim/spatial.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace iim::detail {

/// One row [n | z | 0]: six columns for (v̇, ω̇), the right-hand side, and a lane to fill the register.
template <class Scalar>
using RootRow = Eigen::Array<Scalar, 8, 1>;
inline constexpr int rhs = 6;  ///< lane of z

/// N and z of what one frame carries.
template <class Scalar>
struct RootInertia {
  std::array<RootRow<Scalar>, 6> row;
  int rows = 0;
};

/// Eigenvalues and eigenvectors of a symmetric matrix by Jacobi's rotations: small eigenvalues keep their own digits,
/// and any Scalar with a square root will do.
template <class Scalar>
void principal_axes(Matrix3<Scalar> I, Vector3<Scalar>& moment, Matrix3<Scalar>& axes)
{
  using std::abs;
  using std::sqrt;
  const Scalar epsilon = Eigen::NumTraits<Scalar>::epsilon();
  axes.setIdentity();
  for (int sweep = 0; sweep < 32; ++sweep) {
    bool diagonal = true;
    for (int p = 0; p < 2; ++p) {
      for (int q = p + 1; q < 3; ++q) {
        if (!(abs(I(p, q)) > epsilon * sqrt(abs(I(p, p)) * abs(I(q, q))))) { continue; }
        diagonal = false;
        // t = tan of the angle that makes I(p, q) zero, the smaller of the two
        const Scalar theta = (I(q, q) - I(p, p)) / (Scalar(2) * I(p, q));
        const Scalar root = sqrt(theta * theta + Scalar(1));
        const Scalar t = theta > Scalar(0) ? Scalar(1) / (theta + root) : Scalar(1) / (theta - root);
        const Scalar c = Scalar(1) / sqrt(t * t + Scalar(1));
        const Scalar s = t * c;
        Matrix3<Scalar> J = Matrix3<Scalar>::Identity();
        J(p, p) = c, J(q, q) = c, J(p, q) = s, J(q, p) = -s;
        I = Matrix3<Scalar>(J.transpose() * I * J);
        axes = Matrix3<Scalar>(axes * J);
      }
    }
    if (diagonal) { break; }
  }
  moment = I.diagonal();
}

/// The rigid body that one frame carries, by its principal axes: constants of N_b and z_b.
template <class Scalar>
struct BodyRoot {
  Scalar root_mass = Scalar(0);                       ///< √m
  Vector3<Scalar> com = Vector3<Scalar>::Zero();      ///< in the frame
  Matrix3<Scalar> axes = Matrix3<Scalar>::Identity(); ///< principal axes, right-handed, in the frame
  Vector3<Scalar> root_moment = Vector3<Scalar>::Zero();  ///< √θ, zeros last
  Vector3<Scalar> gyration = Vector3<Scalar>::Zero();     ///< (θ_j − θ_i) / √θ_k, k, i, j cyclic
  int rows = 0;

  BodyRoot() = default;
  explicit BodyRoot(const FrameMass<Scalar>& body)
  {
    using std::sqrt;
    if (!body.present) { return; }
    root_mass = sqrt(body.mass);
    com = body.com;
    Vector3<Scalar> moment = body.central_inertia.diagonal();
    const Matrix3<Scalar> diagonal = moment.asDiagonal();
    if (body.central_inertia != diagonal) {
      principal_axes(body.central_inertia, moment, axes);
    }
    for (int pass = 0; pass < 2; ++pass) {  // largest first
      for (int k = 0; k < 2; ++k) {
        if (moment(k) < moment(k + 1)) {
          std::swap(moment(k), moment(k + 1));
          axes.col(k).swap(axes.col(k + 1));
        }
      }
    }
    axes.col(2) = axes.col(0).cross(axes.col(1));
    rows = 3;
    for (int k = 0; k < 3; ++k) {
      if (moment(k) > Scalar(0)) {
        root_moment(k) = sqrt(moment(k));
        gyration(k) = (moment((k + 2) % 3) - moment((k + 1) % 3)) / root_moment(k);
        ++rows;
      }
    }
  }
};

/// N_b and z_b in world axes at the coupling point: √m (1, −s̃) with s the centre of mass, √θ_k (0, p_kᵀ).
template <bool velocity, class Scalar>
[[gnu::always_inline]] inline void place_roots(const BodyRoot<Scalar>& body, const Matrix3<Scalar>& R,
                                               const Vector3<Scalar>& r, const Vector3<Scalar>& omega,
                                               RootInertia<Scalar>& N)
{
  N.rows = body.rows;
  if (body.rows == 0) { return; }
  const Scalar& m = body.root_mass;
  const Scalar zero(0);
  Vector3<Scalar> s = times(R, body.com);
  add(s, r);
  Vector3<Scalar> centripetal(zero, zero, zero);
  if constexpr (velocity) { centripetal = cross(omega, cross(omega, s)); }
  N.row[0] << m, zero, zero, zero, m * s(2), -m * s(1), -m * centripetal(0), zero;
  N.row[1] << zero, m, zero, -m * s(2), zero, m * s(0), -m * centripetal(1), zero;
  N.row[2] << zero, zero, m, m * s(1), -m * s(0), zero, -m * centripetal(2), zero;
  Matrix3<Scalar> p;
  multiply(R, body.axes, p);
  Vector3<Scalar> spin(zero, zero, zero);  // ω in principal axes
  if constexpr (velocity) {
    for (int k = 0; k < 3; ++k) { spin(k) = p(0, k) * omega(0) + p(1, k) * omega(1) + p(2, k) * omega(2); }
  }
  for (int k = 0; k + 3 < body.rows; ++k) {
    const Scalar& t = body.root_moment(k);
    N.row[static_cast<std::size_t>(k + 3)] << zero, zero, zero, t * p(0, k), t * p(1, k), t * p(2, k),
        -body.gyration(k) * spin((k + 1) % 3) * spin((k + 2) % 3), zero;
  }
}

/// The same rows seen from the inlet's reference point: N X(r), z − N c. c is what velocities add at the outer point.
template <bool velocity, class Scalar>
[[gnu::always_inline]] inline void shift_row(RootRow<Scalar>& n, const Vector3<Scalar>& r, const Vector3<Scalar>& c)
{
  if constexpr (velocity) { n(rhs) -= n(0) * c(0) + n(1) * c(1) + n(2) * c(2); }
  n(3) += r(1) * n(2) - r(2) * n(1);
  n(4) += r(2) * n(0) - r(0) * n(2);
  n(5) += r(0) * n(1) - r(1) * n(0);
}

/// z − N a for an acceleration a that is already known.
template <class Scalar>
[[gnu::always_inline]] inline void subtract_known(RootRow<Scalar>& n, const Vector6<Scalar>& a)
{
  n(rhs) -= (n(0) * a(0) + n(1) * a(1) + n(2) * a(2)) + (n(3) * a(3) + n(4) * a(4) + n(5) * a(5));
}

/// Householder's reflection that takes x, ‖x‖² = square > 0, to (α, 0, …); its largest entry should stand first.
/// Turns x[0] into the first entry of the reflection's vector; the others stay. Returns α and 2/‖vector‖².
template <class Scalar>
[[gnu::always_inline]] inline std::pair<Scalar, Scalar> reflector(Scalar* x, const Scalar& square)
{
  using std::sqrt;
  const Scalar norm = sqrt(square);
  const Scalar alpha = x[0] > Scalar(0) ? Scalar(-norm) : norm;
  x[0] -= alpha;
  return {alpha, Scalar(-1) / (alpha * x[0])};
}

/// Place of the largest entry.
template <class Scalar>
[[gnu::always_inline]] inline int largest(const Scalar* x, int count)
{
  using std::abs;
  int at = 0;
  Scalar size = abs(x[0]);
  for (int r = 1; r < count; ++r) {
    const Scalar other = abs(x[r]);
    at = other > size ? r : at;
    size = other > size ? other : size;
  }
  return at;
}

/// Σ_r rows[r] f(r) in two chains: one would wait for every sum.
template <class Scalar, class Factor>
[[gnu::always_inline]] inline RootRow<Scalar> weighted_sum(const RootRow<Scalar>* rows, int count, Factor&& factor)
{
  RootRow<Scalar> even = rows[0] * factor(0);
  if (count == 1) { return even; }
  RootRow<Scalar> odd = rows[1] * factor(1);
  int r = 2;
  for (; r + 1 < count; r += 2) {
    even += rows[r] * factor(r);
    odd += rows[r + 1] * factor(r + 1);
  }
  if (r < count) { even += rows[r] * factor(r); }
  return even + odd;
}

/// rows −= (factor Σ x rows) xᵀ.
template <class Scalar>
[[gnu::always_inline]] inline void reflect(RootRow<Scalar>* rows, const Scalar* x, int count, const Scalar& factor)
{
  const RootRow<Scalar> w = weighted_sum(rows, count, [&](int r) -> const Scalar& { return x[r]; }) * factor;
  for (int r = 0; r < count; ++r) { rows[r] -= w * x[r]; }
}

/// The largest of the first six lanes: its place and itself, by knock-out.
template <class Scalar>
[[gnu::always_inline]] inline std::pair<int, Scalar> largest_of_six(const RootRow<Scalar>& x)
{
  const int a = x(1) > x(0) ? 1 : 0;
  const int b = x(3) > x(2) ? 3 : 2;
  const int c = x(5) > x(4) ? 5 : 4;
  const Scalar xa = x(1) > x(0) ? x(1) : x(0);
  const Scalar xb = x(3) > x(2) ? x(3) : x(2);
  const Scalar xc = x(5) > x(4) ? x(5) : x(4);
  const int d = xb > xa ? b : a;
  const Scalar xd = xb > xa ? xb : xa;
  return {xc > xd ? c : d, xc > xd ? xc : xd};
}

/// Replaces `count` rows by at most six with the same NᵀN and Nᵀz: QR with pivoted columns, rows sorted by their
/// largest entry. Returns how many.
template <int most, class Scalar>
int compress(const std::array<RootRow<Scalar>, most>& stack, int count, std::array<RootRow<Scalar>, 6>& result)
{
  count = std::min(count, most);
  if (count <= 6) {
    std::copy(stack.begin(), stack.begin() + count, result.begin());
    return count;
  }
  std::array<Scalar, most> size;
  std::array<int, most> order;
  for (int r = 0; r < count; ++r) {
    const Scalar own = stack[static_cast<std::size_t>(r)].template head<6>().abs().maxCoeff();
    int at = r;
    for (; at > 0 && size[static_cast<std::size_t>(at - 1)] < own; --at) {
      size[static_cast<std::size_t>(at)] = size[static_cast<std::size_t>(at - 1)];
      order[static_cast<std::size_t>(at)] = order[static_cast<std::size_t>(at - 1)];
    }
    size[static_cast<std::size_t>(at)] = own;
    order[static_cast<std::size_t>(at)] = r;
  }
  std::array<RootRow<Scalar>, most> sorted;
  for (int r = 0; r < count; ++r) {
    sorted[static_cast<std::size_t>(r)] = stack[static_cast<std::size_t>(order[static_cast<std::size_t>(r)])];
  }
  RootRow<Scalar> open = RootRow<Scalar>::Ones();  // zero: a column that is done
  std::array<Scalar, most> x;
  for (int k = 0; k < 6; ++k) {
    RootRow<Scalar>* rows = sorted.data() + k;
    const int active = count - k;
    const RootRow<Scalar> square =
        weighted_sum(rows, active, [&](int r) -> const RootRow<Scalar>& { return rows[r]; }) * open;
    const auto [column, best] = largest_of_six(square);
    if (!(best > Scalar(0))) { return k; }  // what is left is zero
    open(column) = Scalar(0);
    for (int r = 0; r < active; ++r) { x[static_cast<std::size_t>(r)] = rows[r](column); }
    const auto [alpha, factor] = reflector(x.data(), best);
    reflect(rows, x.data(), active, factor);
    result[static_cast<std::size_t>(k)] = rows[0];
    result[static_cast<std::size_t>(k)](column) = alpha;
    for (int r = 1; r < active; ++r) { rows[r](column) = Scalar(0); }
  }
  return 6;
}

/// Q of the file's head: takes the columns v (n per row) of `count` rows to T in the first n rows, and [N | z] along.
/// `scale`: what the entries of v would be without cancellation. False if T is singular up to roundings.
template <int n, class Scalar, int most>
[[gnu::always_inline]] inline bool eliminate(std::array<Eigen::Matrix<Scalar, n, 1>, most>& v,
                                             std::array<RootRow<Scalar>, most>& rows, int count,
                                             const Eigen::Matrix<Scalar, n, 1>& scale, Eigen::Matrix<Scalar, n, n>& C)
{
  using std::abs;
  count = std::min(count, most);
  if (count < n) { return false; }
  std::array<int, n> order;
  std::array<bool, n> done{};
  std::array<Scalar, most> x;
  bool regular = true;
  for (int k = 0; k < n; ++k) {
    const std::size_t top = static_cast<std::size_t>(k);
    const int active = count - k;
    int column = 0;
    Scalar best(-1);
    for (int c = 0; c < n; ++c) {
      Scalar square(0);
      for (int r = k; r < count; ++r) { square += v[static_cast<std::size_t>(r)](c) * v[static_cast<std::size_t>(r)](c); }
      const bool better = !done[static_cast<std::size_t>(c)] && square > best;
      column = better ? c : column;
      best = better ? square : best;
    }
    done[static_cast<std::size_t>(column)] = true;
    order[top] = column;
    for (int r = 0; r < active; ++r) { x[static_cast<std::size_t>(r)] = v[top + static_cast<std::size_t>(r)](column); }
    const std::size_t pivot = static_cast<std::size_t>(largest(x.data(), active));
    std::swap(x[0], x[pivot]);
    std::swap(rows[top], rows[top + pivot]);
    std::swap(v[top], v[top + pivot]);
    if (!(best > Scalar(0))) {
      regular = false;
      best = Scalar(1);
    }
    const auto [alpha, factor] = reflector(x.data(), best);
    // Below this v is made of roundings: the coordinate moves nothing.
    const Scalar negligible = Scalar(16) * Eigen::NumTraits<Scalar>::epsilon() * scale(column);
    regular &= ScalarTraits<Scalar>::is_positive(abs(alpha) - negligible);
    reflect(rows.data() + k, x.data(), active, factor);
    for (int c = 0; c < n; ++c) {
      if (done[static_cast<std::size_t>(c)]) { continue; }
      Scalar dot(0);
      for (int r = 0; r < active; ++r) { dot += v[top + static_cast<std::size_t>(r)](c) * x[static_cast<std::size_t>(r)]; }
      dot *= factor;
      for (int r = 0; r < active; ++r) { v[top + static_cast<std::size_t>(r)](c) -= dot * x[static_cast<std::size_t>(r)]; }
    }
    v[top](column) = alpha;
    for (int r = 1; r < active; ++r) { v[top + static_cast<std::size_t>(r)](column) = Scalar(0); }
  }
  // C = T⁻¹, T upper triangular in the order of elimination: row order[k] of C by substitution from the last.
  for (int k = n - 1; k >= 0; --k) {
    const int row = order[static_cast<std::size_t>(k)];
    const Eigen::Matrix<Scalar, n, 1>& t = v[static_cast<std::size_t>(k)];
    const Scalar inverse = Scalar(1) / t(row);
    for (int c = 0; c < n; ++c) {
      Scalar sum = c == k ? Scalar(1) : Scalar(0);
      for (int l = k + 1; l < n; ++l) { sum -= t(order[static_cast<std::size_t>(l)]) * C(order[static_cast<std::size_t>(l)], c); }
      C(row, c) = sum * inverse;
    }
  }
  return regular;
}

}  // namespace iim::detail
