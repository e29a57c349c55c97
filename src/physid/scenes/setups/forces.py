"""Force sequences [N]: the paper's, and a richer one that tells effects apart."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LOW, HIGH = 1.0, 10.0  # [N] the paper's range
AXES = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
ARM = 0.03  # [m] largest distance of a push from the centre of the box
PIECE = (24, 72)  # [steps] shortest and longest stretch of one command in the rich protocol


def redrawn(generator: np.random.Generator, direction: Array, steps: int) -> Array:
    """Draw a magnitude of 1 to 10 N anew at each step, along one direction (3,); returns (T, 3)."""
    return np.asarray(generator.uniform(LOW, HIGH, steps)[:, None] * direction)


def pieces(generator: np.random.Generator, across: Array, steps: int) -> Array:
    """Draw a force sequence of oblique pushes, force steps, reversals and coasting.

    Stretches of 24 to 72 steps follow each other. Each is a new push (any heading in the ground's plane, 2 to 10 N), a
    step in magnitude, a reversal of the last push, or coasting without force.

    Args:
        generator: Source of randomness.
        across: Two orthonormal vectors that span the plane of the pushes, shape (2, 3).
        steps: Rows T.

    Returns:
        Forces [N], shape (T, 3).
    """
    force = np.zeros((steps, 3))
    push = _new_push(generator, across)
    start = 0
    while start < steps:
        end = start + int(generator.integers(PIECE[0], PIECE[1] + 1))
        kind = generator.choice(["push", "step", "reverse", "coast"], p=[0.3, 0.2, 0.25, 0.25])
        if kind == "push":
            push = _new_push(generator, across)
        elif kind == "step":
            push = push * generator.uniform(2.0, HIGH) / math.hypot(*push)  # the norm of BLAS depends on the machine
        elif kind == "reverse":
            push = -push
        force[start:end] = 0.0 if kind == "coast" else push
        start = end
    return force


def pieces_along(generator: np.random.Generator, direction: Array, steps: int) -> Array:
    """Draw the force sequence of `pieces` as it is seen from one direction (3,); returns (T, 3)."""
    return pieces(generator, np.stack([direction, 0 * direction]), steps)


def arms(generator: np.random.Generator, force: Array, normal: Array) -> Array:
    """Draw the torques of a force sequence that does not pass through the centre of the box, as a hand pushes.

    Each stretch of one command has an arm of its own, up to 3 cm to either side: torque = arm |force| normal.

    Args:
        generator: Source of randomness.
        force: Forces [N], shape (T, 3).
        normal: Of the ground, shape (3,).

    Returns:
        Torques about the centre of the box [N m], shape (T, 3).
    """
    new = np.any(np.diff(force, axis=0, prepend=force[:1]) != 0, axis=1).cumsum()
    arm = generator.uniform(-ARM, ARM, int(new[-1]) + 1)[new]
    return np.asarray((arm * np.linalg.norm(force, axis=1))[:, None] * normal)


def _new_push(generator: np.random.Generator, across: Array) -> Array:
    """Draw a force [N] (3,) of any heading in the plane."""
    heading, magnitude = generator.uniform(0, 2 * np.pi), generator.uniform(2.0, HIGH)
    return np.asarray(magnitude * (np.cos(heading) * across[0] + np.sin(heading) * across[1]))
