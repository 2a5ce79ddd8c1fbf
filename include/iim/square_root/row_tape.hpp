// What Q of the square-root form did to the rows of a frame, kept so that columns which are not there yet can follow:
// z of unit forces on a body much heavier than what carries it (unit_rows.hpp).
#pragma once

#include <iim/numerics/array.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <cassert>
#include <cstddef>

namespace iim::detail {

/// One row [n | z | v]: six columns for (v̇, ω̇), the right-hand side, and where the frame moves by one column S, n S.
template <class Scalar>
using RootRow = Eigen::Array<Scalar, 8, 1>;
inline constexpr int rhs = 6;      ///< lane of z
inline constexpr int along_S = 7;  ///< lane of v

/// Where the rows that a subsystem leaves stand on its inlet.
struct Arrival {
  Eigen::Index from = 0, count = -1;               ///< rows of the subsystem; −1 if none reach an inlet
  Eigen::Index to = 0;                             ///< first row of the inlet
  Eigen::Index within_from = 0, within = 0;        ///< those of what lies within the subsystem
  Eigen::Index within_first = 0, within_next = 0;  ///< rows of the inlet: of the first, and of the others
  std::size_t position = 0;                        ///< steps of the inlet's tape that were before
};

/// Steps of Q in their order. Off, and without memory, until it has room; then it does not allocate.
template <class Scalar>
class RowTape {
public:
  /// For as many more reflections of so many rows, and other steps.
  void add_room(std::size_t reflections, std::size_t rows, std::size_t others)
  {
    steps_.resize(steps_.size() + reflections + others);
    numbers_.resize(numbers_.size() + reflections * (rows + 2) + others * 2);
  }

  bool is_on() const { return !steps_.empty(); }
  std::size_t size() const { return size_; }

  void clear() { size_ = n_numbers_ = 0; }

  /// The reflection of the column x(r) of the first `count` rows to (…, α, …) at row `pivot`, factor = 2/‖x − α e‖².
  /// That row goes to `out`, its place is empty.
  template <class X>
  void reflect(Eigen::Index count, Eigen::Index pivot, Eigen::Index out, X&& x, const Scalar& alpha,
               const Scalar& factor)
  {
    add({Kind::reflect, pivot, out, count, n_numbers_});
    add(alpha);
    add(factor);
    for (Eigen::Index r = 0; r < count; ++r) { add(x(r)); }
  }

  void rotate(Eigen::Index above, Eigen::Index below, const Scalar& cosine, const Scalar& sine)
  {
    add({Kind::rotate, above, below, 2, n_numbers_});
    add(cosine);
    add(sine);
  }

  /// `count` rows from one place to another; what was there before is lost, and nothing stays behind.
  void move(Eigen::Index from, Eigen::Index to, Eigen::Index count) { add({Kind::move, from, to, count, 0}); }

  /// Rows from `begin` on are no more.
  void cut(Eigen::Index begin) { add({Kind::cut, begin, 0, 0, 0}); }

  Eigen::Index tops = 0;  ///< places of the rows that the subsystem's velocities took
  Arrival arrival;
  /// Of one velocity with rotors or springs within: of M̄_R the part of the bodies beyond, in times of M̄_R, and Σ J e a
  /// over the rotors (7), per M̄_R: the moment between them and the inlet, per load on the velocity.
  Scalar of_bodies = Scalar(1);
  Eigen::Matrix<Scalar, 3, 1> of_rotors = Eigen::Matrix<Scalar, 3, 1>(Scalar(0), Scalar(0), Scalar(0));

  /// The steps from `position` on, on other columns of the same rows, `most` of them. `spare`: as many.
  void replay(std::size_t position, RootRow<Scalar>* row, Eigen::Index most, RootRow<Scalar>* spare) const
  {
    for (; position < size_; ++position) {
      const Step& step = steps_[position];
      switch (step.kind) {
        case Kind::reflect: reflect(step, row); break;
        case Kind::rotate: {
          const Scalar &cosine = numbers_[step.data], &sine = numbers_[step.data + 1];
          const RootRow<Scalar> n = row[step.first];
          row[step.first] = n * cosine + row[step.second] * sine;
          row[step.second] = row[step.second] * cosine - n * sine;
          break;
        }
        case Kind::move:
          std::copy(row + step.first, row + step.first + step.count, spare);
          for (Eigen::Index r = 0; r < step.count; ++r) { row[step.first + r].setZero(); }
          std::copy(spare, spare + step.count, row + step.second);
          break;
        case Kind::cut:
          for (Eigen::Index r = step.first; r < most; ++r) { row[r].setZero(); }
          break;
      }
    }
  }

private:
  enum class Kind : char { reflect, rotate, move, cut };
  struct Step {
    Kind kind;
    Eigen::Index first, second, count;
    std::size_t data;  ///< where its numbers begin
  };

  void add(const Step& step)
  {
    assert(size_ < steps_.size());
    steps_[size_++] = step;
  }
  void add(const Scalar& number)
  {
    assert(n_numbers_ < numbers_.size());
    numbers_[n_numbers_++] = number;
  }

  void reflect(const Step& step, RootRow<Scalar>* row) const
  {
    const RootRow<Scalar> top = row[step.first];
    const Scalar &alpha = numbers_[step.data], &factor = numbers_[step.data + 1];
    const Scalar* const x = numbers_.data() + step.data + 2;
    RootRow<Scalar> sum = RootRow<Scalar>::Zero();
    for (Eigen::Index r = 0; r < step.count; ++r) { sum += row[r] * x[r]; }
    const RootRow<Scalar> w = (sum - top * alpha) * factor;
    for (Eigen::Index r = 0; r < step.count; ++r) { row[r] -= w * x[r]; }
    row[step.first].setZero();
    row[step.second] = sum * (Scalar(1) / alpha);
  }

  Array<Step> steps_;
  Array<Scalar> numbers_;
  std::size_t size_ = 0, n_numbers_ = 0;
};

}  // namespace iim::detail
