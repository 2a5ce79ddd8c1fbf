// Several states at once: a Scalar whose lanes are the same number of several states.
//
// The text of the recursions runs unchanged; each of its operations is one vector instruction. What such a Scalar must
// not do is to decide: a branch is taken by all lanes together. Its answers are therefore these.
//
//     a == b, a < b, …        true if in every lane, false otherwise. If it holds in some lanes and not in others, no
//                             answer suits all of them: the thread's `LaneVote` is marked as divided. What is computed
//                             from there on is wrong in some lanes, and its owner has to throw it away (SeveralStates
//                             does, and computes the states of such a pack one by one).
//     a != b                  !(a == b), divided in the same cases.
//     ScalarTraits            is_positive, is_finite: true if in every lane; no mark, because their false is an error
//                             status that makes SeveralStates look at each state by itself, or leads to what is right
//                             for every state and only slower (pass/weak_pivot.hpp).
//
// A comparison that all lanes answer alike costs no accuracy and no mark, so a subsystem with branches of its own is
// right in every lane, fast where its branches agree, slow where they do not, and never silently wrong.
#pragma once

#include <iim/numerics/lane_count.hpp>
#include <iim/numerics/lane_number.hpp>
#include <iim/scalar.hpp>

#include <Eigen/Core>

#include <limits>

namespace iim {

namespace detail {

/// Rows or columns that one step of a loop of the input-Jacobian methods treats: each is a register already.
template <class T, int N>
inline constexpr int lane_count<iim::Lanes<T, N>> = 1;
template <class T, int N>
inline constexpr bool is_several<iim::Lanes<T, N>> = true;

template <class T, int N>
struct OneByOne<iim::Lanes<T, N>> {
  static void ask() { LaneVote::divide(); }
  static bool is_asked() { return LaneVote::divided(); }
  static void withdraw() { LaneVote::reset(); }
};

}  // namespace detail

template <class T, int N>
struct ScalarTraits<Lanes<T, N>> {
  static bool is_positive(const Lanes<T, N>& x) { return x.is_positive(); }
  static bool is_finite(const Lanes<T, N>& x) { return x.is_finite(); }
};

}  // namespace iim

template <class T, int N>
struct std::numeric_limits<iim::Lanes<T, N>> : std::numeric_limits<T> {
  using Lanes = iim::Lanes<T, N>;
  static Lanes min() { return std::numeric_limits<T>::min(); }
  static Lanes max() { return std::numeric_limits<T>::max(); }
  static Lanes lowest() { return std::numeric_limits<T>::lowest(); }
  static Lanes epsilon() { return std::numeric_limits<T>::epsilon(); }
  static Lanes infinity() { return std::numeric_limits<T>::infinity(); }
  static Lanes quiet_NaN() { return std::numeric_limits<T>::quiet_NaN(); }
};

template <class T, int N>
struct Eigen::NumTraits<iim::Lanes<T, N>> : Eigen::GenericNumTraits<T> {
  using Real = iim::Lanes<T, N>;
  using NonInteger = iim::Lanes<T, N>;
  using Nested = iim::Lanes<T, N>;
  using Literal = T;
  enum { RequireInitialization = 0, ReadCost = 1, AddCost = 1, MulCost = 1 };
  static Real epsilon() { return std::numeric_limits<T>::epsilon(); }
  static Real dummy_precision() { return Eigen::NumTraits<T>::dummy_precision(); }
  static Real highest() { return std::numeric_limits<T>::max(); }
  static Real lowest() { return std::numeric_limits<T>::lowest(); }
  static Real infinity() { return std::numeric_limits<T>::infinity(); }
  static Real quiet_NaN() { return std::numeric_limits<T>::quiet_NaN(); }
};
