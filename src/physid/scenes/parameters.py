"""Parameters of a scene by name: what "block.friction" sets."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from physid.scenes.scene import HIGHEST_RESTITUTION, PARAMETERS, Body, Scene


def highest_value(name: str) -> float:
    """Return the largest value that "body.field" may have: a body that bounces higher than it fell would gain energy.

    Args:
        name: A parameter of a scene.

    Returns:
        1 for a coefficient of restitution, infinity for a mass or a coefficient of friction.
    """
    return HIGHEST_RESTITUTION if name.endswith(".restitution") else math.inf


def bodies_of(scene: Scene, parameter: str) -> tuple[int, ...]:
    """Return the bodies whose value "body.field" sets: all those of one material for friction and restitution.

    Raises:
        ValueError: If there is no such body, or no such parameter.
    """
    owner, field_name = scene.locate(parameter)
    material = scene.bodies[owner].material
    if field_name == "mass" or material is None:
        return (owner,)
    return tuple(index for index, body in enumerate(scene.bodies) if body.material == material)


def given_in(scene: Scene) -> tuple[str, ...]:
    """Return the parameters that are not unknown, by body and field; one name for bodies of one material."""
    taken = {_sets(scene, name) for name in scene.unknown}
    found = []
    for name in (f"{body.name}.{field}" for body in scene.bodies for field in PARAMETERS):
        if _sets(scene, name) not in taken:
            taken.add(_sets(scene, name))
            found.append(name)
    return tuple(found)


def _sets(scene: Scene, name: str) -> tuple[str, tuple[int, ...]]:
    """Return which value of which bodies a parameter sets."""
    return scene.locate(name)[1], bodies_of(scene, name)


def unit_of(parameter: str) -> str:
    """Return the unit of "block.mass" and the like; "" for a pure number."""
    return "kg" if parameter.endswith(".mass") else ""


def with_parameters(scene: Scene, values: Mapping[str, float]) -> Scene:
    """Return the scene with parameters such as "block.friction" changed; bodies of one material change together.

    Raises:
        ValueError: If a parameter does not exist or a value is impossible.
    """
    bodies = list(scene.bodies)
    for parameter, value in values.items():
        _, field_name = scene.locate(parameter)
        for index in bodies_of(scene, parameter):
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
