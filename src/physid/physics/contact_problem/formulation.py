"""The contact problem of a step, eq. (3) of the paper, from the state of the bodies and what acts on them."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import pad

from physid.physics.contact_problem.lcp import ContactProblem
from physid.physics.contact_problem.rows import patches_of, rows_of
from physid.physics.effect import StepInputs
from physid.physics.joints import equations_of
from physid.physics.schemes.motion import MassCentres, newton_euler
from physid.physics.schemes.units import Units
from physid.physics.state import State
from physid.physics.world import World


@dataclass(frozen=True)
class Formulation:
    """A batch of steps as contact problems.

    The unknown velocity is that of all bodies, followed by the redundant modes of each patch: its warp, and between two
    bodies on the ground its lever (see `Patch`).

    Attributes:
        problem: In units of velocities, g h, and of impulses, m g h.
        units: These units.
        bodies: Where forces act, with the twists before the step.
        share: Which share of the step the impulses of the contacts act [-], shape (B, C).
        gap: Distances of the contacts, negative where bodies overlap [m], shape (B, C).
    """

    problem: ContactProblem
    units: Units
    bodies: MassCentres
    share: Tensor
    gap: Tensor

    def of_bodies(self, unknown: Tensor) -> Tensor:
        """Return the part of the bodies in unknowns (B, n), shape (B, N, 6)."""
        count = self.bodies.twist.shape[1]
        part: Tensor = unknown[:, : 6 * count].unflatten(1, (count, 6))
        return part


def formulate(state: State, before: State, inputs: StepInputs, world: World, step: Tensor) -> Formulation:
    """Collect joints, contacts and forces, and assemble eq. (3).

    Args:
        state: Where forces act, at the beginning of a step or at its midpoint.
        before: At the beginning.
        inputs: Wrenches and properties that act during the step.
        world: Ground, joints and rules.
        step: h [s], shape (B or 1,).
    """
    joints = equations_of(world.joints, state, before, step[:, None], midpoint=world.midpoint)
    bodies = MassCentres.of(state, inputs)
    patches = patches_of(state.pose, inputs, world)
    units = Units.of(step, inputs.mass, midpoint=world.midpoint)
    mass, momentum = newton_euler(bodies, inputs, step, gyroscopic=world.gyroscopic and not world.midpoint)
    mass, momentum = mass / units.mass[:, None, None, None], momentum / units.impulse[:, None, None]
    free = torch.linalg.solve(mass, momentum).flatten(1)
    rows = rows_of(patches, bodies, free, inputs, world, units)
    batch, modes = rows.modes.shape[0], rows.modes.shape[-1]
    problem = ContactProblem(
        mass=_block_diagonal(mass, rows.mode_mass),
        momentum=torch.cat([momentum.flatten(1) + rows.before_impact, mass.new_zeros(batch, modes)], 1),
        jacobian=torch.cat([rows.jacobian, rows.modes], 3),
        offset=rows.offset,
        slip=rows.slip,
        friction=rows.friction,
        compliance=rows.compliance,
        joint_jacobian=pad(joints[0], (0, modes)),
        joint_velocity=joints[1] / units.velocity[:, None],
    )
    return Formulation(problem, units, bodies, rows.share, rows.gap)


def _block_diagonal(bodies: Tensor, warp: Tensor) -> Tensor:
    """Put blocks (B, N, 6, 6) and one block (B, P, P) on a diagonal."""
    batch, count = bodies.shape[:2]
    blocks = [bodies[:, n] for n in range(count)] + [warp]
    sizes = [block.shape[-1] for block in blocks]
    rows = []
    for i, block in enumerate(blocks):
        rows.append(
            torch.cat([block if i == j else block.new_zeros(batch, sizes[i], n) for j, n in enumerate(sizes)], 2)
        )
    return torch.cat(rows, 1)
