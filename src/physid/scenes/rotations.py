"""Quaternions x y z w in NumPy, for start poses and images (the physics has its own, in torch)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def from_vector(vector: ArrayLike) -> Array:
    """Return the unit quaternions (..., 4) of rotation vectors [rad] (..., 3)."""
    half = 0.5 * np.asarray(vector, dtype=float)
    angle = np.linalg.norm(half, axis=-1, keepdims=True)
    return np.concatenate([half * np.sinc(angle / np.pi), np.cos(angle)], -1)


def to_vector(quaternion: ArrayLike) -> Array:
    """Return the rotation vectors [rad] (..., 3), at most pi long, of unit quaternions (..., 4)."""
    q = np.asarray(quaternion, dtype=float)
    q = np.where(q[..., 3:] < 0, -q, q)
    sine = np.linalg.norm(q[..., :3], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, q[..., 3:])
    scale = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)
    return np.asarray(scale * q[..., :3])


def multiply(first: ArrayLike, second: ArrayLike) -> Array:
    """Return the product (..., 4): the rotation `second`, followed by `first`."""
    a, b = np.broadcast_arrays(np.asarray(first, dtype=float), np.asarray(second, dtype=float))
    vector = a[..., 3:] * b[..., :3] + b[..., 3:] * a[..., :3] + np.cross(a[..., :3], b[..., :3])
    scalar = a[..., 3:] * b[..., 3:] - (a[..., :3] * b[..., :3]).sum(-1, keepdims=True)
    return np.concatenate([vector, scalar], -1)


def conjugate(quaternion: ArrayLike) -> Array:
    """Return the inverse rotations (..., 4) of unit quaternions."""
    return np.asarray(np.asarray(quaternion) * np.array([-1.0, -1.0, -1.0, 1.0]))


def rotate(quaternion: ArrayLike, vector: ArrayLike) -> Array:
    """Rotate vectors (..., 3) by unit quaternions (..., 4): v + 2 w (u x v) + 2 u x (u x v)."""
    q, v = np.asarray(quaternion, dtype=float), np.asarray(vector, dtype=float)
    once = 2 * np.cross(q[..., :3], v)
    return np.asarray(v + q[..., 3:] * once + np.cross(q[..., :3], once))


def between(start: ArrayLike, end: ArrayLike) -> Array:
    """Return the shortest rotation (4,) that turns the unit vector `start` into `end`, which must not oppose it."""
    a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    quaternion = np.append(np.cross(a, b), 1 + a @ b)
    return np.asarray(quaternion / np.linalg.norm(quaternion))
