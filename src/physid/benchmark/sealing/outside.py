"""The third ring: effects that stand in no catalogue. The right answer to each is `unknown`."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.effects.actuation.force_delay import with_end
from physid.physics import Effect, Site, State, StepInputs, quantity

UP = (0.0, 0.0, 1.0)
GUST, SWAY = 0.5, 0.4  # [s] periods
WAVE = 0.25  # [m] wavelength of the washboard
HILL = 0.4  # [m] width of the hill
LEAST = 1e-12


def _across(vector: Tensor) -> Tensor:
    """Turn vectors (..., 3) by 90 degrees about the vertical, without their vertical part."""
    turned: Tensor = torch.linalg.cross(torch.tensor(UP, dtype=vector.dtype).expand_as(vector), vector)
    return turned


@final
@dataclass(frozen=True)
class SideForce(Effect):
    """F = c z x v: a force across the velocity, as on a charge in a magnetic field.

    Attributes:
        coefficient: c [N s/m].
    """

    name: ClassVar[str] = "side_force"
    site: ClassVar[Site] = "dynamics"
    coefficient: Tensor = quantity("N s/m", low=-5.0, high=5.0, typical=0.4)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Add the force."""
        return inputs.add_force(self.coefficient[:, None, None] * _across(state.velocity))


@final
@dataclass(frozen=True)
class Vortex(Effect):
    """F = k z x p: a force around the world's origin that no potential has.

    Attributes:
        stiffness: k [N/m].
    """

    name: ClassVar[str] = "vortex"
    site: ClassVar[Site] = "dynamics"
    stiffness: Tensor = quantity("N/m", low=-20.0, high=20.0, typical=0.8)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Add the force."""
        return inputs.add_force(self.stiffness[:, None, None] * _across(state.position))


@final
@dataclass(frozen=True)
class Gust(Effect):
    """F = A sin(2 pi t / 0.5 s) along the world's first axis.

    Attributes:
        force: A [N].
    """

    name: ClassVar[str] = "gust"
    site: ClassVar[Site] = "dynamics"
    force: Tensor = quantity("N", low=-10.0, high=10.0, typical=0.8)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Add the force."""
        size = self.force * (2 * pi * inputs.time / GUST).sin()
        push = torch.zeros_like(state.position)
        push[..., 0] = size[:, None]
        return inputs.add_force(push)


@final
@dataclass(frozen=True)
class Hill(Effect):
    """F = A (p / s) exp(-|p|^2 / (2 s^2)) in the plane, s = 0.4 m: a bump in the middle of the table.

    Attributes:
        force: A [N].
    """

    name: ClassVar[str] = "hill"
    site: ClassVar[Site] = "dynamics"
    force: Tensor = quantity("N", low=-20.0, high=20.0, typical=2.0)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Add the force."""
        flat = state.position * torch.tensor([1.0, 1.0, 0.0], dtype=state.position.dtype) / HILL
        bell = (-flat.square().sum(-1, keepdim=True) / 2).exp()
        return inputs.add_force(self.force[:, None, None] * flat * bell)


@final
@dataclass(frozen=True)
class Washboard(Effect):
    """mu' = mu (1 + a sin(2 pi x / 0.25 m)), at least 0, x along the world's first axis.

    Attributes:
        depth: a [-].
    """

    name: ClassVar[str] = "washboard"
    site: ClassVar[Site] = "contact"
    depth: Tensor = quantity("-", low=-1.0, high=1.0, typical=0.5)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Scale the friction of the ground."""
        wave = 1 + self.depth[:, None] * (2 * pi * state.position[..., 0] / WAVE).sin()
        return inputs.replace(ground_friction=inputs.ground_friction * wave.clamp_min(0))


@final
@dataclass(frozen=True)
class CommandSteps(Effect):
    """f' = q round(|f| / q) f / |f|: the actuator knows only multiples of q (as it is for q = 0).

    Attributes:
        quantum: q [N].
    """

    name: ClassVar[str] = "command_steps"
    site: ClassVar[Site] = "actuation"
    quantum: Tensor = quantity("N", low=0.0, high=20.0, typical=3.0)

    def actuate(self, wrench: Tensor, time: Tensor) -> Tensor:
        """Round the force."""
        if not bool(self.quantum.any()):
            return wrench
        force = wrench[..., 3:]
        size = force.norm(dim=-1, keepdim=True)
        quantum = self.quantum[:, None, None, None]
        return torch.cat([wrench[..., :3], quantum * (size / quantum).round() * force / size.clamp_min(LEAST)], -1)


@final
@dataclass(frozen=True)
class PropellerTorque(Effect):
    """tau' = tau + r |f| z: each push turns the body, whatever its direction.

    Attributes:
        arm: r [m].
    """

    name: ClassVar[str] = "propeller_torque"
    site: ClassVar[Site] = "actuation"
    arm: Tensor = quantity("m", low=-0.2, high=0.2, typical=0.02)

    def actuate(self, wrench: Tensor, time: Tensor) -> Tensor:
        """Add the torque."""
        torque = torch.zeros_like(wrench)
        torque[..., 2] = self.arm[:, None, None] * wrench[..., 3:].norm(dim=-1)
        return wrench + torque


@final
@dataclass(frozen=True)
class Fatigue(Effect):
    """w'(t) = w(t) / (1 + a int_0^t |f| ds): an actuator that tires by what it has done.

    Attributes:
        rate: a [1/(N s)].
    """

    name: ClassVar[str] = "fatigue"
    site: ClassVar[Site] = "actuation"
    rate: Tensor = quantity("1/(N s)", low=0.0, high=2.0, typical=0.1)

    def actuate(self, wrench: Tensor, time: Tensor) -> Tensor:
        """Weaken the wrench."""
        done = (wrench[..., 3:].norm(dim=-1) * with_end(time).diff(dim=1)[..., None]).cumsum(1)
        weak: Tensor = wrench / (1 + self.rate[:, None, None] * done)[..., None]
        return weak


@final
@dataclass(frozen=True)
class CameraSway(Effect):
    """p' = p + A sin(2 pi t / 0.4 s) along the world's first axis, for the reported position p.

    Attributes:
        sway: A [m].
    """

    name: ClassVar[str] = "camera_sway"
    site: ClassVar[Site] = "perception"
    sway: Tensor = quantity("m", low=-0.1, high=0.1, typical=0.003)

    def observe(self, pose: Tensor, time: Tensor) -> Tensor:
        """Shift the positions."""
        shift = torch.zeros_like(pose)
        shift[..., 0] = self.sway[:, None, None] * (2 * pi * time / SWAY).sin()[..., None]
        return pose + shift


@final
@dataclass(frozen=True)
class Keystone(Effect):
    """(x, y)' = (1 + k x) (x, y) for reported positions: a camera that does not look straight down.

    Attributes:
        slope: k [1/m].
    """

    name: ClassVar[str] = "keystone"
    site: ClassVar[Site] = "perception"
    slope: Tensor = quantity("1/m", low=-0.3, high=0.3, typical=0.02)

    def observe(self, pose: Tensor, time: Tensor) -> Tensor:
        """Distort the positions."""
        scale = 1 + self.slope[:, None, None] * pose[..., 0]
        return torch.cat([pose[..., :2] * scale[..., None], pose[..., 2:]], -1)


OUTSIDE: tuple[type[Effect], ...] = (
    SideForce,
    Vortex,
    Gust,
    Hill,
    Washboard,
    CommandSteps,
    PropellerTorque,
    Fatigue,
    CameraSway,
    Keystone,
)
