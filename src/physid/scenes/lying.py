"""Boxes that lie on the ground."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from physid.physics.rotations import exponential, multiply, normalize, to_matrix
from physid.scenes.scene import Scene
from physid.scenes.setup import REST_DEPTH


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


def lay_down(pose: Tensor, scene: Scene) -> Laid:
    """Turn and lower boxes of poses (..., N, 7) so that their lowest face lies on the ground, as deep as at rest."""
    normal, size = pose.new_tensor(scene.ground.normal), pose.new_tensor(scene.sizes)
    attitude, lean = turn_flat(pose[..., 3:], normal)
    standing = (normal @ to_matrix(attitude)).abs().argmax(-1, keepdim=True)
    height = size.expand_as(attitude[..., :3]).gather(-1, standing)[..., 0]
    gap = pose[..., :3] @ normal - scene.ground.offset - height / 2
    position = pose[..., :3] - (gap + REST_DEPTH)[..., None] * normal
    return Laid(torch.cat([position, attitude], -1), lean, gap, height)
