"""Inputs in which every effect shows."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.physics import Effect, State, StepInputs
from physid.physics.rotations import exponential
from physid.physics.shapes.box import Box

TIME_STEP = 1 / 240


@dataclass(frozen=True)
class Probe:
    """A wrench sequence, a step and a pose sequence of two moving bodies, the first of them on the ground.

    Attributes:
        wrench: Commanded torques and forces, shape (B, T, N, 6).
        state: A state, batch B.
        inputs: Inputs of a step, batch B.
        pose: Poses, shape (B, T, N, 7).
    """

    wrench: Tensor
    state: State
    inputs: StepInputs
    pose: Tensor

    @property
    def time(self) -> Tensor:
        """Times of the frames [s], shape (1, T)."""
        return TIME_STEP * torch.arange(self.pose.shape[1], dtype=torch.float64)[None]

    def only(self, sample: int) -> Probe:
        """Return one sample as a batch of one."""
        one = slice(sample, sample + 1)
        chosen = {name: value[one] for name, value in self.inputs.tensors(but=("ground",)).items()}
        state = State(self.state.pose[one], self.state.twist[one])
        return Probe(self.wrench[one], state, self.inputs.replace(**chosen), self.pose[one])

    def show(self, effect: Effect) -> dict[str, Tensor]:
        """Return what the hooks of an effect give, by name: `actuate`, `observe`, and the inputs after `act`."""
        shown = effect.act(self.state, self.inputs).tensors()
        shown["actuate"] = effect.actuate(self.wrench, self.time)
        shown["observe"] = effect.observe(self.pose, self.time)
        return shown

    def untouched(self) -> dict[str, Tensor]:
        """Return what an effect that does nothing gives (see `show`)."""
        return self.inputs.tensors() | {"actuate": self.wrench, "observe": self.pose}


def draw_probe(batch: int = 3, frames: int = 8) -> Probe:
    """Draw a probe of so many samples and frames; always the same."""
    source, bodies = torch.Generator().manual_seed(4), 2

    def values(*shape: int, low: float = -1.0, high: float = 1.0) -> Tensor:
        return low + (high - low) * torch.rand(*shape, generator=source, dtype=torch.float64)

    size = values(batch, bodies, 3, low=0.2, high=0.3)
    place, turn = values(batch, bodies, 3, low=0.4, high=0.8), values(batch, bodies, 3)
    place[:, 0, 2], turn[:, 0, :2] = size[:, 0, 2] / 2, 0.0
    state = State(torch.cat([place, exponential(turn)], -1), values(batch, bodies, 6))
    time = TIME_STEP * torch.arange(frames, dtype=torch.float64)[:, None, None]
    motion = time * values(batch, 1, bodies, 6)
    wrench, mass = 5 * values(batch, frames, bodies, 6), values(batch, bodies, low=1.0, high=2.0)
    drawn = {
        "time": values(batch, low=0.3, high=0.9),
        "wrench": wrench[:, 0],
        "gravity": mass.new_tensor([0.0, 0.0, -9.81]).expand(batch, bodies, 3),
        "size": size,
        "mass": mass,
        "inertia": Box().inertia(mass, size),
        "friction": values(batch, bodies, low=0.1, high=0.4),
        "restitution": values(batch, bodies, low=0.1, high=0.4),
        "ground_normal": mass.new_tensor([0.0, 0.0, 1.0]),
    }
    inputs = StepInputs.nominal(state.pose, drawn)
    motion = motion + time**2 * values(batch, 1, bodies, 6, low=-40.0, high=40.0)
    pose = torch.cat([place[:, None] + motion[..., 3:], exponential(turn[:, None] + motion[..., :3])], -1)
    return Probe(wrench, state, inputs, pose)
