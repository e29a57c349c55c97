"""States and parameters that several tests of the physics start from."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.physics import Parameters, State

DTYPE = torch.float64


def boxes(
    mass: float | list[float] = 1.0, friction: float = 0.3, restitution: float = 0.0, size: float = 0.2
) -> Parameters:
    """Return cubes of one size, in a batch of one."""
    masses = torch.tensor([[mass] if isinstance(mass, float) else mass], dtype=DTYPE)
    one = torch.ones_like(masses)
    return Parameters.of_boxes(size * one[..., None].expand(-1, -1, 3), masses, friction * one, restitution * one)


def state(
    position: list[list[float]], velocity: list[list[float]] | None = None, spin: list[list[float]] | None = None
) -> State:
    """Return upright bodies in a batch of one."""
    place = torch.tensor([position], dtype=DTYPE)
    upright = torch.tensor([0, 0, 0, 1.0], dtype=DTYPE).expand(*place.shape[:2], 4)
    linear = torch.zeros_like(place) if velocity is None else torch.tensor([velocity], dtype=DTYPE)
    angular = torch.zeros_like(place) if spin is None else torch.tensor([spin], dtype=DTYPE)
    return State.checked(torch.cat([place, upright], -1), torch.cat([angular, linear], -1))


def forces(steps: int, force: list[list[float]]) -> Tensor:
    """Return wrenches (1, T, N, 6) with the same force in each step."""
    wrench = torch.zeros(1, steps, len(force), 6, dtype=DTYPE)
    wrench[..., 3:] = torch.tensor(force, dtype=DTYPE)
    return wrench


def repeat(value: State, count: int) -> State:
    """Return the same state in every world of a batch."""
    return State(value.pose.expand(count, -1, -1), value.twist.expand(count, -1, -1))
