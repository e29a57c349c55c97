"""The torch effects at work inside PyBullet: a batch of one, no gradient."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physid.bullet.engine import Engine, Rows
from physid.bullet.native import Native
from physid.physics.effect import Effect, StepInputs
from physid.physics.rotations import rotate, to_matrix
from physid.physics.state import State
from physid.scenes.scene import Scene

Array = NDArray[np.float64]


class Hooks:
    """Feeds PyBullet what a list of effects makes of the inputs of each step.

    Args:
        scene: The scene, with its nominal parameters.
        effects: Effects, applied in this order.
    """

    def __init__(self, scene: Scene, effects: Sequence[Effect]) -> None:
        self._time_step = scene.time_step
        self._effects = tuple(effects)
        self._nominal = nominal_inputs(scene)
        self._known = self._nominal

    def actuate(self, wrench: Array) -> Array:
        """Turn the commanded wrenches (T, N, 6) into those that act."""
        acting = torch.from_numpy(wrench)[None]
        for effect in self._effects:
            acting = effect.actuate(acting, self._time_step)
        return np.asarray(acting[0].numpy())

    def build(self, scene: Scene, pose: Array, twist: Array, time_step: float) -> Engine:
        """Build the PyBullet world with the sizes, masses and moments of the first step.

        Sizes and centres of mass cannot change later, and changed moments act one step late.
        """
        first = self._inputs(0.0, pose, twist, np.zeros_like(twist))
        fields = ("size", "mass", "inertia", "centre_of_mass")
        self._known = self._nominal.replace(**{name: getattr(first, name) for name in fields})
        bodies = [
            dataclasses.replace(body, size=tuple(size), mass=mass, inertia=tuple(moments))
            for body, size, mass, moments in zip(
                scene.bodies, first.size[0].tolist(), first.mass[0].tolist(), first.inertia[0].tolist(), strict=True
            )
        ]
        engine = Engine(scene.with_bodies(bodies), time_step, first.centre_of_mass[0].numpy())
        for effect in self._effects:
            if isinstance(effect, Native):
                engine.alter(effect.settings())
        return engine

    def start(self, pose: Array) -> Array:
        """Return first poses (N, 7) that keep the distance of each body from the ground although sizes differ."""
        normal = self._nominal.ground_normal
        reach = (normal @ to_matrix(torch.from_numpy(pose[:, 3:]))).abs() * (self._known.size - self._nominal.size)[0]
        lift = reach.sum(-1, keepdim=True) / 2 * normal
        return np.concatenate([pose[:, :3] + lift.numpy(), pose[:, 3:]], 1)

    def act(self, engine: Engine, time: float, pose: Rows, twist: Rows, wrench: Rows) -> None:
        """Apply wrenches and changed parameters for the next step.

        Args:
            engine: The world that `build` made.
            time: Time since the first frame [s].
            pose: Present poses, N rows of 7.
            twist: Present twists, N rows of 6.
            wrench: Acting wrenches, N rows of 6.

        Raises:
            ValueError: If an effect changes what PyBullet cannot change.
        """
        inputs = self._inputs(time, np.array(pose), np.array(twist), np.array(wrench))
        changed = self._changes(inputs)
        if changed & {"size", "centre_of_mass"}:
            raise ValueError("PyBullet cannot change sizes or centres of mass between steps; let them be constant")
        if changed & {"mass", "inertia"}:
            for body, (mass, moments) in enumerate(zip(inputs.mass[0], inputs.inertia[0], strict=True)):
                engine.set_inertia(body, float(mass), moments.tolist())
        if any("friction" in name or "restitution" in name for name in changed):
            _set_contacts(engine, inputs)
        if changed & {"ground_normal", "ground_offset"}:
            engine.place_ground(inputs.ground_normal.tolist(), float(inputs.ground_offset))
        if "compliance" in changed:
            _set_compliance(engine, inputs.compliance[0])
        self._known = inputs
        pull = inputs.mass[..., None] * (inputs.gravity - self._nominal.gravity)
        arm = rotate(torch.tensor(pose, dtype=torch.float64)[None, :, 3:], inputs.centre_of_mass)
        at_mass = inputs.add_torque(-torch.linalg.cross(arm, inputs.wrench[..., 3:])).add_force(pull)
        engine.push(pose, at_mass.wrench[0].tolist())

    @torch.no_grad()
    def _inputs(self, time: float, pose: Array, twist: Array, wrench: Array) -> StepInputs:
        """Return the inputs of a step after all effects."""
        state = State(torch.from_numpy(pose)[None], torch.from_numpy(twist)[None])
        now = torch.tensor([time], dtype=torch.float64)
        inputs = self._nominal.replace(time=now, wrench=torch.from_numpy(wrench)[None])
        for effect in self._effects:
            inputs = effect.act(state, inputs)
        return inputs

    def _changes(self, inputs: StepInputs) -> set[str]:
        """Return the names of the fields that differ from what PyBullet knows."""
        fields = {field.name for field in dataclasses.fields(inputs)} - {"time", "wrench", "gravity"}
        pairs = {name: (getattr(inputs, name), getattr(self._known, name)) for name in fields}
        return {name for name, (new, old) in pairs.items() if new is not old and not torch.equal(new, old)}


def nominal_inputs(scene: Scene) -> StepInputs:
    """Return the inputs of a step without effects, for a batch of one."""
    bodies, count = scene.bodies, len(scene.bodies)

    def batch(values: object) -> Tensor:
        return torch.as_tensor(np.array(values, dtype=float))[None]

    ones, one = torch.ones(1, count, dtype=torch.float64), torch.ones(1, dtype=torch.float64)
    return StepInputs(
        time=torch.zeros(1, dtype=torch.float64),
        wrench=torch.zeros(1, count, 6, dtype=torch.float64),
        gravity=batch([scene.gravity] * count),
        size=batch(scene.sizes),
        mass=batch([body.mass for body in bodies]),
        inertia=batch([body.moments() for body in bodies]),
        friction=batch([body.friction for body in bodies]),
        restitution=batch([body.restitution for body in bodies]),
        ground_normal=batch(scene.ground.normal)[0],
        ground_offset=batch(scene.ground.offset)[0],
        ground_friction=ones,
        ground_restitution=torch.zeros_like(ones),
        body_friction=one,
        body_restitution=torch.zeros_like(one),
        centre_of_mass=torch.zeros(1, count, 3, dtype=torch.float64),
        compliance=torch.zeros(1, count, dtype=torch.float64),
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


def _set_contacts(engine: Engine, inputs: StepInputs) -> None:
    """Tell PyBullet the coefficients of all contacts."""
    values = inputs.friction[0], inputs.restitution[0]
    ground = values[0] * inputs.ground_friction[0], (values[1] + inputs.ground_restitution[0]).clamp_min(0)
    pair = values[0][:2].prod() * inputs.body_friction, (values[1][:2].prod() + inputs.body_restitution).clamp_min(0)
    friction, ground_friction = split_products(ground[0].numpy(), float(pair[0]))
    restitution, ground_restitution = split_products(ground[1].numpy(), float(pair[1]))
    for body, coefficients in enumerate(zip(friction.tolist(), restitution.tolist(), strict=True)):
        engine.set_contact(body, *coefficients)
    engine.set_ground_contact(ground_friction, ground_restitution)


def _set_compliance(engine: Engine, compliance: Tensor) -> None:
    """Tell PyBullet the compliance of the ground."""
    if not bool((compliance == compliance[0]).all()):
        raise ValueError("PyBullet knows one compliance of the ground for all bodies; let them be equal")
    engine.set_ground_compliance(float(compliance[0]))
