// A count by which what depends on an object tells that it has changed.
#pragma once

#include <Eigen/Core>

namespace iim::detail {

/// Differs after every change of what it is a member of, among them an assignment of the whole and a move from it.
class ChangeCount {
public:
  ChangeCount() = default;
  ChangeCount(const ChangeCount&) = default;
  ChangeCount(ChangeCount&& other) noexcept : count_(other.count_) { ++other; }
  ChangeCount& operator=(const ChangeCount&)
  {
    ++*this;
    return *this;
  }
  ChangeCount& operator=(ChangeCount&& other) noexcept
  {
    ++*this;
    ++other;
    return *this;
  }
  void operator++() { ++count_; }
  operator Eigen::Index() const { return count_; }

private:
  Eigen::Index count_ = 0;
};

}  // namespace iim::detail
