"""Rotations as unit quaternions x y z w, with gradients that stay finite everywhere."""

from __future__ import annotations

import torch
from torch import Tensor


def _sine_ratio(half_square: Tensor) -> Tensor:
    """Compute sin(a) / a from a^2, smooth at 0 (a series where a^2 < 1e-3: its error there is below 1e-18)."""
    small = half_square < 1e-3
    safe = torch.where(small, torch.ones_like(half_square), half_square).sqrt()
    x = half_square
    series = 1 - x / 6 * (1 - x / 20 * (1 - x / 42 * (1 - x / 72)))
    return torch.where(small, series, torch.sin(safe) / safe)


def multiply(left: Tensor, right: Tensor) -> Tensor:
    """Compose rotations: the Hamilton product left * right, shapes (..., 4)."""
    lx, ly, lz, lw = left.unbind(-1)
    rx, ry, rz, rw = right.unbind(-1)
    return torch.stack(
        [
            lw * rx + lx * rw + ly * rz - lz * ry,
            lw * ry - lx * rz + ly * rw + lz * rx,
            lw * rz + lx * ry - ly * rx + lz * rw,
            lw * rw - lx * rx - ly * ry - lz * rz,
        ],
        dim=-1,
    )


def conjugate(quaternion: Tensor) -> Tensor:
    """Invert a rotation; shape (..., 4)."""
    return quaternion * quaternion.new_tensor([-1.0, -1.0, -1.0, 1.0])


def normalize(quaternion: Tensor) -> Tensor:
    """Scale a quaternion to unit length; shape (..., 4)."""
    return quaternion / quaternion.square().sum(-1, keepdim=True).sqrt()


def exponential(rotation: Tensor) -> Tensor:
    """Map a rotation vector to its quaternion, q = (sin(|r|/2) r/|r|, cos(|r|/2)).

    Args:
        rotation: Axis times angle [rad], shape (..., 3).

    Returns:
        Unit quaternions, shape (..., 4); smooth at zero.
    """
    half_square = rotation.square().sum(-1, keepdim=True) / 4
    small = half_square < 1e-3
    safe = torch.where(small, torch.ones_like(half_square), half_square).sqrt()
    x = half_square
    series = 1 - x / 2 * (1 - x / 12 * (1 - x / 30 * (1 - x / 56)))
    cosine = torch.where(small, series, torch.cos(safe))
    return torch.cat([_sine_ratio(half_square) * rotation / 2, cosine], dim=-1)


def logarithm(quaternion: Tensor) -> Tensor:
    """Map a unit quaternion to its rotation vector of at most pi, r = 2 atan2(|v|, w) v / |v|.

    The quaternions q and -q give the same vector. Smooth at the identity; at a half turn the axis is one of two.

    Args:
        quaternion: Unit quaternions, shape (..., 4).

    Returns:
        Axis times angle [rad], shape (..., 3).
    """
    quaternion = torch.where(quaternion[..., 3:] < 0, -quaternion, quaternion)
    vector, scalar = quaternion[..., :3], quaternion[..., 3:]
    square = vector.square().sum(-1, keepdim=True)
    small = square < 1e-6
    safe = torch.where(small, torch.ones_like(square), square).sqrt()
    ratio = square / scalar.clamp_min(0.5) ** 2
    series = 2 / scalar.clamp_min(0.5) * (1 - ratio / 3 * (1 - 3 * ratio / 5))
    return torch.where(small, series, 2 * torch.atan2(safe, scalar) / safe) * vector


def to_matrix(quaternion: Tensor) -> Tensor:
    """Turn unit quaternions (..., 4) into rotation matrices (..., 3, 3) that map body to world axes."""
    x, y, z, w = quaternion.unbind(-1)
    return torch.stack(
        [
            1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
            2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
            2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
        ],
        dim=-1,
    ).reshape(*quaternion.shape[:-1], 3, 3)  # fmt: skip


def from_matrix(matrix: Tensor) -> Tensor:
    """Turn rotation matrices (..., 3, 3) into unit quaternions (..., 4).

    Each of the four components gives a candidate; the one with the largest divisor is taken (Shepperd 1978).
    """
    m = matrix
    diagonal = m.diagonal(dim1=-2, dim2=-1)
    x, y, z = diagonal.unbind(-1)
    squares = torch.stack([1 + x - y - z, 1 - x + y - z, 1 - x - y + z, 1 + x + y + z], -1)
    skew = torch.stack([m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]], -1)
    xy, xz, yz = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    candidates = torch.stack(
        [
            torch.stack([squares[..., 0], xy, xz, skew[..., 0]], -1),
            torch.stack([xy, squares[..., 1], yz, skew[..., 1]], -1),
            torch.stack([xz, yz, squares[..., 2], skew[..., 2]], -1),
            torch.cat([skew, squares[..., 3:]], -1),
        ],
        dim=-2,
    )
    best = squares.argmax(-1)[..., None, None].expand(*squares.shape[:-1], 1, 4)
    return normalize(candidates.gather(-2, best).squeeze(-2))


def rotate(quaternion: Tensor, vector: Tensor) -> Tensor:
    """Rotate vectors (..., 3) from body to world axes, v' = v + 2 w (u x v) + 2 u x (u x v)."""
    axis, scalar = quaternion[..., :3], quaternion[..., 3:]
    axis, vector = torch.broadcast_tensors(axis, vector)
    twice: Tensor = 2 * torch.linalg.cross(axis, vector)
    turned: Tensor = vector + scalar * twice + torch.linalg.cross(axis, twice)
    return turned


def angle_between(first: Tensor, second: Tensor) -> Tensor:
    """Measure the geodesic angle between rotations [rad], |ln(second^-1 first)|, shape (...)."""
    angle: Tensor = logarithm(multiply(conjugate(second), first)).norm(dim=-1)
    return angle
