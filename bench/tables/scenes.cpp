// PART OF: iim_tables
// Counts the operations of tables/scenes.hpp, in one random state each.
#include "scenes.hpp"

#include "../common/counted.hpp"
#include "../common/pool.hpp"
#include "../peers/models.hpp"

#include <iim/subsystem/sprung.hpp>
#include <iim/task.hpp>

#include <cstddef>
#include <stdexcept>
#include <string>
#include <variant>

namespace bench {

namespace {

using Standard = iim::StandardAssembly<Counted>;
using Springs = iim::Assembly<iim::Sprung<iim::RevoluteLink<Counted>>>;

/// Adds a row: what `f` takes, which returns something that is ok().
template <class F>
void count(Table& table, const std::string& scene, F&& f)
{
  bool ok = false;
  const Operations all = operations([&] { ok = f().ok(); });
  if (!ok) { throw std::runtime_error("there is nothing to count: " + scene); }
  table.add({scene, text("%.0f", all.products), text("%.0f", all.sums), text("%.0f", all.functions)});
}

/// A robot in a random state; refers to itself and therefore stays where it is.
template <class Parts>
struct Robot {
  using Tree = typename Parts::Tree;
  using Inputs = iim::Inputs<Tree>;

  explicit Robot(const Parts& parts)
      : tree(parts), workspace(tree), x(random_states(tree, 0, 1, 20)[0].template cast<Counted>())
  {
  }
  Robot(const Robot&) = delete;
  Robot& operator=(const Robot&) = delete;

  /// Those of the subsystems whose names begin so.
  Inputs motors(const std::string& beginning = "") const
  {
    Inputs inputs(tree, iim::Start::empty);
    for (const iim::Node& node : tree.nodes()) {
      const std::string& name = tree.name(node.index);
      if (tree.motors(node.index) > 0 && name.starts_with(beginning)) { inputs.add_motor(name); }
    }
    return inputs;
  }

  template <iim::Scene scene = iim::Scene{}>
  auto pass()
  {
    return iim::forward_dynamics<scene>(x.q, x.qd, workspace);
  }

  void count_Bhat(Table& table, const std::string& scene, const Inputs& inputs)
  {
    iim::ImplicitInversion<Tree> method(tree, inputs);
    const auto fd = pass();
    count(table, scene, [&] { return method(fd); });
  }

  /// q̈₀, and B̂ of all motors and of the last.
  void count_all(Table& table, const std::string& name, const std::string& last)
  {
    count(table, name + ": q̈₀", [&] { return pass(); });
    count_Bhat(table, name + ": B̂, all motors", motors());
    count_Bhat(table, name + ": B̂, the last motor", motors(last));
  }

  Tree tree;
  iim::Workspace<Tree> workspace;
  State<Counted> x;
};

/// `inputs` and forces on the four contact points of each foot.
Robot<Standard>::Inputs on_feet(std::size_t feet, Robot<Standard>::Inputs inputs)
{
  for (std::size_t k = 0; k < 4 * feet; ++k) { inputs.add_force(iim::models::biped_contacts[k]); }
  return inputs;
}

void count_biped(Table& table)
{
  Robot<Standard> biped(iim::models::biped<Counted>());
  const Robot<Standard>::Inputs none(biped.tree, iim::Start::empty), all = on_feet(2, biped.motors());
  count(table, "biped: q̈₀", [&] { return biped.pass(); });
  count(table, "biped: q̈₀ at rest", [&] { return biped.pass<iim::Scene{.velocity = false}>(); });
  count(table, "biped: q̈₀ without gravity", [&] { return biped.pass<iim::Scene{.gravity = false}>(); });
  biped.count_Bhat(table, "biped: B̂, one motor", biped.motors("left_toe"));
  biped.count_Bhat(table, "biped: B̂, the 7 motors of one leg", biped.motors("left_"));
  biped.count_Bhat(table, "biped: B̂, 14 motors", biped.motors());
  biped.count_Bhat(table, "biped: B̂, 14 motors and one foot, 26 inputs", on_feet(1, biped.motors()));
  biped.count_Bhat(table, "biped: B̂, 14 motors and both feet, 38 inputs", all);
  biped.count_Bhat(table, "biped: B̂, one foot, 12 inputs", on_feet(1, none));

  iim::ImplicitInversion method(biped.tree, all);
  const auto fd = biped.pass();
  const auto dynamics = method(fd);
  const auto count_rows = [&](const std::string& name, auto&& add_to) {
    iim::Tasks tasks(biped.tree, all);
    add_to(tasks);
    count(table, "biped: task rows, " + name, [&] { return tasks(fd); });
    count(table, "biped: task rows, " + name + ", with J_t B̂ of 38 inputs", [&] { return tasks(fd, dynamics); });
  };
  count_rows("one point", [](auto& tasks) { tasks.add_point(iim::models::biped_contacts[0]); });
  count_rows("centre of mass", [](auto& tasks) { tasks.add_com(); });
}

/// The same links with a spring and a damper on every joint.
Springs with_springs(const Standard& links)
{
  Springs sprung;
  for (const auto& part : links.parts()) {
    iim::Sprung<iim::RevoluteLink<Counted>> link{std::get<iim::RevoluteLink<Counted>>(part.part)};
    link.stiffness(0) = 100;
    link.damping(0) = 1;
    sprung.add(part.name, part.on, link);
  }
  return sprung;
}

}  // namespace

Table scenes_table()
{
  Table table({"scene", "products", "sums", "roots and functions of angles"});
  count_biped(table);
  const Standard arm = peers::seven_axis_arm().cast<Counted>();
  Robot<Standard>(arm).count_all(table, "seven-axis arm", "axis7");
  Robot<Springs> sprung(with_springs(arm));
  count(table, "seven-axis arm with springs: q̈₀", [&] { return sprung.pass(); });
  count(table, "seven-axis arm with springs: q̈₀ of an implicit step",
        [&] { return iim::implicit_step(sprung.x.q, sprung.x.qd, 1e-3, sprung.workspace); });
  Robot<Standard>(iim::models::chain<Counted>(50)).count_all(table, "chain of 50", "link49");
  Robot<Standard>(iim::models::binary_tree<Counted>(63)).count_all(table, "tree of 63", "link62");
  return table;
}

}  // namespace bench
