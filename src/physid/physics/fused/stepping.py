"""The compiled step in place of that of torch, with gradients: for effects that ask for the state."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.effect import StepInputs
from physid.physics.fused.packing import Inputs, memory_size, stepwise
from physid.physics.fused.rollout import roll
from physid.physics.state import State
from physid.physics.step import Step
from physid.physics.world import World


class Stepper:
    """Steps one after the other; each solution is the start of the next, which changes results by rounding only."""

    def __init__(self, world: World, settings: SolverSettings) -> None:
        self._world = stepwise(world)
        self._settings = settings
        self._memory: Tensor | None = None

    def __call__(self, state: State, inputs: StepInputs, step: Tensor | None = None) -> Step:
        """Do as `physid.physics.step.advance`, with a `Cone`, without joints, on the CPU in float64."""
        size = memory_size(self._world, state.pose)
        if self._memory is None or self._memory.numel() != size:
            self._memory = torch.zeros(size, dtype=torch.float64)
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
