"""Bodies that lie on the ground, with the sizes that were measured and with those that effects give them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from physid.physics import Effect, State, StepInputs
from physid.physics.rotations import exponential, multiply, normalize, to_matrix
from physid.physics.shapes.table import reach
from physid.scenes.scene import Scene
from physid.scenes.setup import LYING, REST_DEPTH

STEEP = 0.9
"""A ground whose normal has more than this along x takes its first tangent from y [-]."""


class Laid(NamedTuple):
    """Boxes laid on the ground.

    Attributes:
        pose: With the lowest face on the ground, shape (..., N, 7).
        lean: Angle by which they were turned for that [rad], shape (..., N).
        gap: Distance by which they were lowered [m], shape (..., N).
        height: Of the box as it lies [m], shape (..., N).
    """

    pose: Tensor
    lean: Tensor
    gap: Tensor
    height: Tensor


def ground_axes(normal: Tensor) -> Tensor:
    """Return two tangents of the ground and its normal as rows, shape (3, 3), from the normal (3,)."""
    axis = torch.eye(3, dtype=normal.dtype)[0 if abs(float(normal[0])) < STEEP else 1]
    first = axis - (axis @ normal) * normal
    first = first / first.norm()
    return torch.stack([first, torch.linalg.cross(normal, first), normal])


def turn_flat(attitude: Tensor, normal: Tensor) -> tuple[Tensor, Tensor]:
    """Turn boxes by the least angle that makes a face parallel to the ground.

    Args:
        attitude: Quaternions, shape (..., N, 4).
        normal: Of the ground, shape (3,).

    Returns:
        Quaternions (..., N, 4), and the angle [rad], shape (..., N).
    """
    matrix = to_matrix(attitude)
    along = normal @ matrix
    axis = along.abs().argmax(-1, keepdim=True)
    up = (matrix @ torch.zeros_like(along).scatter(-1, axis, along.gather(-1, axis).sign())[..., None])[..., 0]
    cross = torch.linalg.cross(up, normal.expand_as(up))
    sine = cross.norm(dim=-1)
    angle = torch.atan2(sine, (up * normal).sum(-1))
    turn = exponential(cross * (angle / sine.clamp_min(torch.finfo(attitude.dtype).tiny))[..., None])
    return normalize(multiply(turn, attitude)), angle


def face_heading(attitude: Tensor, tangents: Tensor) -> Tensor:
    """Return in which direction the upright faces of boxes that lie flat look, between -pi/4 and pi/4 [rad].

    A quarter of a turn changes nothing: of an axis of a box with the parts (x, y) along the tangents the angle is
    arg((x + i y)^4) / 4.

    Args:
        attitude: Quaternions, shape (..., 4).
        tangents: Two of the ground, shape (2, 3).

    Returns:
        Shape (...).
    """
    x, y = (tangents @ to_matrix(attitude)).unbind(-2)
    axis = (x.square() + y.square()).argmax(-1, keepdim=True)
    x, y = (part.gather(-1, axis)[..., 0] for part in (x, y))
    return quarter(torch.atan2(y, x))


def quarter(angle: Tensor) -> Tensor:
    """Bring an angle to between -pi/4 and pi/4 by quarters of a turn [rad]."""
    turn = math.pi / 2
    return angle - turn * (angle / turn).round()


def lay_down(pose: Tensor, scene: Scene) -> Laid:
    """Turn and lower boxes of poses (..., N, 7) so that their lowest face lies on the ground, as deep as at rest."""
    normal, size = pose.new_tensor(scene.ground.normal), pose.new_tensor(scene.sizes)
    attitude, lean = turn_flat(pose[..., 3:], normal)
    standing = (normal @ to_matrix(attitude)).abs().argmax(-1, keepdim=True)
    height = size.expand_as(attitude[..., :3]).gather(-1, standing)[..., 0]
    gap = pose[..., :3] @ normal - scene.ground.offset - height / 2
    position = pose[..., :3] - (gap + REST_DEPTH)[..., None] * normal
    return Laid(torch.cat([position, attitude], -1), lean, gap, height)


def touch_ground(state: State, measured: StepInputs) -> Tensor:
    """Return which bodies touch the ground with their lowest points, as far as sizes were measured, shape (B, N)."""
    normal = measured.ground_normal
    low = state.position @ normal - reach(measured.shapes, state.quaternion, measured.size, normal)
    return low - measured.ground_offset <= LYING


def raise_lying(state: State, lying: Tensor, measured: StepInputs, effects: Sequence[Effect]) -> Tensor:
    """Raise bodies that lie on the ground by as much as effects make them higher than they were measured.

    Initial states are laid on the ground with the sizes that were measured. A body that is larger lies higher: if its
    initial state did not follow its size, it would start in the ground and be pushed out of it. With r(s) how far a
    body of size s reaches from its centre along the ground's normal n, it starts at x + (r(s') - r(s)) n, a flat one
    higher by half of what it is larger. One in flight starts at the pose it is given, whatever its size.

    Args:
        state: B states, as the measured sizes lay them.
        lying: Which bodies lie on the ground, shape (B, N).
        measured: Inputs of the first step without effects.
        effects: What acts at the step, with parameters (1,) or (B,).

    Returns:
        Poses (B, N, 7); the very same where no effect changes a size.
    """
    now = measured
    for effect in effects:
        now = effect.act(state, now)
    if now.size is measured.size:
        return state.pose
    normal = measured.ground_normal
    before, after = (reach(measured.shapes, state.quaternion, size, normal) for size in (measured.size, now.size))
    pose = state.pose.clone()
    pose[..., :3] += ((after - before) * lying)[..., None] * normal
    return pose
