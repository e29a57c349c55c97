"""The torch effects at work inside PyBullet: a batch of worlds, no gradient."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physid.physics.collision import reach
from physid.physics.effect import Effect, StepInputs
from physid.physics.rotations import rotate
from physid.physics.state import State
from physid.scenes.scene import Scene
from physid.simulators.bullet.engine import Engine, Rows
from physid.simulators.bullet.native import Native

Array = NDArray[np.float64]
SHARED = ("ground_normal", "ground_offset")  # the fields of StepInputs that all worlds of a batch share
FIELDS = tuple(
    field.name for field in dataclasses.fields(StepInputs) if field.name not in ("time", "wrench", "gravity")
)


class Hooks:
    """Feeds PyBullet worlds what a list of effects makes of the inputs of each step.

    An effect is a formula of torch for a batch: that costs about as much for one world as for all.

    Args:
        scene: The scene, with its nominal parameters.
        effects: Effects, applied in this order.
        worlds: How many worlds.
    """

    def __init__(self, scene: Scene, effects: Sequence[Effect], worlds: int = 1) -> None:
        self._time_step = scene.time_step
        self._effects = tuple(effects)
        self._nominal = nominal_inputs(scene, worlds)
        self._known = self._nominal

    def actuate(self, wrench: Array) -> Array:
        """Turn the commanded wrenches (T, N, 6) of a trajectory into those that act."""
        acting = torch.from_numpy(wrench)[None]
        time = self._time_step * torch.arange(len(wrench), dtype=torch.float64)[None]
        for effect in self._effects:
            acting = effect.actuate(acting, time)
        return np.asarray(acting[0].numpy())

    def build(self, scene: Scene, pose: Array, twist: Array, time_step: float) -> list[Engine]:
        """Build PyBullet worlds with the sizes, masses and moments of the first step.

        Sizes and centres of mass cannot change later, and changed moments act one step late.

        Args:
            scene: The scene.
            pose: Initial poses, shape (B, N, 7).
            twist: First twists, shape (B, N, 6).
            time_step: Length of one step [s].
        """
        first = self._inputs(np.zeros(len(pose)), pose, twist, np.zeros_like(twist))
        fields = ("size", "mass", "inertia", "centre_of_mass")
        self._known = self._nominal.replace(
            **{name: getattr(first, name).expand_as(getattr(self._nominal, name)) for name in fields}
        )
        return [
            self._world(scene, time_step, *each)
            for each in zip(*(getattr(self._known, name) for name in fields), strict=True)
        ]

    def _world(
        self, scene: Scene, time_step: float, sizes: Tensor, masses: Tensor, moments: Tensor, centres: Tensor
    ) -> Engine:
        """Build one world from sizes (N, 3), masses (N,), moments (N, 3) and centres of mass (N, 3)."""
        rows = zip(scene.bodies, sizes.tolist(), masses.tolist(), moments.tolist(), strict=True)
        bodies = [
            dataclasses.replace(body, size=tuple(size), mass=mass, inertia=tuple(moment))
            for body, size, mass, moment in rows
        ]
        engine = Engine(scene.with_bodies(bodies), time_step, centres.numpy())
        for effect in self._effects:
            if isinstance(effect, Native):
                engine.alter(effect.settings())
        return engine

    def start(self, pose: Array) -> Array:
        """Return initial poses (B, N, 7) that keep the distance of each body from the ground although sizes differ."""
        normal = self._nominal.ground_normal
        taller = reach(torch.from_numpy(pose[..., 3:]), self._known.size - self._nominal.size, normal)
        lift = taller[..., None] * normal
        return np.concatenate([pose[..., :3] + lift.numpy(), pose[..., 3:]], -1)

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
        inputs = self._inputs(time, places, np.array(twist), wrench)
        self._tell(engines, inputs)
        pull = inputs.mass[..., None] * (inputs.gravity - self._nominal.gravity)
        arm = rotate(torch.from_numpy(places[..., 3:]), inputs.centre_of_mass)
        at_mass = inputs.add_torque(-torch.linalg.cross(arm, inputs.wrench[..., 3:])).add_force(pull)
        for engine, place, load in zip(engines, pose, at_mass.wrench.tolist(), strict=True):
            engine.push(place, load)

    @torch.no_grad()
    def _inputs(self, time: Array, pose: Array, twist: Array, wrench: Array) -> StepInputs:
        """Return the inputs of a step after all effects."""
        state = State(torch.from_numpy(pose), torch.from_numpy(twist))
        inputs = self._nominal.replace(time=torch.from_numpy(time), wrench=torch.from_numpy(wrench))
        for effect in self._effects:
            inputs = effect.act(state, inputs)
        return inputs

    def keep(self, worlds: int) -> None:
        """Go on with the first so many worlds."""
        self._nominal, self._known = _first(self._nominal, worlds), _first(self._known, worlds)

    def _tell(self, engines: Sequence[Engine], inputs: StepInputs) -> None:
        """Tell PyBullet what differs from what it knows."""
        changed = self._changes(inputs)
        if changed.keys() & {"size", "centre_of_mass"}:
            raise ValueError("PyBullet cannot change sizes or centres of mass between steps; let them be constant")
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
        self._known = inputs

    def _changes(self, inputs: StepInputs) -> dict[str, list[int]]:
        """Return the names of the fields that differ from what PyBullet knows, and in which worlds they do."""
        found = {}
        for name in FIELDS:
            new, old = getattr(inputs, name), getattr(self._known, name)
            if new is not old and not torch.equal(new, old):
                differs = new != old
                found[name] = (
                    [] if name in SHARED else differs.reshape(len(differs), -1).any(1).nonzero()[:, 0].tolist()
                )
        return found


def _first(inputs: StepInputs, worlds: int) -> StepInputs:
    """Return the inputs of the first so many worlds."""
    fields = (field.name for field in dataclasses.fields(inputs))
    return inputs.replace(**{name: getattr(inputs, name)[:worlds] for name in fields if name not in SHARED})


def _worlds(changed: Mapping[str, list[int]], *names: str) -> list[int]:
    """Return the worlds in which any of some fields changed."""
    return sorted(set().union(*(changed.get(name, []) for name in names)))


def nominal_inputs(scene: Scene, worlds: int = 1) -> StepInputs:
    """Return the inputs of a step without effects, for a batch of worlds."""
    bodies, count = scene.bodies, len(scene.bodies)

    def batch(values: object) -> Tensor:
        row = torch.as_tensor(np.array(values, dtype=float))
        return row.expand(worlds, *row.shape)

    ones, one = torch.ones(worlds, count, dtype=torch.float64), torch.ones(worlds, dtype=torch.float64)
    return StepInputs(
        time=torch.zeros(worlds, dtype=torch.float64),
        wrench=torch.zeros(worlds, count, 6, dtype=torch.float64),
        gravity=batch([scene.gravity] * count),
        size=batch(scene.sizes),
        mass=batch([body.mass for body in bodies]),
        inertia=batch([body.moments() for body in bodies]),
        friction=batch([body.friction for body in bodies]),
        restitution=batch([body.restitution for body in bodies]),
        ground_normal=torch.as_tensor(np.array(scene.ground.normal, dtype=float)),
        ground_offset=torch.as_tensor(np.array(scene.ground.offset, dtype=float)),
        ground_friction=ones,
        ground_restitution=torch.zeros_like(ones),
        body_friction=one,
        body_restitution=torch.zeros_like(one),
        centre_of_mass=torch.zeros(worlds, count, 3, dtype=torch.float64),
        compliance=torch.zeros(worlds, count, dtype=torch.float64),
    )


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
