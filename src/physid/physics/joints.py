"""Equality joints: motions that a body may not make, J_e v = b_e in eq. (3) of the paper."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor

from physid.physics.rotations import logarithm, rotate
from physid.physics.state import State

Vector = tuple[float, float, float]


class Joint(ABC):
    """Holds a body to the world. The error is removed within one step: b_e = -error / h."""

    body: int

    @abstractmethod
    def rows(self, state: State) -> tuple[Tensor, Tensor]:
        """Return the rows for the twist of the body (B, k, 6) and the error that they reduce (B, k)."""

    def equations(self, state: State, step: Tensor) -> tuple[Tensor, Tensor]:
        """Return J_e (B, k, 6 N) and b_e (B, k) for steps of so many seconds, shape (B or 1, 1)."""
        rows, error = self.rows(state)
        batch, bodies = state.pose.shape[:2]
        blocks = [rows if n == self.body else rows.new_zeros(batch, rows.shape[1], 6) for n in range(bodies)]
        return torch.cat(blocks, 2), -error / step


def equations_of(
    joints: tuple[Joint, ...], state: State, before: State, step: Tensor, *, midpoint: bool
) -> tuple[Tensor, Tensor]:
    """Return J_e (B, E, 6 N) and b_e (B, E) [rad/s, m/s] of all joints.

    At the midpoint of a step b is demanded of the velocity at its end, which the turning of the rows along the step
    changes by k = J v - J_0 v_0, as much again as up to there (see `schemes.impact`): b = -error / h - 3 k / 4.

    Args:
        joints: The joints.
        state: Where forces act, at the beginning of a step or at its midpoint.
        before: At the beginning.
        step: h [s], shape (B or 1, 1).
        midpoint: Whether `state` is at the midpoint.
    """
    batch, bodies = state.pose.shape[:2]
    rows, wanted = [state.pose.new_zeros(batch, 0, 6 * bodies)], [state.pose.new_zeros(batch, 0)]
    for joint in joints:
        jacobian, velocity = joint.equations(state, step)
        if midpoint:
            first, _ = joint.equations(before, step)
            turning = (jacobian @ state.twist.flatten(1)[..., None] - first @ before.twist.flatten(1)[..., None])[
                ..., 0
            ]
            velocity = velocity - 0.75 * turning
        rows.append(jacobian)
        wanted.append(velocity)
    return torch.cat(rows, 1), torch.cat(wanted, 1)


def _at_point(state: State, body: int, local: Vector, world: Vector) -> tuple[Tensor, Tensor]:
    """Return the rows and the error that hold a point of the body to a point of the world."""
    arm = rotate(state.quaternion[:, body], state.pose.new_tensor(local))
    axes = torch.eye(3, dtype=arm.dtype, device=arm.device).expand(arm.shape[0], 3, 3)
    turning = torch.linalg.cross(arm[:, None].expand(-1, 3, -1), axes)
    return torch.cat([turning, axes], 2), state.position[:, body] + arm - state.pose.new_tensor(world)


def _no_turning(state: State, body: int) -> tuple[Tensor, Tensor]:
    """Return the rows and the error that keep the axes of the body parallel to the world's."""
    axes = torch.eye(3, dtype=state.pose.dtype, device=state.pose.device).expand(state.pose.shape[0], 3, 3)
    return torch.cat([axes, torch.zeros_like(axes)], 2), logarithm(state.quaternion[:, body])


def _across(state: State, axis: Vector) -> Tensor:
    """Return two unit vectors across `axis`, shape (2, 3)."""
    direction = state.pose.new_tensor(axis)
    if not float(direction.norm()) > 0:
        raise ValueError(f"axis must not be zero, got {axis}")
    across: Tensor = torch.linalg.svd(direction[None])[2][1:]
    return across


@final
@dataclass(frozen=True)
class Point(Joint):
    """A ball joint: the point `local` of the body stays at the point `world` [m]."""

    body: int
    local: Vector
    world: Vector

    def rows(self, state: State) -> tuple[Tensor, Tensor]:
        """Return three rows (see `Joint.rows`)."""
        return _at_point(state, self.body, self.local, self.world)


@final
@dataclass(frozen=True)
class Fixed(Joint):
    """A weld: the centre of the body stays at `world` [m], its axes parallel to the world's."""

    body: int
    world: Vector

    def rows(self, state: State) -> tuple[Tensor, Tensor]:
        """Return six rows (see `Joint.rows`)."""
        point, turn = _at_point(state, self.body, (0, 0, 0), self.world), _no_turning(state, self.body)
        return torch.cat([point[0], turn[0]], 1), torch.cat([point[1], turn[1]], 1)


@final
@dataclass(frozen=True)
class Axis(Joint):
    """A hinge: the point `local` stays at `world` [m]; the body turns about `axis` only, the same in both frames."""

    body: int
    local: Vector
    world: Vector
    axis: Vector

    def rows(self, state: State) -> tuple[Tensor, Tensor]:
        """Return five rows (see `Joint.rows`)."""
        point, turn = _at_point(state, self.body, self.local, self.world), _no_turning(state, self.body)
        across = _across(state, self.axis)
        error = torch.linalg.cross(state.pose.new_tensor(self.axis).expand(turn[1].shape), self._turned(state))
        return torch.cat([point[0], across @ turn[0]], 1), torch.cat([point[1], error @ across.mT], 1)

    def _turned(self, state: State) -> Tensor:
        return rotate(state.quaternion[:, self.body], state.pose.new_tensor(self.axis))


@final
@dataclass(frozen=True)
class Slider(Joint):
    """A rail: the centre of the body moves along `axis` through `world` [m], its axes parallel to the world's."""

    body: int
    world: Vector
    axis: Vector

    def rows(self, state: State) -> tuple[Tensor, Tensor]:
        """Return five rows (see `Joint.rows`)."""
        point, turn = _at_point(state, self.body, (0, 0, 0), self.world), _no_turning(state, self.body)
        across = _across(state, self.axis)
        return torch.cat([across @ point[0], turn[0]], 1), torch.cat([point[1] @ across.mT, turn[1]], 1)
