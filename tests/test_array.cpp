// detail::Array beside std::vector: the same operations, the same elements; nothing lost or freed twice if one throws.
#include <catch.hpp>
#include <iim/numerics/array.hpp>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace {

using iim::detail::Array;

template <class T>
void check_equal(const Array<T>& array, const std::vector<T>& vector)
{
  REQUIRE(array.size() == vector.size());
  CHECK(array.empty() == vector.empty());
  CHECK(std::vector<T>(array.begin(), array.end()) == vector);
  CHECK(std::vector<T>(array.rbegin(), array.rend()) == std::vector<T>(vector.rbegin(), vector.rend()));
  if (!vector.empty()) {
    CHECK(array.front() == vector.front());
    CHECK(array.back() == vector.back());
    CHECK(array.data() == array.begin());
  }
}

/// Random operations on both; `value` makes an element of a number.
template <class T, class Value>
void compare(Value value)
{
  std::mt19937 random(7);
  const auto below = [&](int n) { return std::uniform_int_distribution<int>(0, n - 1)(random); };
  Array<T> array;
  std::vector<T> vector;
  for (int k = 0; k < 2000; ++k) {
    const auto size = static_cast<std::size_t>(below(20));
    const T x = value(k);
    switch (below(12)) {
      case 0: array.resize(size), vector.resize(size); break;
      case 1: array.resize(size, x), vector.resize(size, x); break;
      case 2: array.assign(size, x), vector.assign(size, x); break;
      case 3: array.reserve(size), vector.reserve(size); break;
      case 4: array = Array<T>(size, x), vector = std::vector<T>(size, x); break;
      case 5: {
        const std::vector<T> more(size, x);
        array.append(more.begin(), more.end());
        vector.insert(vector.end(), more.begin(), more.end());
        break;
      }
      case 6: {
        const Array<T> copy(array);
        array.clear();
        array = copy;
        break;
      }
      case 7: {
        Array<T> moved(std::move(array));
        CHECK(array.empty());  // NOLINT: that it is empty is what is tested
        array = std::move(moved);
        break;
      }
      case 8:
        if (!vector.empty()) { array.pop_back(), vector.pop_back(); }
        break;
      case 9:
        if (!vector.empty()) {  // an element of its own, also where it grows
          array.push_back(array.front()), vector.push_back(vector.front());
          array[array.size() / 2] = x, vector[vector.size() / 2] = x;
        }
        break;
      default: array.push_back(x), array.emplace_back(x), vector.push_back(x), vector.push_back(x);
    }
    check_equal(array, vector);
  }
}

/// Counts its living copies; the copy that brings `until_throw` to zero is not made.
struct Fragile {
  inline static int living = 0, until_throw = 0;
  explicit Fragile(int n = 0) : number(n) { ++living; }
  Fragile(const Fragile& other) : number(other.number)
  {
    if (--until_throw == 0) { throw std::runtime_error("no copy"); }
    ++living;
  }
  Fragile& operator=(const Fragile&) = default;
  ~Fragile() { --living; }
  int number;
};

}  // namespace

TEST_CASE("An array holds what a vector holds")
{
  compare<int>([](int k) { return k; });
  compare<std::string>([](int k) { return "an element that is longer than a short string: " + std::to_string(k); });
  compare<Array<int>*>([](int) { return nullptr; });
}

TEST_CASE("An array that is assigned to itself keeps its elements")
{
  Array<std::string> array(3, "an element that is longer than a short string");
  const auto& same = array;
  array = same;
  REQUIRE(array.size() == 3);
  CHECK(array.back() == "an element that is longer than a short string");
}

TEST_CASE("Elements of an array need not be copyable, and are aligned as their type says")
{
  Array<std::unique_ptr<int>> owners;
  for (int k = 0; k < 9; ++k) { owners.push_back(std::make_unique<int>(k)); }
  const Array<std::unique_ptr<int>> moved(std::move(owners));
  REQUIRE(moved.size() == 9);
  CHECK(*moved[8] == 8);

  struct alignas(128) Wide {
    double x;
  };
  for (std::size_t n = 1; n < 9; ++n) {
    const Array<Wide> wide(n);
    CHECK(reinterpret_cast<std::uintptr_t>(wide.data()) % 128 == 0);
    CHECK(wide.back().x == 0);
  }
}

TEST_CASE("No element of an array is lost or destroyed twice if copying one throws")
{
  int throwing = 0;
  for (bool thrown = true; thrown;) {  // the first copy, the second … until there are not so many
    Fragile::living = 0;
    Fragile::until_throw = throwing + 1;
    thrown = false;
    {
      Array<Fragile> array;
      const Fragile one(1);
      try {
        for (int k = 0; k < 5; ++k) { array.push_back(one); }
        array.resize(9, one);
        Array<Fragile> other(array);
        other.resize(3);
        other = array;
        other.assign(12, one);
      } catch (const std::runtime_error&) {
        thrown = true;
        ++throwing;
      }
      CHECK(array.size() <= 9);
    }
    CHECK(Fragile::living == 0);
  }
  CHECK(throwing > 40);
}

TEST_CASE("An array larger than memory is refused")
{
  Array<double> array(2, 1.0);
  CHECK_THROWS_AS(array.reserve(static_cast<std::size_t>(-1)), std::bad_alloc);
  CHECK_THROWS_AS(array.resize(static_cast<std::size_t>(-1) / 4), std::bad_alloc);
  CHECK(array.size() == 2);
  CHECK(array[1] == 1.0);
}
