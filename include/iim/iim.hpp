#pragma once

#include <iim/affine_dynamics.hpp>
#include <iim/assembly.hpp>
#include <iim/forward_dynamics.hpp>
#include <iim/implicit_inversion.hpp>
#include <iim/inputs.hpp>
#include <iim/subsystem/floating_base.hpp>
#include <iim/subsystem/motor_arm.hpp>
#include <iim/subsystem/rigid_link.hpp>
#include <iim/tree.hpp>
#include <iim/workspace.hpp>

namespace iim {

/// The types of subsystem that a robot usually consists of, for a tree assembled at run time.
template <class Scalar>
using StandardAssembly = Assembly<RevoluteLink<Scalar>, MotorArm<Scalar>, FloatingBase<Scalar>, PrismaticLink<Scalar>,
                                  FixedLink<Scalar>, LinearMotorArm<Scalar>>;

}  // namespace iim
