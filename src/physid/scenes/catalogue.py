"""The scenes that can be generated. A new scene is one file and one entry here."""

from __future__ import annotations

from collections.abc import Mapping

from physid.scenes.collide import COLLIDE
from physid.scenes.push import PUSH
from physid.scenes.scene import Scene
from physid.scenes.setup import Setup, sharing, with_values
from physid.scenes.slide import SLIDE
from physid.scenes.strict import nearest, quoted
from physid.scenes.toss import TOSS

SETUPS: tuple[Setup, ...] = (PUSH, SLIDE, COLLIDE, TOSS)


def find_setup(name: str) -> Setup:
    """Return the setup of a scene by name.

    Raises:
        ValueError: If there is no such scene.
    """
    known = {setup.scene.name: setup for setup in SETUPS}
    if not isinstance(name, str) or name not in known:
        raise ValueError(f"unknown scene {quoted(name)}{nearest(str(name), known)}")
    return known[name]


def bodies_of(scene: Scene, parameter: str) -> tuple[int, ...]:
    """Return the bodies whose value "body.field" sets: all those of one material for friction and restitution.

    Raises:
        ValueError: If there is no such body, or no such parameter.
    """
    return sharing(scene, parameter, _materials(scene.name))


def with_parameters(scene: Scene, values: Mapping[str, float]) -> Scene:
    """Return the scene with parameters such as "block.friction" changed; bodies of one material change together.

    Raises:
        ValueError: If a parameter does not exist or a value is impossible.
    """
    return with_values(scene, values, _materials(scene.name))


def _materials(name: str) -> Mapping[str, str]:
    """Return which bodies of a scene share a material; a scene that is not in the catalogue shares none."""
    return next((setup.materials for setup in SETUPS if setup.scene.name == name), {})
