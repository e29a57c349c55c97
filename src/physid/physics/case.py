"""What a rollout computes, as both engines are given it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from torch import Tensor

from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.effect import Effect, StepInputs
from physid.physics.parameters import Parameters
from physid.physics.schemes.grid import TimeGrid
from physid.physics.schemes.motion import acting
from physid.physics.state import State
from physid.physics.world import World

Outcome = tuple[Tensor, Tensor, Tensor, Tensor, Tensor]
"""Poses (B, T + 1, N, 7), twists (B, T + 1, N, 6), impulses (B, T, C, 3) [N s], residual and Newton steps (B, T)."""


@dataclass(frozen=True)
class Case:
    """Worlds to roll out, checked, and of one type on one device.

    Attributes:
        state: The states at the first frame.
        inputs: Nominal inputs of the first step.
        wrenches: Torque [N m] and force [N] that act, held over a frame; shape (B, T, N, 6).
        effects: Those of the layer, in this order.
        world: Ground, joints and rules.
        solver: Accuracy of the contact solver.
        grid: When the steps begin, and how long they last.
        lengths: Frames that each world needs, shape (B,); None for all. What comes later has no meaning.
    """

    state: State
    inputs: StepInputs
    wrenches: Tensor
    effects: Sequence[Effect]
    world: World
    solver: SolverSettings
    grid: TimeGrid
    lengths: Tensor | None = None

    @property
    def frames(self) -> int:
        """Number of frames T after the first."""
        return self.wrenches.shape[1]

    def inputs_at(self, step: int, state: State) -> StepInputs:
        """Return what acts in a step of the engine that begins in some state, with all effects."""
        wrench = self.wrenches[:, step // self.world.substeps]
        now = self.inputs.replace(time=self.inputs.time + self.grid.time[:, step], wrench=wrench)
        here = acting(state, self.grid.until_forces(step)) if self.effects else state
        for effect in self.effects:
            now = effect.act(here, now)
        return now


def nominal_inputs(state: State, wrenches: Tensor, parameters: Parameters, world: World) -> StepInputs:
    """Build the inputs of a step without any effect, at time 0 and with the first of the wrenches (B, T, N, 6)."""
    of_bodies = {name: getattr(parameters, name) for name in ("size", "mass", "inertia", "friction", "restitution")}
    new, bodies = state.pose.new_tensor, state.pose.shape[1]
    surroundings = {
        "wrench": wrenches[:, 0],
        "gravity": new(world.gravity).expand(1, bodies, 3),
        "ground_normal": new(world.ground.normal if world.ground else (0.0, 0.0, 1.0)),
        "ground_offset": new(world.ground.offset if world.ground else -math.inf),
    }
    return StepInputs.nominal(state.pose, of_bodies | surroundings, world.shapes)
