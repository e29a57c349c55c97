"""Compiled steps, one after the other, in arrays that stay where they are: what effects that ask for the state need."""

from __future__ import annotations

import torch

from physid.physics.case import Case, Outcome
from physid.physics.effect import StepInputs
from physid.physics.fused.formulas.layouts import BODY, OF_BODY, OF_WORLD, SHARED
from physid.physics.fused.packing import Inputs, by_group, constants_of, memory_size, shape_of, stepwise
from physid.physics.fused.rollout import by_frame
from physid.physics.fused.run import bind
from physid.physics.state import State

LOOK = 16  # steps after which to see whether all is well


def roll_in_steps(case: Case) -> Outcome:
    """Predict trajectories under effects that ask for the state, without gradients.

    The same as steps of a `Stepper`, without what each of them costs beside the effects and the kernel: arrays are
    made once, the kernel writes where results stay, and of the inputs only what effects have changed is written.
    """
    going = _Going(case)
    accepted = case.solver.residual(torch.float64)
    for step in range(case.frames * case.world.substeps):
        going.advance(step, case.inputs_at(step, going.state(step)))
        if step % LOOK == LOOK - 1 and not bool((going.residual[:, step + 1 - LOOK : step + 1] <= accepted).all()):
            break  # what has failed is slow, and its caller refuses it
    return by_frame(going.outcome(), case.world.substeps)


class _Going:
    """Trajectories of a batch of worlds that grow by one step at a time, in arrays that stay where they are.

    Attributes:
        residual: Of each step, zero of those to come, shape (B, T).
    """

    def __init__(self, case: Case) -> None:
        state, world, uneven = case.state, stepwise(case.world), case.grid.uneven
        (worlds, bodies), steps = state.pose.shape[:2], case.frames * case.world.substeps
        lengths = None if case.lengths is None else case.lengths * case.world.substeps
        shape, new = shape_of(world, bodies), state.pose.new_zeros
        packed = Inputs.of(case.inputs)
        self._bodies, self._shared = packed.bodies.contiguous(), packed.shared.contiguous()
        self._wrench, self._known = new(worlds, steps, bodies, 6), case.inputs
        self._pose, self._twist = new(worlds, steps + 1, bodies, 7), new(worlds, steps + 1, bodies, 6)
        self._pose[:, 0], self._twist[:, 0] = state.pose, state.twist
        self._impulse = new(worlds, steps, 4 * shape.patches, 3)
        self.residual, self._newton_steps = new(worlds, steps), new(worlds, steps)
        self._arrays = {
            "inputs": self._bodies, "shared": self._shared, "wrench": self._wrench,
            "constants": constants_of(world, case.solver, shape), "memory": new(memory_size(world, state.pose)),
            "lengths": by_group(lengths, worlds, steps), "pose": self._pose, "twist": self._twist,
            "impulse": self._impulse, "residual": self.residual, "newton_steps": self._newton_steps,
        }  # fmt: skip
        numbers = {"worlds": worlds, "frames": steps, "substeps": 1}
        numbers |= {"inputs_by_world": self._bodies[0].numel(), "shared_by_world": self._shared[0].numel()}
        if uneven is not None:
            self._arrays["steps"] = uneven.contiguous()
            numbers["steps_by_world"] = steps * (uneven.shape[0] > 1)
        self._tau = case.solver.tau(torch.float64)
        self._kernel = bind("forward", shape, worlds, numbers, self._arrays, frames=1)

    def state(self, step: int) -> State:
        """Return the states before a step."""
        return State(self._pose[:, step], self._twist[:, step])

    def advance(self, step: int, inputs: StepInputs) -> None:
        """Go on by one step."""
        self._write(inputs)
        self._wrench[:, step] = inputs.wrench
        self._kernel(step)

    def outcome(self) -> Outcome:
        """Return what `roll` returns."""
        return self._pose, self._twist, self._impulse, self.residual / self._tau, self._newton_steps

    def _write(self, inputs: StepInputs) -> None:
        """Write the inputs that are not those of the last step."""
        for names, layout, array in ((OF_BODY, BODY, self._bodies), (OF_WORLD, SHARED, self._shared)):
            for name, width in names.items():
                if (value := getattr(inputs, name)) is not getattr(self._known, name):
                    start = layout.offsets[name]
                    array[:, 0, ..., start : start + width] = value if width > 1 else value[..., None]
        self._known = inputs
