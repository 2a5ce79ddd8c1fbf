// The library in one include: q̈ = q̈₀ + B̂ u of a tree of mechanical subsystems at one state.
//
// A tour, in the order in which a controller meets the parts:
//
//     Assembly, DynamicTree, StaticTree   the robot: subsystems, where they hang, constant after construction
//     Inputs                              which columns B̂ has: motors, forces and wrenches at points
//     Workspace                           memory of the O(n) pass, and the choice of its Update (accuracy)
//     forward_dynamics(q, qd, workspace)  the O(n) pass, Sect. 2.3; returns the receipt ForwardDynamics
//     ImplicitInversion                   B̂ and q̈₀ from the receipt, Algorithm 1; AffineDynamics
//
// Not included here, each a header of its own: the other methods for B̂ (unit_force.hpp, global_inverse.hpp,
// recursive_inverse.hpp), M, h and B (equations_of_motion.hpp), task rows (task.hpp), many states at once
// (several_states.hpp), robots from files (urdf.hpp), the paper's models (models.hpp), further subsystems (subsystem/),
// their laws of mechanics as a test (law_suite.hpp), and T_ip, F_i, M̄_i, h̄_i, B̄_i of one subsystem as dense matrices
// (subsystem_matrices.hpp).
//
// Headers to include lie here and in subsystem/; what they are made of lies in folders, and comes with them:
//
//     pass/          the O(n) pass, its three loops, and how small pivots are mended
//     square_root/   the inward loop of Update::square_root, on N with A = NᵀN
//     inversion/     B̂: as a product of matrices, and as sweeps through the tree
//     mass_matrix/   M, h and B, and their factors
//     numerics/      numbers in registers, arrays, small matrices, sines
//     law_suite/, urdf/
//
// Subsystem i hangs with its coupling point on its parent p. Letters of the paper, and their names here:
//
//     V_i              FrameState::omega       its angular part: angular velocity of a frame, world axes
//     V̇_i              FrameState::Vdot        acceleration of a frame less gravity's, at the coupling point, world axes
//     q̇_i             qd                      velocities of subsystem i, n_i
//     T_ip             NodeState::r, S_k       X(r) [1 S_k]   (8)
//     Ṫ_ip V_p         NodeState::c, FrameState::bias    (19)
//     F_i              (0; 0; 1)               (7)
//     M̄_i, M̄*_i      FrameInertia::A, NodeState::U, MbarR    [ A U ; Uᵀ M̄_R ]   (10), (14)
//     h̄_i, h̄*_i      FrameInertia::h          (10), (15); FrameState::inertia() has both
//     M̄_R, M̄_R⁻¹     MbarR, MbarR_inv         (17)
//     T*_ip            −W X(r)[1 S_k] in its q̇ rows; NodeState::W      (16)
//     ψ                psi                     M̄_R⁻¹ F_iᵀ h̄*, the part of q̈_i that the inlet's motion leaves   (18)
//     B̄_i             Bbar                    n_i × n_u, the q̇ rows   (10)
//     Γ⁻¹, F*          rows_ in product_plan.hpp, H in product_form.hpp: with their columns times C, C Cᵀ = M̄_R⁻¹   (48), (31)
//     B̂, q̈₀          Bhat, qdd0               (2)
//
// Not in the paper: the gain W = M̄_R⁻¹ Uᵀ, the inlet (the parent's frame that carries the coupling point), a
// subsystem's frames (rigid parts that it moves), the scene (Scene), the square-root form (square_root.hpp).
//
// To read the code: kinematics.hpp, joint_step.hpp and forward_pass.hpp in pass/ are the three loops, product_form.hpp
// and sweep.hpp in inversion/ the two ways to B̂. All else there keeps digits in rarer cases. Its words: a pivot is
// M̄_R, the inertia that a joint feels; it is weak where it is a small difference of large inertias, and is mended when
// it is computed from the bodies beyond instead. What an inertia has been reduced from is its size. A limb is what
// hangs on a free body by one joint; its slip is 1 − W S, what rotors and springs within hold of that joint's motion,
// and the rest is undone by the joint. Of two joints that move alike, the inner has a share in the outer.
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
/// And such a tree.
template <class Scalar>
using StandardTree = typename StandardAssembly<Scalar>::Tree;

}  // namespace iim
