// Putting a tree together: parts by name, in any order; then checked and sorted once.
#pragma once

#include <iim/body.hpp>
#include <iim/errors.hpp>
#include <iim/numerics/array.hpp>
#include <iim/subsystem.hpp>

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <limits>
#include <map>
#include <string>
#include <tuple>
#include <utility>
#include <variant>
#include <vector>

namespace iim {

template <class... S>
class DynamicTree;

/// Where a part hangs: on a frame of another part, on a named frame, or on the world.
template <class Scalar>
struct Attachment {
  std::string parent = "world";                     ///< name of a part or of a frame (Assembly::add_frame)
  Matrix3<Scalar> R = Matrix3<Scalar>::Identity();  ///< axes of the coupling point in the parent's frame
  Vector3<Scalar> p = Vector3<Scalar>::Zero();      ///< coupling point in the parent's frame [m]
  int outlet = 0;                                   ///< which of the parent's frames, for parts that have several
};

namespace detail {

/// f(what `part` holds). (std::visit makes tables of functions, which take g++ longer than the functions.)
template <class... S, class F>
[[gnu::cold]] void visit_part(std::variant<S...>& part, F&& f)
{
  (void)((std::holds_alternative<S>(part) && (f(*std::get_if<S>(&part)), true)) || ...);
}
template <class... S, class F>
[[gnu::cold]] void visit_part(const std::variant<S...>& part, F&& f)
{
  (void)((std::holds_alternative<S>(part) && (f(*std::get_if<S>(&part)), true)) || ...);
}

/// A name and where it is.
template <class Scalar>
struct NamedPlace {
  std::string name;
  Attachment<Scalar> on;
};

/// What an assembly knows whatever the types of its parts: compiled once for all lists of these.
template <class Scalar>
class AssemblyPlaces {
public:
  using NamedFrame = NamedPlace<Scalar>;

  const Vector3<Scalar>& gravity() const { return gravity_; }
  const std::vector<NamedFrame>& named_frames() const { return named_frames_; }

  /// The same place, given on a part or on the world. Throws ModelError if frames hang on each other in a loop, or on
  /// what there is not.
  [[gnu::cold]] Attachment<Scalar> on_part(const std::string& name, Attachment<Scalar> on) const
  {
    check_attachment(name, on);
    for (std::size_t k = 0; k <= named_frames_.size(); ++k) {
      const auto frame = std::find_if(named_frames_.begin(), named_frames_.end(),
                                      [&](const NamedFrame& f) { return f.name == on.parent; });
      if (frame == named_frames_.end()) { return on; }
      check_attachment(frame->name, frame->on);
      const Placement<Scalar> at = Placement<Scalar>{frame->on.R, frame->on.p} * Placement<Scalar>{on.R, on.p};
      on = {frame->on.parent, at.R, at.p, frame->on.outlet};
    }
    refuse({"'", name, "' hangs on a loop of frames"});
  }

protected:
  /// A part, by its number in the order of adding, where it stands in the sorted list.
  struct Sorted {
    int part;
    int parent;  ///< index in the sorted list
    Attachment<Scalar> on;
  };

  [[gnu::cold]] void take_gravity(const Vector3<Scalar>& gravity)
  {
    if (!all_finite(gravity)) { refuse({"gravity must be finite, got ", to_text(gravity)}); }
    gravity_ = gravity;
  }

  [[gnu::cold]] void name_frame(const std::string& name, const Attachment<Scalar>& on)
  {
    claim(name, 1);
    named_frames_.push_back({name, on});
  }

  [[gnu::cold]] void claim(const std::string& name, int outlets)
  {
    if (name.empty() || name == "world") { refuse({"'", name, "' cannot be the name of a part or frame"}); }
    if (!outlets_.emplace(name, outlets).second) { refuse({"the name '", name, "' is given twice"}); }
  }

  /// The parts depth first, each on a part or the world.
  [[gnu::cold]] Array<Sorted> depth_first(const Array<const NamedPlace<Scalar>*>& parts) const
  {
    if (parts.empty()) { refuse({"the assembly has no parts"}); }
    const int size = static_cast<int>(parts.size());
    std::map<std::string, int> index;
    for (int k = 0; k < size; ++k) { index[parts[at(k)]->name] = k; }

    Array<Array<int>> children(parts.size());
    Array<int> roots;
    Array<Attachment<Scalar>> on;
    for (int k = 0; k < size; ++k) {
      on.push_back(on_part(parts[at(k)]->name, parts[at(k)]->on));
      if (on.back().parent == "world") {
        roots.push_back(k);
      } else {
        children[at(index.at(on.back().parent))].push_back(k);
      }
    }

    Array<Sorted> order;
    Array<std::pair<int, int>> stack;  // part, sorted index of its parent; last in, first out
    for (auto root = roots.rbegin(); root != roots.rend(); ++root) { stack.emplace_back(*root, -1); }
    Array<char> reached(parts.size(), 0);
    while (!stack.empty()) {
      const auto [k, parent] = stack.back();
      stack.pop_back();
      reached[at(k)] = 1;
      order.push_back({k, parent, on[at(k)]});
      const int self = static_cast<int>(order.size()) - 1;
      for (auto c = children[at(k)].rbegin(); c != children[at(k)].rend(); ++c) { stack.emplace_back(*c, self); }
    }
    for (int k = 0; k < size; ++k) {
      if (!reached[at(k)]) {
        refuse({"subsystem '", parts[at(k)]->name, "' hangs on a loop: its parents never reach the world"});
      }
    }
    return order;
  }

private:
  [[gnu::cold]] void check_attachment(const std::string& name, const Attachment<Scalar>& on) const
  {
    if (on.parent != "world") {
      const auto parent = outlets_.find(on.parent);
      if (parent == outlets_.end()) { refuse({"'", name, "' hangs on '", on.parent, "', which does not exist"}); }
      if (on.outlet < 0 || on.outlet >= parent->second) {
        refuse({"'", name, "' hangs on outlet ", std::to_string(on.outlet), " of '", on.parent, "', which has ",
                std::to_string(parent->second)});
      }
    }
    if (!all_finite(on.R) || !all_finite(on.p)) {
      refuse({"'", name, "': the coupling point's placement must be finite, got R = ", to_text(on.R),
              ", p = ", to_text(on.p)});
    }
    Scalar error(0);
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        const Scalar e = dot(column(on.R, i), column(on.R, j)) - Scalar(i == j ? 1 : 0);
        error += e * e;
      }
    }
    const Scalar volume = dot(column(on.R, 0), cross(column(on.R, 1), column(on.R, 2)));
    const double rounding = 64 * to_double(Eigen::NumTraits<Scalar>::epsilon());  // a few rotations multiplied
    if (!(to_double(error) < std::max(1e-12, rounding * rounding)) || !(volume > Scalar(0))) {
      refuse({"'", name, "': the coupling point's R must be a rotation, got ", to_text(on.R)});
    }
  }

  std::vector<NamedFrame> named_frames_;
  std::map<std::string, int> outlets_;  // of parts and named frames: how many
  Vector3<Scalar> gravity_{Scalar(0), Scalar(0), Scalar(-9.81)};
};

}  // namespace detail

/// The parts of a robot before they are a tree. S…: the types of subsystem that may occur.
///
/// Parts may come in any order, a parent after its children. `sorted` checks the whole and gives the parts depth
/// first: every subtree contiguous, brothers in the order of adding. That is the order of q, q̇, q̈ and of B̂'s rows.
/// (What is called once for a robot is [[gnu::cold]], here and elsewhere: of all that a controller compiles, g++ -O3
/// takes 6 % less time and 7 % less code.)
template <class... S>
class Assembly : detail::AreSubsystems<S...>,
                 public detail::AssemblyPlaces<typename std::tuple_element_t<0, std::tuple<S...>>::Scalar> {
public:
  using Scalar = typename std::tuple_element_t<0, std::tuple<S...>>::Scalar;
  using Part = std::variant<S...>;
  using Tree = DynamicTree<S...>;
  using NamedFrame = detail::NamedPlace<Scalar>;
  static_assert(!std::numeric_limits<Scalar>::is_integer, "the Scalar of a robot must be able to hold fractions");

  struct NamedPart : NamedFrame {
    Part part;
    int parent = -1;  ///< index in the sorted list; set by sorted()
  };

  /// Adds a subsystem. Throws ModelError if the name is empty, taken, or "world"; the rest is checked by `sorted`.
  template <class T>
  [[gnu::cold]] Assembly& add(const std::string& name, const Attachment<Scalar>& on, const T& part)
  {
    constexpr bool is_listed = (std::same_as<T, S> || ...);
    static_assert(is_listed, "this type of subsystem is not among those that the Assembly lists: Assembly<..., T>");
    if constexpr (is_listed) {  // else what follows would add errors of std::variant
      this->claim(name, T::n_frames);
      parts_.push_back({{name, on}, part});
    }
    return *this;
  }

  /// Names a frame fixed on a part: a contact or task point. Every part's name already names its own first frame.
  Assembly& add_frame(const std::string& name, const Attachment<Scalar>& on)
  {
    this->name_frame(name, on);
    return *this;
  }

  /// Acceleration of free fall in world axes [m/s²]; (0, 0, −9.81) if not set.
  Assembly& set_gravity(const Vector3<Scalar>& gravity)
  {
    this->take_gravity(gravity);
    return *this;
  }

  const std::vector<NamedPart>& parts() const { return parts_; }

  /// The same robot with another Scalar; every type of subsystem must have cast<T>().
  template <class T>
  auto cast() const
  {
    Assembly<typename detail::InScalar<S, T>::Type...> other;
    other.set_gravity(this->gravity().template cast<T>());
    const auto cast_attachment = [](const Attachment<Scalar>& on) {
      return Attachment<T>{on.parent, on.R.template cast<T>(), on.p.template cast<T>(), on.outlet};
    };
    for (const NamedPart& part : parts_) {
      detail::visit_part(part.part,
                         [&](const auto& s) { other.add(part.name, cast_attachment(part.on), s.template cast<T>()); });
    }
    for (const NamedFrame& frame : this->named_frames()) { other.add_frame(frame.name, cast_attachment(frame.on)); }
    return other;
  }

  /// Parts depth first, each checked, prepared and given on a part or the world, the bodies of FixedLinks in what
  /// carries them where that takes them. Throws ModelError for a parent that does not exist, a loop, an outlet that the
  /// parent does not have, a coupling that is no rotation, wrong parameters, or an empty assembly.
  [[gnu::cold]] std::vector<NamedPart> sorted() const
  {
    detail::Array<const NamedFrame*> places;
    for (const NamedPart& part : parts_) { places.push_back(&part); }
    std::vector<NamedPart> order;
    for (const auto& [part, parent, on] : this->depth_first(places)) {
      const NamedPart& given = parts_[detail::at(part)];
      order.push_back({{given.name, on}, given.part, parent});
      const std::string owner = "subsystem '" + given.name + "'";
      detail::visit_part(order.back().part, [&](auto& s) { s.prepare(owner); });
    }
    put_fixed_bodies_into_carriers(order);
    return order;
  }

  struct Merged {
    std::vector<NamedPart> parts;
    std::vector<NamedFrame> frames;  ///< the other FixedLinks: where they are on these
  };

  /// The same, but a FixedLink whose body went into what carries it is a frame of that, and what hangs on it hangs
  /// there.
  [[gnu::cold]] Merged merged() const
  {
    struct Place {
      int part;  ///< of the result
      Placement<Scalar> on_part;
    };
    Merged result;
    detail::Array<Place> places;
    const std::vector<NamedPart> order = sorted();
    for (const NamedPart& part : order) {
      const bool is_frame = goes_into_carrier(part, order);
      Attachment<Scalar> on = part.on;
      int carrier = -1;
      if (part.parent >= 0) {
        const Place& parent = places[detail::at(part.parent)];
        const Placement<Scalar> there = parent.on_part * Placement<Scalar>{on.R, on.p};
        carrier = parent.part;
        on = {result.parts[detail::at(carrier)].name, there.R, there.p, on.outlet};
      }
      if (is_frame) {
        places.push_back({carrier, {on.R, on.p}});
        result.frames.push_back({part.name, on});
      } else {
        places.push_back({static_cast<int>(result.parts.size()), {}});
        result.parts.push_back({{part.name, on}, part.part, carrier});
      }
    }
    return result;
  }

private:
  /// Whether it is a fixed link on what takes its body. order: sorted.
  [[gnu::cold]] static bool goes_into_carrier(const NamedPart& part, const std::vector<NamedPart>& order)
  {
    constexpr std::array is_fixed{detail::is_fixed<S>()...}, takes{detail::takes_fixed_bodies<S>()...};
    return part.parent >= 0 && is_fixed[part.part.index()] && takes[order[detail::at(part.parent)].part.index()];
  }

  /// Those of fixed links, tips first, as fixed links hang on each other.
  [[gnu::cold]] static void put_fixed_bodies_into_carriers(std::vector<NamedPart>& order)
  {
    const auto fixed_body = [](NamedPart& part) {
      Body<Scalar>* body = nullptr;
      detail::visit_part(part.part, [&]<class T>(T& s) {
        if constexpr (detail::is_fixed<T>() || detail::takes_fixed_bodies<T>()) { body = &s.fixed_body(); }
      });
      return body;
    };
    for (auto part = order.rbegin(); part != order.rend(); ++part) {
      if (!goes_into_carrier(*part, order)) { continue; }
      Body<Scalar>& body = *fixed_body(*part);
      fixed_body(order[detail::at(part->parent)])->add(body.placed({part->on.R, part->on.p}));
      body = Body<Scalar>::massless();
    }
  }

  std::vector<NamedPart> parts_;
};

}  // namespace iim
