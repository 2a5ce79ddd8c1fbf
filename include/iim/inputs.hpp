// Which columns B̂ has: motor torques, forces and wrenches at points; in the user's order, switched at run time.
#pragma once

#include <iim/errors.hpp>
#include <iim/node_state.hpp>
#include <iim/numerics/array.hpp>
#include <iim/numerics/change_count.hpp>
#include <iim/spatial.hpp>
#include <iim/tree.hpp>

#include <cassert>
#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>

namespace iim {

/// What a block of columns of B̂ stands for.
enum class InputKind {
  motor,  ///< the motors of one subsystem
  force,  ///< force at a point, 3 columns (x, y, z) [N]
  wrench  ///< force (3) [N] and moment (3) [N m] at a point, 6 columns
};

/// Axes in which a force or wrench is given.
enum class Axes {
  world,
  body  ///< those of the frame that it acts on
};

/// One block of columns.
template <class Scalar>
struct Input {
  InputKind kind;
  std::string name;
  Index size;                                       ///< number of columns
  Index subsystem;                                  ///< that it acts on
  Index frame = -1;                                 ///< that it acts on (force, wrench)
  Vector3<Scalar> point = Vector3<Scalar>::Zero();  ///< in that frame [m] (force, wrench)
  Matrix3<Scalar> R = Matrix3<Scalar>::Identity();  ///< axes of a named frame on that frame, for Axes::body
  Axes axes = Axes::world;
  Index v = 0;           ///< first velocity of the subsystem (motor)
  Index velocities = 0;  ///< how many (motor)
  Index bbar = 0;        ///< place of its B̄ in Workspace::Bbar (motor)
  bool active = true;
};

/// What inputs begin with: all motors of the tree, in the order of its subsystems, or nothing.
enum class Start { all_motors, empty };

namespace detail {

/// Inputs of any tree.
template <class Scalar_>
class InputBlocks {
public:
  using Scalar = Scalar_;
  using Id = Index;  ///< number of a block, in the order of adding

  /// The motor inputs of one subsystem. Throws ModelError if it does not exist, has none, or is in already.
  Id add_motor(const std::string& subsystem)
  {
    const Input<Scalar> input = motors_of(tree_->index(subsystem));
    if (input.size == 0) { detail::refuse({"subsystem '", subsystem, "' has no motor"}); }
    for (const Input<Scalar>& other : blocks_) {
      if (other.kind == InputKind::motor && other.subsystem == input.subsystem) {
        detail::refuse({"the motor of subsystem '", subsystem, "' is an input already"});
      }
    }
    return append(input);
  }

  /// The block of a subsystem's motor inputs. Throws ModelError if they are no inputs.
  Id motor(const std::string& subsystem) const
  {
    for (Id id = 0; id < blocks(); ++id) {
      if (block(id).kind == InputKind::motor && block(id).name == subsystem) { return id; }
    }
    detail::refuse({"the motor of subsystem '", subsystem, "' is none of the inputs"});
  }

  /// Force on the robot at a point of a named frame [m, in its axes], 3 columns. Throws ModelError if there is no such
  /// frame, it is one of the world's own (columns on a FixedLink that the world carries are zero), or the point is not
  /// finite.
  Id add_force(const std::string& frame, const FramePoint<Scalar>& point = {}, Axes axes = Axes::world)
  {
    return append(at_point(InputKind::force, 3, frame, point.at, axes));
  }
  Id add_force(const std::string& frame, Axes axes) { return add_force(frame, FramePoint<Scalar>(), axes); }

  /// Force and moment on the robot at a point of a named frame, 6 columns (force, moment). Throws as add_force.
  Id add_wrench(const std::string& frame, const FramePoint<Scalar>& point = {}, Axes axes = Axes::world)
  {
    return append(at_point(InputKind::wrench, 6, frame, point.at, axes));
  }
  Id add_wrench(const std::string& frame, Axes axes) { return add_wrench(frame, FramePoint<Scalar>(), axes); }

  /// Switches a block of columns on or off. (Of a number that is none of a block's, with assertions off: nothing.)
  void set_active(Id id, bool active)
  {
    assert(id >= 0 && id < blocks() && "no such input");
    if (id < 0 || id >= blocks()) { return; }  // a block's column(), taken for its number, is −1 while it is inactive
    blocks_[static_cast<std::size_t>(id)].active = active;
    count();
  }

  const TreeData<Scalar>& tree() const { return *tree_; }
  /// Another number than that of inputs with other blocks: what copies have in common, whichever blocks are active.
  std::uint64_t id() const { return id_; }
  Index columns() const { return columns_; }  ///< active columns: the width of B̂, the length of u, the paper's m
  Index changes() const { return changes_; }  ///< another number than before: blocks may have been switched
  Index max_columns() const { return max_columns_; }  ///< columns if all blocks are active
  /// The same, for a method on `tree`. Throws ModelError if these are the inputs of another one.
  Index max_columns_on(const TreeData<Scalar>& tree) const
  {
    if (tree.id() != tree_->id()) { detail::refuse({"the inputs are those of another tree than the method's"}); }
    return max_columns_;
  }
  Index blocks() const { return static_cast<Index>(blocks_.size()); }
  const Input<Scalar>& block(Id id) const
  {
    assert(id >= 0 && id < blocks() && "no such input");
    return blocks_[static_cast<std::size_t>(id)];
  }

  /// First column of a block in B̂; −1 while it is inactive.
  Index column(Id id) const
  {
    assert(0 <= id && id < blocks() && "no such input");
    Index column = 0;
    for (Id k = 0; k < id; ++k) {
      if (block(k).active) { column += block(k).size; }
    }
    return block(id).active ? column : -1;
  }

  /// Calls f(block, first column) for the active blocks in the order of columns.
  template <class F>
  void for_each_active(F&& f) const
  {
    Index column = 0;
    for (const Input<Scalar>& input : blocks_) {
      if (input.active) {
        f(input, column);
        column += input.size;
      }
    }
  }

protected:
  [[gnu::cold]] InputBlocks(const TreeData<Scalar>& tree, Start start) : tree_(&tree)
  {
    if (start == Start::all_motors) {
      for (Index i = 0; i < tree.size(); ++i) {
        if (motors_of(i).size > 0) { append(motors_of(i)); }
      }
    }
  }

  Id append(const Input<Scalar>& input)
  {
    blocks_.push_back(input);
    id_ = next_id();
    max_columns_ += input.size;
    count();
    return blocks() - 1;
  }

private:
  Input<Scalar> motors_of(Index i) const
  {
    Input<Scalar> input{InputKind::motor, tree_->name(i), tree_->motors(i), i};
    input.v = tree_->node(i).v;
    input.velocities = tree_->velocities(i);
    input.bbar = tree_->node(i).bbar;
    return input;
  }

  Input<Scalar> at_point(InputKind kind, Index size, const std::string& name, const Vector3<Scalar>& point,
                         Axes axes) const
  {
    const FrameReference<Scalar>& frame = tree_->frame(name);
    if (frame.frame < 0) {
      detail::refuse({"frame '", name, "' is fixed to the world: no force on it moves the robot"});
    }
    if (!detail::all_finite(point)) {
      detail::refuse({"point on frame '", name, "' must be finite, got ", detail::to_text(point)});
    }
    Input<Scalar> input{kind, name, size, frame.subsystem, frame.frame};
    input.point = detail::times(frame.at.R, point);
    detail::add(input.point, frame.at.p);
    input.R = frame.at.R;
    input.axes = axes;
    return input;
  }

  void count()
  {
    ++changes_;
    columns_ = 0;
    for (const Input<Scalar>& input : blocks_) { columns_ += input.active ? input.size : 0; }
  }

  const TreeData<Scalar>* tree_;
  Array<Input<Scalar>> blocks_;
  Index columns_ = 0;
  Index max_columns_ = 0;
  ChangeCount changes_;
  std::uint64_t id_ = next_id();
};

}  // namespace detail

/// The inputs u of a tree, block by block in the order of adding. Set-up may allocate and throw ModelError; set_active
/// does neither. Columns of inactive blocks do not exist: those after them move up. Refer to the tree, which must stay
/// where it is.
template <class Tree>
class Inputs : public detail::InputBlocks<typename Tree::Scalar> {
  // (Of methods, too, whose constructors take these.)
  static_assert(!std::is_const_v<Tree>, "the tree's type without const: std::remove_const_t<decltype(tree)>");
  using Blocks = detail::InputBlocks<typename Tree::Scalar>;

public:
  using typename Blocks::Scalar;
  using Start = iim::Start;

  [[gnu::cold]] explicit Inputs(const Tree& tree, Start start = Start::all_motors) : Blocks(tree, start) {}
  explicit Inputs(const Tree&&, Start = Start::all_motors) = delete;

  /// The same inputs on the same robot with another Scalar. Throws ModelError if the subsystems are others.
  template <class Other>
  Inputs<Other> on(const Other& tree) const
  {
    using T = typename Other::Scalar;
    if (!tree.is_shaped_as(this->tree())) { detail::refuse({"the inputs are those of a robot of other subsystems"}); }
    Inputs<Other> other(tree, Start::empty);
    for (Index id = 0; id < this->blocks(); ++id) {
      const Input<Scalar>& input = this->block(id);
      other.append({input.kind, input.name, input.size, input.subsystem, input.frame, input.point.template cast<T>(),
                    input.R.template cast<T>(), input.axes, input.v, input.velocities, input.bbar, input.active});
    }
    return other;
  }
  template <class Other>
  Inputs<Other> on(const Other&&) const = delete;

  const Tree& tree() const { return static_cast<const Tree&>(Blocks::tree()); }

private:
  template <class Other>
  friend class Inputs;
};

namespace detail {

/// Wrench, at the coupling point of the frame's subsystem, of a unit in column j of a force or wrench input.
template <class Scalar>
Vector6<Scalar> input_wrench(const Input<Scalar>& input, const FrameState<Scalar>& f, Index j)
{
  Vector3<Scalar> direction;
  if (input.axes == Axes::world) {
    direction.setZero();
    direction(j % 3) = Scalar(1);
  } else {
    const Scalar* axis = input.R.data() + 3 * (j % 3);
    direction = times(f.R, Vector3<Scalar>(axis[0], axis[1], axis[2]));
  }
  Vector6<Scalar> w;
  if (j < 3) {
    Vector3<Scalar> x = f.r;
    add(x, times(f.R, input.point));
    set(w, direction, cross(x, direction));
  } else {
    set(w, Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(0)), direction);
  }
  return w;
}

}  // namespace detail
}  // namespace iim
