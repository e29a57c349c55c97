"""The compiled step, one after the other: what effects that ask for the state need."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import accumulate, pairwise

import torch
from torch import Tensor

from physid.physics.effect import Effect, StepInputs
from physid.physics.fused.compiler.emit import LANES
from physid.physics.fused.formulas.layouts import BODY
from physid.physics.fused.formulas.layouts import INPUTS as FIELDS
from physid.physics.fused.rollout import Inputs, Outcome, constants_of, roll, shape_of
from physid.physics.fused.run import bind
from physid.physics.lcp import SolverSettings
from physid.physics.state import State
from physid.physics.step import Step
from physid.physics.world import World

PLACES = list(accumulate((BODY.widths[name] for name in FIELDS), initial=0))
LOOK = 16  # frames after which to see whether all is well
FRAME = 1  # the pose after a step, in a table of the poses before and after it


class Stepper:
    """Steps one after the other; each solution is the start of the next, which changes results by rounding only."""

    def __init__(self, world: World, settings: SolverSettings) -> None:
        self._world = dataclasses.replace(world, time_step=world.step, substeps=1)
        self._settings = settings
        self._memory: Tensor | None = None

    def __call__(self, state: State, inputs: StepInputs) -> Step:
        """Do as `physid.physics.step.advance`, with a `Cone`, without joints, on the CPU in float64."""
        if self._memory is None or self._memory.numel() != _memory_size(self._world, state):
            self._memory = torch.zeros(_memory_size(self._world, state), dtype=torch.float64)
        wrenches = inputs.wrench[:, None]
        outcome = roll(state, Inputs.of(inputs), wrenches, self._world, self._settings, self._memory)
        pose, twist, impulse, residual, steps = (value.squeeze(1) for value in outcome)
        return Step(
            state=State(pose[:, 1], twist[:, 1]),
            impulse=impulse,
            residual=residual,
            newton_steps=steps.long(),
            converged=residual <= self._settings.residual(torch.float64) / self._settings.tau(torch.float64),
        )


def _memory_size(world: World, state: State) -> int:
    worlds, bodies = state.pose.shape[:2]
    return -(-worlds // LANES) * shape_of(world, bodies).memory * LANES


def roll_in_steps(
    state: State,
    inputs: StepInputs,
    wrenches: Tensor,
    effects: Sequence[Effect],
    world: World,
    settings: SolverSettings,
) -> Outcome:
    """Predict trajectories under effects that ask for the state, without gradients.

    The same as steps of a `Stepper`, without what each of them costs beside the effects and the kernel: arrays are
    made once, and of the inputs only what effects have changed is written.

    Args:
        state: The states at the first frame.
        inputs: Nominal inputs of the first step.
        wrenches: Shape (B, T, N, 6).
        effects: Those of the layer.
        world: Ground and rules.
        settings: Accuracy of the solver.

    Returns:
        As `roll`.
    """
    (worlds, frames), bodies = wrenches.shape[:2], wrenches.shape[2]
    pose, twist = (
        state.pose.new_empty(worlds, frames + 1, bodies, 7),
        state.pose.new_empty(worlds, frames + 1, bodies, 6),
    )
    one = _One(state, inputs, dataclasses.replace(world, time_step=world.step, substeps=1), settings)
    impulse = state.pose.new_zeros(worlds, frames, *one.impulse.shape[2:])
    residual, count = state.pose.new_zeros(worlds, frames), state.pose.new_zeros(worlds, frames)
    pose[:, 0], twist[:, 0] = state.pose, state.twist
    accepted = settings.residual(torch.float64)
    for t in range(frames):
        for k in range(world.substeps):
            time = inputs.time + t * world.time_step + k * world.step
            now = inputs.replace(time=time, wrench=wrenches[:, t])
            for effect in effects:
                now = effect.act(one.state, now)
            one.advance(now)
            impulse[:, t] += one.impulse[:, 0]
            residual[:, t] = residual[:, t].maximum(one.residual[:, 0]) if world.substeps > 1 else one.residual[:, 0]
        count[:, t] = one.newton_steps[:, 0]
        pose[:, t + 1], twist[:, t + 1] = one.state.pose, one.state.twist
        if t % LOOK == LOOK - 1 and not bool((residual[:, t] <= accepted).all()):
            break  # what has failed is slow, and its caller refuses it
    return pose, twist, impulse, residual / settings.tau(torch.float64), count


class _One:
    """One step of a batch of worlds, in arrays that stay where they are.

    Attributes:
        state: The present state.
        impulse: Of the last step [N s], shape (B, 1, C, 3).
        residual: Of the last step, shape (B, 1).
        newton_steps: Of the last step, shape (B, 1).
    """

    def __init__(self, state: State, inputs: StepInputs, world: World, settings: SolverSettings) -> None:
        worlds, bodies = state.pose.shape[:2]
        shape, new = shape_of(world, bodies), state.pose.new_zeros
        packed = Inputs.of(inputs)
        self._bodies, self._shared = packed.bodies.contiguous(), packed.shared.contiguous()
        self._wrench, self._known = new(worlds, 1, bodies, 6), inputs
        self._pose, self._twist = new(worlds, 2, bodies, 7), new(worlds, 2, bodies, 6)
        self._pose[:, FRAME], self._twist[:, FRAME] = state.pose, state.twist
        self.state = State(self._pose[:, FRAME], self._twist[:, FRAME])
        self.impulse = new(worlds, 1, 4 * shape.patches, 3)
        self.residual, self.newton_steps = new(worlds, 1), new(worlds, 1)
        self._arrays = {
            "inputs": self._bodies, "shared": self._shared, "wrench": self._wrench,
            "constants": constants_of(world, settings, shape), "memory": new(_memory_size(world, state)),
            "pose": self._pose, "twist": self._twist, "impulse": self.impulse,
            "residual": self.residual, "newton_steps": self.newton_steps,
        }  # fmt: skip
        numbers = {"worlds": worlds, "frames": 1, "substeps": 1}
        numbers |= {"inputs_by_world": self._bodies[0].numel(), "shared_by_world": self._shared[0].numel()}
        self._kernel = bind("forward", shape, worlds, numbers, self._arrays)

    def advance(self, inputs: StepInputs) -> None:
        """Go on by one step."""
        self._write(inputs)
        self._wrench[:, 0] = inputs.wrench
        self._pose[:, 0], self._twist[:, 0] = self._pose[:, FRAME], self._twist[:, FRAME]
        self._kernel()

    def _write(self, inputs: StepInputs) -> None:
        """Write the inputs that are not those of the last step."""
        for name, (start, stop) in zip(FIELDS, pairwise(PLACES), strict=True):
            if (value := getattr(inputs, name)) is not getattr(self._known, name):
                self._bodies[:, 0, :, start:stop] = value if value.ndim == 3 else value[..., None]
        if inputs.ground_normal is not self._known.ground_normal:
            self._shared[:, 0, :3] = inputs.ground_normal
        for column, name in ((3, "ground_offset"), (4, "body_friction"), (5, "body_restitution")):
            if (value := getattr(inputs, name)) is not getattr(self._known, name):
                self._shared[:, 0, column] = value
        self._known = inputs
