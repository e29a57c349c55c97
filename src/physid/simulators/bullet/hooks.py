"""The torch effects at work inside PyBullet: a batch of worlds, no gradient."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physid.physics import Effect, StepInputs
from physid.physics.rotations import rotate
from physid.scenes import Scene
from physid.simulators.bullet.engine import Engine, Rows
from physid.simulators.inputs import ChangingInputs
from physid.simulators.native import Native

Array = NDArray[np.float64]


class Hooks:
    """Feeds PyBullet worlds what a list of effects makes of the inputs of each step.

    An effect is a formula of torch for a batch: that costs about as much for one world as for all.

    Args:
        scene: The scene, with its nominal parameters.
        effects: Effects, applied in this order.
        worlds: How many worlds.
    """

    def __init__(self, scene: Scene, effects: Sequence[Effect], worlds: int = 1) -> None:
        self._effects = tuple(effects)
        self._inputs = ChangingInputs(scene, effects, worlds)

    def build(self, scene: Scene, pose: Array, twist: Array, time_step: float) -> list[Engine]:
        """Build PyBullet worlds with the sizes, masses and moments of the first step.

        Sizes and centres of mass cannot change later, and changed moments act one step late.

        Args:
            scene: The scene.
            pose: Initial poses, shape (B, N, 7).
            twist: Initial twists, shape (B, N, 6).
            time_step: Length of one step [s].
        """
        worlds = self._inputs.build(pose, twist)
        engines = [Engine(scene.with_bodies(bodies), time_step, centres) for bodies, centres in worlds]
        for effect in self._effects:
            if isinstance(effect, Native):
                for engine in engines:
                    engine.alter(effect.settings())
        return engines

    def act(
        self, engines: Sequence[Engine], time: Array, pose: Sequence[Rows], twist: Sequence[Rows], wrench: Array
    ) -> None:
        """Apply wrenches and changed parameters for the next step.

        Args:
            engines: The B worlds.
            time: Times since the first frames [s], shape (B,).
            pose: Present poses, N rows of 7 of each world.
            twist: Present twists, N rows of 6 of each world.
            wrench: Acting wrenches, shape (B, N, 6).

        Raises:
            ValueError: If an effect changes what PyBullet cannot change.
        """
        places = np.array(pose)
        inputs = self._inputs.at(time, places, np.array(twist), wrench)
        self._tell(engines, inputs)
        pull = inputs.mass[..., None] * (inputs.gravity - self._inputs.nominal.gravity)
        arm = rotate(torch.from_numpy(places[..., 3:]), inputs.centre_of_mass)
        at_mass = inputs.add_torque(-torch.linalg.cross(arm, inputs.wrench[..., 3:])).add_force(pull)
        for engine, place, load in zip(engines, pose, at_mass.wrench.tolist(), strict=True):
            engine.push(place, load)

    def keep(self, worlds: int) -> None:
        """Go on with the first so many worlds."""
        self._inputs.keep(worlds)

    def _tell(self, engines: Sequence[Engine], inputs: StepInputs) -> None:
        """Tell PyBullet what differs from what it knows."""
        changed = self._inputs.changes(inputs, "PyBullet")
        for world in _worlds(changed, "mass", "inertia"):
            for body, (mass, moments) in enumerate(zip(inputs.mass[world], inputs.inertia[world], strict=True)):
                engines[world].set_inertia(body, float(mass), moments.tolist())
        if worlds := _worlds(changed, *(name for name in changed if "friction" in name or "restitution" in name)):
            _set_contacts(engines, inputs, worlds)
        if changed.keys() & {"ground_normal", "ground_offset"}:
            for engine in engines:
                engine.place_ground(inputs.ground_normal.tolist(), float(inputs.ground_offset))
        for world in _worlds(changed, "compliance"):
            _set_compliance(engines[world], inputs.compliance[world])
        self._inputs.known = inputs


def _worlds(changed: Mapping[str, list[int]], *names: str) -> list[int]:
    """Return the worlds in which any of some fields changed."""
    return sorted(set().union(*(changed.get(name, []) for name in names)))


LEAST = 1e-6  # [-] stands for a coefficient of zero, which could not be a product of two others


def split_products(ground: Array, pair: float) -> tuple[Array, float]:
    """Find one number per body and one of the ground whose products are the coefficients wanted.

    PyBullet multiplies one number per body. With f_i f_g = ground_i and f_1 f_2 = pair,
    f_g = sqrt(ground_1 ground_2 / pair).

    Args:
        ground: Coefficients of the bodies with the ground, shape (N,).
        pair: Coefficient between bodies; of the first two.

    Returns:
        f of the bodies (N,), and f_g of the ground.

    Raises:
        ValueError: If there are more than two bodies.
    """
    if len(ground) == 1:
        return ground, 1.0
    if len(ground) > 2:
        raise ValueError("PyBullet can tell contacts with the ground from those between bodies for at most two bodies")
    wanted = np.maximum(ground, LEAST)
    of_ground = float(np.sqrt(wanted.prod() / max(pair, LEAST)))
    return wanted / of_ground, of_ground


def _set_contacts(engines: Sequence[Engine], inputs: StepInputs, worlds: Sequence[int]) -> None:
    """Tell some worlds the coefficients of all contacts."""
    values = inputs.friction, inputs.restitution
    ground = values[0] * inputs.ground_friction, (values[1] + inputs.ground_restitution).clamp_min(0)
    both = [value[:, :2].prod(1) for value in values]
    pair = both[0] * inputs.body_friction, (both[1] + inputs.body_restitution).clamp_min(0)
    for world in worlds:
        frictions, ground_friction = split_products(ground[0][world].numpy(), float(pair[0][world]))
        restitutions, ground_restitution = split_products(ground[1][world].numpy(), float(pair[1][world]))
        for body, coefficients in enumerate(zip(frictions.tolist(), restitutions.tolist(), strict=True)):
            engines[world].set_contact(body, *coefficients)
        engines[world].set_ground_contact(ground_friction, ground_restitution)


def _set_compliance(engine: Engine, compliance: Tensor) -> None:
    """Tell PyBullet the compliance of the ground."""
    if not bool((compliance == compliance[0]).all()):
        raise ValueError("PyBullet knows one compliance of the ground for all bodies; let them be equal")
    engine.set_ground_compliance(float(compliance[0]))
