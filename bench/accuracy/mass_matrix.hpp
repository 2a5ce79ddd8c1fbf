// M and B as dense matrices, in any Scalar.
#pragma once

#include "../common/pool.hpp"

#include <iim/mass_matrix/equations_of_motion.hpp>

#include <vector>

namespace bench {

template <class Scalar>
class MassMatrix {
public:
  using TreeType = Tree<Scalar>;

  MassMatrix(const TreeType& tree, const iim::Inputs<TreeType>& inputs) : tree_(&tree), equations_(tree, inputs)
  {
    tree.outward([&]<class N, class S>(const N& node, const S&) {
      std::vector<Index> path;
      if (node.parent >= 0) { path = paths_[static_cast<std::size_t>(node.parent)]; }
      for (int d = 0; d < S::n_i; ++d) { path.push_back(node.v + d); }
      paths_.push_back(path);
    });
  }

  /// M, from the kinematics that an O(n) pass has left in the workspace.
  template <class Workspace>
  iim::MatrixX<Scalar> M(const Workspace& workspace)
  {
    equations_.compute(workspace);
    iim::MatrixX<Scalar> M = iim::MatrixX<Scalar>::Zero(tree_->n_v(), tree_->n_v());
    tree_->outward([&]<class N, class S>(const N& node, const S&) {
      const auto& path = paths_[static_cast<std::size_t>(node.index)];
      for (int d = 0; d < S::n_i; ++d) {
        for (std::size_t a = 0; a < path.size(); ++a) {
          M(node.v + d, path[a]) = M(path[a], node.v + d) = equations_.M()(static_cast<Index>(a), node.v + d);
        }
      }
    });
    return M;
  }

  /// B of the state of the last call of M.
  iim::MatrixX<Scalar> B() const
  {
    const auto& sparse = equations_.B();
    iim::MatrixX<Scalar> B = iim::MatrixX<Scalar>::Zero(tree_->n_v(), sparse.size());
    for (Index j = 0; j < sparse.size(); ++j) {
      const auto& column = sparse.column(j);
      const auto& path = paths_[static_cast<std::size_t>(column.subsystem)];
      for (Index a = column.begin; a < column.end; ++a) {
        B(path[static_cast<std::size_t>(a)], column.bhat) = sparse.entries(j)[a];
      }
    }
    return B;
  }

private:
  const TreeType* tree_;
  iim::detail::EquationsOfMotion<TreeType> equations_;
  std::vector<std::vector<Index>> paths_;
};

}  // namespace bench
