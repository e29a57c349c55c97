"""A scene with its true parameters, and the ways to excite it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physid.scenes.scene import Scene
from physid.strict import nearest

REST_DEPTH = 1e-5  # [m] how deep PyBullet keeps a resting contact (its contact slop): bodies at rest start there
LYING = 2 * REST_DEPTH  # [m] a body whose lowest point is no higher than this lies on the ground


@dataclass(frozen=True)
class Excitation:
    """How a trajectory starts and what is commanded.

    Attributes:
        pose: Initial poses, shape (N, 7).
        twist: First twists, angular [rad/s] and linear [m/s], shape (N, 6).
        wrench: Commanded torque [N m] and force [N], held from frame t to t+1; shape (T, N, 6).
    """

    pose: NDArray[np.float64]
    twist: NDArray[np.float64]
    wrench: NDArray[np.float64]

    def __post_init__(self) -> None:
        bodies = len(self.pose)
        shapes = {"pose": (bodies, 7), "twist": (bodies, 6), "wrench": (len(self.wrench), bodies, 6)}
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(f"{name} must be finite and of shape {shape}, got shape {value.shape}")


Protocol = Callable[[Scene, np.random.Generator, int], Excitation]


@dataclass(frozen=True)
class Setup:
    """A scene with its true parameters, and the ways to excite it.

    Attributes:
        scene: The scene, with true parameters and nothing unknown.
        protocols: Ways to draw a start and a force sequence of so many steps, by name.
        leaves_ground: Whether bodies fly, so that every motion is open to them at the start.
        impacts: Whether bodies hit the ground or each other.
    """

    scene: Scene
    protocols: Mapping[str, Protocol]
    leaves_ground: bool = False
    impacts: bool = False

    def unknown_of(self, scene: Scene) -> list[str]:
        """Return what is unknown in a scene, by the names that its bodies have here; they are in the same order."""
        names = dict(zip((body.name for body in scene.bodies), (body.name for body in self.scene.bodies), strict=False))
        split = (name.partition(".") for name in scene.unknown)
        return [f"{names.get(body, body)}.{quantity}" for body, _, quantity in split]

    def draw(self, scene: Scene, protocol: str, generator: np.random.Generator, steps: int) -> Excitation:
        """Draw a start and a force sequence of `steps` rows.

        Raises:
            ValueError: If there is no such protocol.
        """
        if protocol not in self.protocols:
            raise ValueError(f'scene {scene.name} has no protocol "{protocol}"{nearest(protocol, self.protocols)}')
        return self.protocols[protocol](scene, generator, steps)
