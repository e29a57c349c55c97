"""Orientations and axes as logs write them, turned into unit quaternions x y z w in a right-handed frame with z up."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from physid.strict import nearest

Array = NDArray[np.float64]
PRESETS = {
    "z-up": "x y z",
    "y-up": "x -z y",
    "x-up": "y z x",
    "z-down": "x -y -z",
    "y-down": "x z -y",
    "left-handed-y-up": "x z y",
    "left-handed-z-up": "x -y z",
}
"""Frames by name: which of the log's axes is the world's x, y, z. Unity: left-handed-y-up, Unreal: left-handed-z-up."""
ROUNDED = 0.02  # by which the length of a quaternion may be off, in a log of two digits


def axes_of(value: object) -> Array:
    """Return the signed permutation (3, 3) that turns vectors of a log into the world frame.

    Args:
        value: "x -z y", or a list of three such words: the world's x is the log's x, its y the log's -z, its z the
            log's y; or a key of `PRESETS`.

    Raises:
        ValueError: If it is something else.
    """
    named = PRESETS.get(str(value).strip().lower())
    parts = value if isinstance(value, list | tuple) and not named else (named or str(value)).replace(",", " ").split()
    words = [str(one).strip().lower() for one in parts]
    letters = [word.lstrip("+-") for word in words]
    if sorted(letters) != ["x", "y", "z"]:
        raise ValueError(
            f"axes: expected the log's axes that are the world's x, y and z (z up), say x -z y, or a name, got "
            f"{value!r}{nearest(str(value), PRESETS)}"
        )
    matrix = np.zeros((3, 3))
    for row, (word, letter) in enumerate(zip(words, letters, strict=True)):
        matrix[row, "xyz".index(letter)] = -1.0 if word.startswith("-") else 1.0
    return matrix


def turned(quaternion: Array, axes: Array) -> Array:
    """Return orientations (..., 4) of boxes in the world frame.

    A right-handed frame is turned, R' = M R. A left-handed one, where det M = -1, is mirrored in the box as well, R' =
    M R diag(1, 1, -1): a box looks the same in a mirror, so that its edges keep their lengths.
    """
    shape = quaternion.shape
    matrix = axes @ Rotation.from_quat(quaternion.reshape(-1, 4)).as_matrix()
    if np.linalg.det(axes) < 0:
        matrix = matrix * np.array([1.0, 1.0, -1.0])
    return np.asarray(Rotation.from_matrix(matrix).as_quat().reshape(shape))


def from_quaternions(values: Array, order: str) -> tuple[Array, NDArray[np.intp]]:
    """Return unit quaternions x y z w (T, 4), and the rows whose length is off.

    Args:
        values: Four columns (T, 4); NaN rows stay.
        order: What they are: xyzw or wxyz.
    """
    quaternion = values if order == "xyzw" else values[:, [1, 2, 3, 0]]
    length = np.linalg.norm(quaternion, axis=1)
    return quaternion / np.where(length > 0, length, 1)[:, None], np.flatnonzero(np.abs(length - 1) > ROUNDED)


def from_euler(values: Array, sequence: str, unit: float) -> Array:
    """Return quaternions (T, 4) of angles (T, n) [unit rad]; lower case turns about fixed axes, upper case about own.

    Args:
        values: One column for each letter of the sequence.
        sequence: As in scipy: "xyz", "ZYX", or one axis alone.
        unit: Of the angles [rad].
    """
    known = np.isfinite(values).all(1)
    out = np.full((len(values), 4), np.nan)
    out[known] = Rotation.from_euler(sequence, values[known] * unit).as_quat()
    return out


def from_vectors(values: Array, unit: float) -> Array:
    """Return quaternions (T, 4) of rotation vectors (T, 3) [unit rad]."""
    known = np.isfinite(values).all(1)
    out = np.full((len(values), 4), np.nan)
    out[known] = Rotation.from_rotvec(values[known] * unit).as_quat()
    return out


def from_matrices(values: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return quaternions (T, 4) of rotation matrices (T, 9), row by row, and the rows that are no rotations."""
    known = np.asarray(np.isfinite(values).all(1))
    matrix = values.reshape(-1, 3, 3)
    off = np.abs(matrix @ matrix.transpose(0, 2, 1) - np.eye(3)).max((1, 2)) > 2 * ROUNDED
    wrong = np.flatnonzero(known & (off | (np.linalg.det(np.where(known[:, None, None], matrix, np.eye(3))) < 0)))
    out = np.full((len(values), 4), np.nan)
    if not len(wrong) and known.any():
        out[known] = Rotation.from_matrix(matrix[known]).as_quat()
    return out, wrong


def check_sequence(sequence: str, columns: Sequence[object]) -> None:
    """Check the order of Euler angles.

    Raises:
        ValueError: If it is none, or has not one letter for each column.
    """
    low = sequence.lower()
    same = sequence in (low, sequence.upper())
    if not same or set(low) - set("xyz") or len(low) != len(columns) or any(a == b for a, b in pairwise(low)):
        raise ValueError(
            f"euler_order: expected one letter for each of {len(columns)} angles, xyz about the fixed axes or ZYX "
            f"about the body's own (yaw, pitch, roll), got {sequence!r}"
        )


def in_world(wrench: Array, at: Array, pose: Array, time: Array) -> Array:
    """Turn torques and forces that are given in the axes of bodies into the world, by the attitudes at their stamps.

    Args:
        wrench: Along the edges of each body, shape (S, N, 6).
        at: Their stamps [s], shape (S,).
        pose: Poses, NaN where not seen, shape (T, N, 7).
        time: Stamps of the poses [s], on the same clock, shape (T,).

    Returns:
        World frame, shape (S, N, 6). Before a body is seen, and after, its first and its last attitude hold.
    """
    turned = np.empty_like(wrench)
    for body in range(pose.shape[1]):
        seen = np.isfinite(pose[:, body]).all(1)
        known, quaternion = time[seen], pose[seen, body, 3:]
        if len(known) > 1:
            attitude = Slerp(known, Rotation.from_quat(quaternion))(np.clip(at, known[0], known[-1]))
        else:
            attitude = Rotation.from_quat(np.repeat(quaternion, len(at), 0))
        for part in (slice(0, 3), slice(3, 6)):
            turned[:, body, part] = attitude.apply(wrench[:, body, part])
    return turned
