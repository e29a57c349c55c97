"""One step of the engine: formulate eq. (3) of the paper, solve it, integrate."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from physid.physics.contact_problem.formulation import formulate
from physid.physics.contact_problem.implicit import attach_gradient
from physid.physics.contact_problem.lcp import SolverSettings, solve_contacts
from physid.physics.effect import StepInputs
from physid.physics.schemes.displacement import displacement
from physid.physics.schemes.motion import drift, drifted, state_of
from physid.physics.state import State
from physid.physics.world import World


@dataclass(frozen=True)
class Step:
    """What one step gave.

    Attributes:
        state: The state after it.
        impulse: (normal, tangential) impulses of every contact [N s], shape (B, C, 3).
        residual: Largest violated equation, in units of the smoothing, shape (B,).
        newton_steps: Shape (B,).
        converged: Shape (B,).
    """

    state: State
    impulse: Tensor
    residual: Tensor
    newton_steps: Tensor
    converged: Tensor


def advance(
    state: State, inputs: StepInputs, world: World, settings: SolverSettings, step: Tensor | None = None
) -> Step:
    """Advance a batch by one step.

    Semi-implicit Euler: v+ from eq. (3), p+ = p + h v+, q+ = exp(h w+) q. Midpoint: v+ from eq. (3) at the poses after
    h / 2 with v, and on for h / 2 with v+.

    Args:
        state: The state before.
        inputs: Wrenches and properties that act during the step.
        world: Ground, joints and rules.
        settings: Accuracy of the solver.
        step: h [s], shape (B or 1,); None for `world.step`.

    Returns:
        The state after, the contact impulses, and how well the solver did.
    """
    h = state.pose.new_full((1,), world.step) if step is None else step
    acting = drifted(state, inputs, h / 2, gyroscopic=world.gyroscopic) if world.midpoint else state
    formulation = formulate(acting, state, inputs, world, h)
    solution = solve_contacts(formulation.problem, world.friction, settings)
    v, impulse = attach_gradient(formulation.problem, solution)
    after = formulation.of_bodies(v) * formulation.units.velocity[:, None, None]
    centre, quaternion = formulation.bodies.displaced(displacement(formulation, impulse, after, world, settings))
    if world.midpoint:
        centre, quaternion, after = drift(centre, quaternion, after, inputs.inertia, h / 2, gyroscopic=world.gyroscopic)
    return Step(
        state=state_of(centre, quaternion, after, inputs),
        impulse=impulse * formulation.units.impulse[:, None, None],
        residual=solution.residual,
        newton_steps=solution.steps,
        converged=solution.converged,
    )
