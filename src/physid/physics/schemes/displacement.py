"""How far a step moves bodies from where forces act, by velocities and by what contacts ask beyond these."""

from __future__ import annotations

import dataclasses

import torch
from torch import Tensor

from physid.physics.contact_problem.formulation import Formulation
from physid.physics.contact_problem.implicit import attach_gradient
from physid.physics.contact_problem.lcp import SolverSettings, solve_contacts
from physid.physics.contact_problem.rows import FAR
from physid.physics.schemes.impact import late
from physid.physics.schemes.units import STANDARD_GRAVITY
from physid.physics.world import World


def displacement(
    formulation: Formulation, impulse: Tensor, twist: Tensor, world: World, settings: SolverSettings
) -> Tensor:
    """Return how far bodies are displaced, shape (B, N, 6) [rad, m].

    Semi-implicit Euler: h v+, or what a simulator with other steps makes of the same change of the velocity (see
    `SemiImplicit`), and out of overlaps where the rule of contact removes them without velocity. Midpoint,
    where both halves of the step move bodies already: what impacts add to these (see `schemes.impact`).

    Args:
        formulation: The step.
        impulse: Those of its contacts, in its units, shape (B, C, 3).
        twist: v+ of the centres of mass, shape (B, N, 6).
        world: Rules.
        settings: Accuracy of the solver.
    """
    problem, units = formulation.problem, formulation.units
    if world.midpoint:
        beyond = late(problem.mass, problem.jacobian, impulse, formulation.share, twist.shape[1])
        return beyond * (units.velocity * units.step)[:, None, None]
    step = units.step[:, None, None]
    if world.single_step is not None:
        earlier = (1 - world.single_step / step) / 2
        twist = twist - earlier * (twist - formulation.bodies.twist)
    return step * twist + _removal(formulation, world, settings)


def _removal(formulation: Formulation, world: World, settings: SolverSettings) -> Tensor | float:
    """Return the displacement (B, N, 6) [rad, m] by which the rule of contact removes overlaps without velocity.

    It is h v for the v of a second problem: bodies at rest, no friction, u_n >= displacement / h.
    """
    problem, wanted = formulation.problem, world.contact.displacement(formulation.gap)
    touching = (problem.jacobian != 0).any(-1).any(-1)
    if wanted is None or not bool(touching.any()):
        return 0.0
    unit = (STANDARD_GRAVITY * formulation.units.step**2)[:, None]
    still = dataclasses.replace(
        problem,
        momentum=torch.zeros_like(problem.momentum),
        offset=torch.where(touching & (problem.compliance <= 0), -wanted / unit, FAR),
        slip=torch.zeros_like(problem.slip),
        friction=torch.zeros_like(problem.friction),
        joint_velocity=torch.zeros_like(problem.joint_velocity),
    )
    v, _ = attach_gradient(still, solve_contacts(still, world.friction, settings))
    return torch.where(touching.any(1)[:, None, None], formulation.of_bodies(v) * unit[..., None], 0.0)
