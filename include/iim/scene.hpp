// Which terms of the dynamics there are: a choice at compile time.
#pragma once

namespace iim {

/// What a scene has; a term that is off costs nothing.
struct Scene {
  bool velocity = true;   ///< false: q̇ = 0, and the argument is not read
  bool gravity = true;    ///< false: free fall
  bool implicit = false;  ///< true: springs and dampers at the end of a step, `implicit_step`

  bool operator==(const Scene&) const = default;
};

}  // namespace iim
