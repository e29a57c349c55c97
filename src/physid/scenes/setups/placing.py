"""Where bodies start: on the ground, at any heading."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physid.scenes.rotations import between, from_vector, multiply, rotate
from physid.scenes.scene import Ground
from physid.scenes.setup import REST_DEPTH

Array = NDArray[np.float64]
UP = np.array([0.0, 0.0, 1.0])
WORKSPACE = 1.0  # [m] bodies start within this distance of the middle, along x and along y


def span(ground: Ground) -> Array:
    """Return two orthonormal vectors in the ground's plane: x and y, turned with the ground; shape (2, 3)."""
    return rotate(between(UP, ground.normal), np.eye(3)[:2])


def upstream(generator: np.random.Generator, ahead: Array, way: float) -> Array:
    """Draw a place (2,) anywhere in the workspace from which `way` [m] ahead lie within it too.

    Args:
        generator: Source of randomness.
        ahead: The direction of travel in the image plane, a unit vector along x or y, shape (2,).
        way: How far the body is expected to travel [m]; most draws then stay in view.
    """
    along = generator.uniform(-WORKSPACE, WORKSPACE - way)
    aside = generator.uniform(-WORKSPACE, WORKSPACE)
    return along * ahead + aside * np.array([-ahead[1], ahead[0]])


def on_ground(ground: Ground, x: float, y: float, yaw: float, height: float) -> Array:
    """Return the pose (7,) of a box that lies flat on the ground.

    Args:
        ground: The plane.
        x: World coordinate of the box's foot [m].
        y: World coordinate of the box's foot [m].
        yaw: Heading about the ground's normal [rad].
        height: Edge length along the normal [m].
    """
    normal = np.array(ground.normal)
    foot = np.array([x, y, (ground.offset - normal[0] * x - normal[1] * y) / normal[2]])
    quaternion = multiply(between(UP, normal), from_vector(yaw * UP))
    return np.concatenate([foot + (0.5 * height - REST_DEPTH) * normal, quaternion])


def planar_twist(generator: np.random.Generator, ground: Ground, speed: float, spin: float) -> Array:
    """Draw a twist (6,) in the ground's plane: any heading, up to `speed` [m/s], and up to `spin` [rad/s] about it."""
    heading, size = generator.uniform(0, 2 * np.pi), generator.uniform(0, speed)
    velocity = size * (np.array([np.cos(heading), np.sin(heading)]) @ span(ground))
    angular = generator.uniform(-spin, spin) * np.array(ground.normal)
    return np.concatenate([angular, velocity])


def heading(generator: np.random.Generator, ground: Ground) -> Array:
    """Draw a direction (3,) in the ground's plane."""
    angle = generator.uniform(0, 2 * np.pi)
    return np.asarray(np.array([np.cos(angle), np.sin(angle)]) @ span(ground))


def anywhere(generator: np.random.Generator, ground: Ground, height: float) -> Array:
    """Draw the pose (7,) of a box of some height [m] that lies flat on the ground, in the workspace, at any heading."""
    x, y, _ = generator.uniform(-WORKSPACE, WORKSPACE, 2) @ span(ground)
    return on_ground(ground, x, y, generator.uniform(-np.pi, np.pi), height)


def moving(direction: Array, speed: float) -> Array:
    """Return the twist (6,) of a body that moves along a direction (3,) and does not turn."""
    return np.concatenate([np.zeros(3), speed * direction])
