"""Directions of a motion, and functions of one variable of it, of which measured laws are made."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from physid.physics.rotations import to_matrix

SHORTEST = 1e-12
"""Length below which a vector counts as zero in any unit: its direction would have no derivative."""


def unit(vector: Tensor, still: float = 0.0) -> Tensor:
    """Return vectors (..., 3) with length one; zero stays zero, as does what is not longer than `still`."""
    length = vector.norm(dim=-1, keepdim=True)
    return torch.where(length > still, vector / length.clamp_min(max(still, SHORTEST)), 0 * vector)


def across(vector: Tensor, up: Tensor, still: float = 0.0) -> Tensor:
    """Return unit vectors to the left of others (..., 3), seen with `up` (3,) towards the eye; see `unit`."""
    left = unit(torch.linalg.cross(up.expand_as(vector), vector))
    return torch.where(vector.norm(dim=-1, keepdim=True) > still, left, 0 * left)


def from_origin(position: Tensor, up: Tensor) -> Tensor:
    """Return the way from the origin along the ground [m], p - (p . u) u, shape (..., 3)."""
    return position - (position @ up)[..., None] * up


def course(velocity: Tensor, ground: Tensor) -> Tensor:
    """Return the angle of velocities (..., 3) from the first axis of the ground, whose axes are rows (3, 3) [deg]."""
    along = velocity @ ground.T
    return torch.rad2deg(torch.atan2(along[..., 1], along[..., 0]))


def course_from_body(quaternion: Tensor, velocity: Tensor, ground: Tensor) -> Tensor:
    """Return the angle of velocities from the first edge of each body [deg], -180 to 180, shape (...)."""
    apart = course(velocity, ground) - course(to_matrix(quaternion)[..., 0], ground)
    return torch.rad2deg(torch.remainder(torch.deg2rad(apart) + math.pi, 2 * math.pi) - math.pi)


def piecewise(value: Tensor, at: Sequence[float], size: Sequence[float]) -> Tensor:
    """Return a piecewise linear function of values (...), which has the sizes (B,) at the values (B,).

    Beyond the ends it goes on straight, for as far again as they reach, and is constant from there. Of one size alone
    it is constant.
    """
    found, reach = torch.full_like(value, size[0]), at[-1] - at[0]
    for k in range(len(at) - 1):
        low = at[k] - (reach if k == 0 else 0.0)
        high = at[k + 1] + (reach if k == len(at) - 2 else 0.0)
        slope = (size[k + 1] - size[k]) / (at[k + 1] - at[k])
        found = found + slope * (value.clamp(low, high) - at[k])
    return found
