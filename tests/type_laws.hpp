// The law suite on a part, all laws named.
#pragma once

#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/law_suite.hpp>

#include <string>

namespace iim::test {

/// Checks that the part obeys all laws that it can break: `stored` of them are about springs.
template <class S>
void obeys_the_laws(const std::string& name, const S& part, const LawOptions<S>& options = {}, std::size_t stored = 0)
{
  const LawReport report = check_laws(part, options);
  INFO(name << ", seed " << options.seed << "\n" << report.text());
  CHECK(report.ok());
  // Inertia, velocity, acceleration, recursion, equations, power, linear in u, invariance, static tree, square root.
  CHECK(report.laws.size() == (S::n_i > 0 ? 11 : 10) + stored);
}

}  // namespace iim::test
