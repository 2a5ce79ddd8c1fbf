// Eighty digits.
#pragma once

#include "accuracy.hpp"

#include <boost/multiprecision/cpp_bin_float.hpp>

namespace bench {

using Digits = boost::multiprecision::number<boost::multiprecision::cpp_bin_float<80>, boost::multiprecision::et_off>;

/// Everything about one state in 80 digits.
struct ExactState {
  iim::VectorX<Digits> qdd0;
  iim::MatrixX<Digits> Bhat, M, B;
};

/// The largest relative difference (Frobenius) of M, B, B̂, q̈₀ from what the tests' literal reference of the paper
/// gives: global matrices, body-fixed frames, Gaussian elimination. Shares no line with the library's recursions.
double apart_from_the_paper(const AccuracyScene& scene, const iim::StandardAssembly<Digits>& parts,
                            const State<Digits>& x, const ExactState& exact);

}  // namespace bench
