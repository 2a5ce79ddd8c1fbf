// What Q of the square-root form did to the rows of a frame, kept so that columns which are not there yet can follow:
// z of unit forces on a body much heavier than what carries it (unit_rows.hpp).
#pragma once

#include <Eigen/Core>

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <vector>

namespace iim::detail {

/// One row [n | z | v]: six columns for (v̇, ω̇), the right-hand side, and where the frame moves by one column S, n S.
template <class Scalar>
using RootRow = Eigen::Array<Scalar, 8, 1>;
inline constexpr int rhs = 6;      ///< lane of z
inline constexpr int along_S = 7;  ///< lane of v

/// Where the rows that a subsystem leaves stand on its inlet.
struct Arrival {
  int from = 0, count = -1;  ///< rows of the subsystem; −1 if none reach an inlet
  int to = 0;                ///< first row of the inlet
  std::size_t position = 0;  ///< steps of the inlet's tape that were before
};

/// Steps of Q in their order. Off, and without memory, until it has room; then it does not allocate.
template <class Scalar>
class RowTape {
public:
  /// For as many more reflections of so many rows, and other steps.
  void add_room(std::size_t reflections, std::size_t rows, std::size_t others)
  {
    steps_.resize(steps_.size() + reflections + others);
    numbers_.resize(numbers_.size() + (reflections + 1) * (rows + 2));
    places_.resize(places_.size() + others * rows);
  }

  bool is_on() const { return !steps_.empty(); }
  std::size_t size() const { return size_; }

  void clear()
  {
    size_ = n_numbers_ = n_places_ = 0;
    rows_at(0, 1);
  }

  /// Rows of the steps that follow: the first of them, and the second; others come after this.
  void rows_at(int first, int second)
  {
    first_ = first;
    second_ = second;
  }

  /// Of rows begin … begin + count, two exchanged, the first and `other`; then the reflection of the column x(r) to (α, 0, …),
  /// factor = 2/‖x − α e₁‖².
  template <class X>
  void reflect(int begin, int count, int other, X&& x, const Scalar& alpha, const Scalar& factor)
  {
    add({Kind::reflect, first_ + begin, second_ + begin, count, other, n_numbers_});
    add(alpha);
    add(factor);
    for (int r = 0; r < count; ++r) { add(x(r)); }
  }

  void rotate(int above, int below, const Scalar& cosine, const Scalar& sine)
  {
    add({Kind::rotate, above, below, 2, 0, n_numbers_});
    add(cosine);
    add(sine);
  }

  /// Row r of `count` to place[r].
  template <class Place>
  void sort(const Place* place, int count)
  {
    add({Kind::sort, first_, second_, count, 0, n_places_});
    for (int r = 0; r < count; ++r) {
      assert(n_places_ < places_.size());
      places_[n_places_++] = static_cast<int>(place[r]);
    }
  }

  /// `count` rows from one place to another; what was there before is lost, and nothing stays behind.
  void move(int from, int to, int count) { add({Kind::move, from, to, count, 0, 0}); }

  /// Rows from `begin` on are no more.
  void cut(int begin) { add({Kind::cut, begin, 0, 0, 0, 0}); }

  Arrival arrival;

  /// The steps from `position` on, on other columns of the same rows, `most` of them. `spare`: as many.
  void replay(std::size_t position, RootRow<Scalar>* row, int most, RootRow<Scalar>* spare) const
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
        case Kind::sort:
          std::copy(row + step.first, row + step.first + step.count, spare);
          for (int r = 0; r < step.count; ++r) {
            row[step.first + places_[step.data + static_cast<std::size_t>(r)]] = spare[r];
          }
          break;
        case Kind::move:
          std::copy(row + step.first, row + step.first + step.count, spare);
          for (int r = 0; r < step.count; ++r) { row[step.first + r].setZero(); }
          std::copy(spare, spare + step.count, row + step.second);
          break;
        case Kind::cut:
          for (int r = step.first; r < most; ++r) { row[r].setZero(); }
          break;
      }
    }
  }

private:
  enum class Kind : char { reflect, rotate, sort, move, cut };
  struct Step {
    Kind kind;
    int first, second, count, other;
    std::size_t data;  ///< where its numbers or places begin
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
    RootRow<Scalar>& top = row[step.first];
    RootRow<Scalar>* const others = row + step.second - 1;  // row r > 0 is others[r]
    const Scalar &alpha = numbers_[step.data], &factor = numbers_[step.data + 1];
    const Scalar* const x = numbers_.data() + step.data + 2;
    if (step.other > 0) { top.swap(others[step.other]); }
    RootRow<Scalar> sum = top * x[0];
    for (int r = 1; r < step.count; ++r) { sum += others[r] * x[r]; }
    const RootRow<Scalar> w = (sum - top * alpha) * factor;
    top = sum * (Scalar(1) / alpha);
    for (int r = 1; r < step.count; ++r) { others[r] -= w * x[r]; }
  }

  std::vector<Step> steps_;
  std::vector<Scalar> numbers_;
  std::vector<int> places_;
  std::size_t size_ = 0, n_numbers_ = 0, n_places_ = 0;
  int first_ = 0, second_ = 1;
};

}  // namespace iim::detail
