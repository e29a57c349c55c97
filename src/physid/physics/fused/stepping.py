"""The compiled step, one after the other: what effects that ask for the state need."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physid.compiler.emit import LANES
from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.effect import Effect, StepInputs
from physid.physics.fused.formulas.layouts import BODY, OF_BODY, OF_WORLD, SHARED
from physid.physics.fused.rollout import Inputs, Outcome, by_frame, by_group, constants_of, roll, shape_of, stepwise
from physid.physics.fused.run import bind
from physid.physics.schemes.grid import TimeGrid
from physid.physics.schemes.motion import acting
from physid.physics.state import State
from physid.physics.step import Step
from physid.physics.world import World

LOOK = 16  # steps after which to see whether all is well


class Stepper:
    """Steps one after the other; each solution is the start of the next, which changes results by rounding only."""

    def __init__(self, world: World, settings: SolverSettings) -> None:
        self._world = stepwise(world)
        self._settings = settings
        self._memory: Tensor | None = None

    def __call__(self, state: State, inputs: StepInputs, step: Tensor | None = None) -> Step:
        """Do as `physid.physics.step.advance`, with a `Cone`, without joints, on the CPU in float64."""
        if self._memory is None or self._memory.numel() != _memory_size(self._world, state):
            self._memory = torch.zeros(_memory_size(self._world, state), dtype=torch.float64)
        wrenches = inputs.wrench[:, None]
        uneven = None if step is None or bool((step == self._world.step).all()) else step[:, None]
        outcome = roll(state, Inputs.of(inputs), wrenches, self._world, self._settings, self._memory, steps=uneven)
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
    grid: TimeGrid,
    lengths: Tensor | None = None,
) -> Outcome:
    """Predict trajectories under effects that ask for the state, without gradients.

    The same as steps of a `Stepper`, without what each of them costs beside the effects and the kernel: arrays are
    made once, the kernel writes where results stay, and of the inputs only what effects have changed is written.

    Args:
        state: The states at the first frame.
        inputs: Nominal inputs of the first step.
        wrenches: Shape (B, T, N, 6).
        effects: Those of the layer.
        world: Ground and rules.
        settings: Accuracy of the solver.
        grid: When the steps begin, and how long they last.
        lengths: See `roll`.

    Returns:
        As `roll`.
    """
    substeps, steps = world.substeps, wrenches.shape[1] * world.substeps
    wanted = None if lengths is None else lengths * substeps
    going = _Going(state, inputs, steps, stepwise(world), settings, wanted, grid.uneven)
    accepted, time = settings.residual(torch.float64), grid.time
    for step in range(steps):
        now = inputs.replace(time=inputs.time + time[:, step], wrench=wrenches[:, step // substeps])
        here = acting(going.state(step), grid.until_forces(step))
        for effect in effects:
            now = effect.act(here, now)
        going.advance(step, now)
        if step % LOOK == LOOK - 1 and not bool((going.residual[:, step + 1 - LOOK : step + 1] <= accepted).all()):
            break  # what has failed is slow, and its caller refuses it
    return by_frame(going.outcome(settings), substeps)


class _Going:
    """Trajectories of a batch of worlds that grow by one step at a time, in arrays that stay where they are.

    Attributes:
        residual: Of each step, zero of those to come, shape (B, T).
    """

    def __init__(
        self,
        state: State,
        inputs: StepInputs,
        steps: int,
        world: World,
        settings: SolverSettings,
        lengths: Tensor | None,
        uneven: Tensor | None,
    ) -> None:
        worlds, bodies = state.pose.shape[:2]
        shape, new = shape_of(world, bodies), state.pose.new_zeros
        packed = Inputs.of(inputs)
        self._bodies, self._shared = packed.bodies.contiguous(), packed.shared.contiguous()
        self._wrench, self._known = new(worlds, steps, bodies, 6), inputs
        self._pose, self._twist = new(worlds, steps + 1, bodies, 7), new(worlds, steps + 1, bodies, 6)
        self._pose[:, 0], self._twist[:, 0] = state.pose, state.twist
        self._impulse = new(worlds, steps, 4 * shape.patches, 3)
        self.residual, self._newton_steps = new(worlds, steps), new(worlds, steps)
        self._arrays = {
            "inputs": self._bodies, "shared": self._shared, "wrench": self._wrench,
            "constants": constants_of(world, settings, shape), "memory": new(_memory_size(world, state)),
            "lengths": by_group(lengths, worlds, steps), "pose": self._pose, "twist": self._twist,
            "impulse": self._impulse, "residual": self.residual, "newton_steps": self._newton_steps,
        }  # fmt: skip
        numbers = {"worlds": worlds, "frames": steps, "substeps": 1}
        numbers |= {"inputs_by_world": self._bodies[0].numel(), "shared_by_world": self._shared[0].numel()}
        if uneven is not None:
            self._arrays["steps"] = uneven.contiguous()
            numbers["steps_by_world"] = steps * (uneven.shape[0] > 1)
        self._kernel = bind("forward", shape, worlds, numbers, self._arrays, frames=1)

    def state(self, step: int) -> State:
        """Return the states before a step."""
        return State(self._pose[:, step], self._twist[:, step])

    def advance(self, step: int, inputs: StepInputs) -> None:
        """Go on by one step."""
        self._write(inputs)
        self._wrench[:, step] = inputs.wrench
        self._kernel(step)

    def outcome(self, settings: SolverSettings) -> Outcome:
        """Return what `roll` returns."""
        residual = self.residual / settings.tau(torch.float64)
        return self._pose, self._twist, self._impulse, residual, self._newton_steps

    def _write(self, inputs: StepInputs) -> None:
        """Write the inputs that are not those of the last step."""
        for names, layout, array in ((OF_BODY, BODY, self._bodies), (OF_WORLD, SHARED, self._shared)):
            for name, width in names.items():
                if (value := getattr(inputs, name)) is not getattr(self._known, name):
                    start = layout.offsets[name]
                    array[:, 0, ..., start : start + width] = value if width > 1 else value[..., None]
        self._known = inputs
