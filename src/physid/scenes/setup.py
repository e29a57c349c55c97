"""A scene with its true parameters, and the ways to excite it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from physid.scenes.scene import Body, Scene
from physid.scenes.strict import nearest

REST_DEPTH = 1e-5  # [m] how deep PyBullet keeps a resting contact (its contact slop): bodies at rest start there


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
        materials: For a body that is made of the same material as another: the name of that other.
    """

    scene: Scene
    protocols: Mapping[str, Protocol]
    materials: Mapping[str, str] = field(default_factory=dict)

    def draw(self, scene: Scene, protocol: str, generator: np.random.Generator, steps: int) -> Excitation:
        """Draw a start and a force sequence of `steps` rows.

        Raises:
            ValueError: If there is no such protocol.
        """
        if protocol not in self.protocols:
            raise ValueError(f'scene {scene.name} has no protocol "{protocol}"{nearest(protocol, self.protocols)}')
        return self.protocols[protocol](scene, generator, steps)


def sharing(scene: Scene, parameter: str, materials: Mapping[str, str]) -> tuple[int, ...]:
    """Return the bodies that "body.field" sets: all of one material for friction and restitution, else the one.

    Raises:
        ValueError: If there is no such body, or no such parameter.
    """
    owner, field_name = scene.locate(parameter)
    if field_name == "mass":
        return (owner,)
    material = [materials.get(body.name, body.name) for body in scene.bodies]
    return tuple(index for index, one in enumerate(material) if one == material[owner])


def with_values(scene: Scene, values: Mapping[str, float], materials: Mapping[str, str]) -> Scene:
    """Return the scene with parameters changed by name; bodies of one material change together.

    Raises:
        ValueError: If a parameter does not exist or a value is impossible.
    """
    bodies = list(scene.bodies)
    for parameter, value in values.items():
        _, field_name = scene.locate(parameter)
        for index in sharing(scene, parameter, materials):
            bodies[index] = _changed(bodies[index], field_name, value)
    return scene.with_bodies(bodies)


def _changed(body: Body, field_name: str, value: float) -> Body:
    """Return a copy of the body; a given inertia follows the mass."""
    if field_name == "mass" and body.inertia is not None:
        x, y, z = (moment * value / body.mass for moment in body.inertia)
        return dataclasses.replace(body, mass=value, inertia=(x, y, z))
    if field_name == "mass":
        return dataclasses.replace(body, mass=value)
    if field_name == "friction":
        return dataclasses.replace(body, friction=value)
    return dataclasses.replace(body, restitution=value)
