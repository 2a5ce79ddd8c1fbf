// PART OF: iim_several
#include "../common/counted.hpp"
#include "../common/pool.hpp"
#include "several.hpp"

namespace bench {

std::pair<double, double> operations(const peers::Model& model)
{
  const iim::StandardAssembly<double> in_double = peers::assembly(model);
  const peers::Tree double_tree(in_double);
  const Tree<Counted> tree(in_double.cast<Counted>());
  const iim::Inputs<Tree<Counted>> inputs = peers::choose_inputs(double_tree, model).on(tree);
  iim::Workspace<Tree<Counted>> workspace(tree);
  iim::ImplicitInversion<Tree<Counted>> method(tree, inputs);
  const State<Counted> x = random_states(tree, inputs.columns(), 1, 4711)[0].cast<Counted>();
  Counted::done = {};
  const bool ok = method(iim::forward_dynamics(x.q, x.qd, workspace)).ok();
  const double both = ok ? Counted::done.all() : 0;
  Counted::done = {};
  const bool moves = iim::forward_dynamics(x.q, x.qd, inputs, x.u, workspace).ok();
  return {both, moves ? Counted::done.all() : 0};
}

}  // namespace bench
