"""The torch effects at work inside MuJoCo: a batch of worlds, no gradient."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physid.physics import Effect, StepInputs
from physid.scenes import Scene
from physid.simulators.inputs import ChangingInputs
from physid.simulators.mujoco.engine import Engine, poses_and_twists

Array = NDArray[np.float64]


class Hooks:
    """Feeds MuJoCo worlds what a list of effects makes of the inputs of each step (see `simulators.in_step.Worlds`).

    Args:
        scene: The scene, with its nominal parameters.
        effects: Effects, applied in this order.
        pose: Initial poses, shape (B, N, 7).
        twist: Initial twists, shape (B, N, 6).
        step: Length of one step [s].

    Attributes:
        engines: The B worlds, with the sizes, masses, moments and centres of mass of the first step.

    Raises:
        ValueError: If an effect is PyBullet's own.
    """

    def __init__(self, scene: Scene, effects: Sequence[Effect], pose: Array, twist: Array, step: float) -> None:
        for effect in effects:
            if hasattr(effect, "settings"):
                raise ValueError(f"the effect {effect.name} is a setting of PyBullet's own, which MuJoCo does not have")
        self._inputs = ChangingInputs(scene, effects, len(pose))
        worlds = self._inputs.build(pose, twist)
        self.engines = [Engine(scene.with_bodies(bodies), step, centres) for bodies, centres in worlds]
        for engine, *state in zip(self.engines, pose, twist, strict=True):
            engine.set_state(*state)

    def states(self) -> list[tuple[Array, Array]]:
        """Return the present pose and twist of each world."""
        return [engine.state() for engine in self.engines]

    def advance(self) -> None:
        """Take one step."""
        for engine in self.engines:
            engine.advance()

    def keep(self, worlds: int) -> None:
        """Go on with the first so many worlds."""
        self._inputs.keep(worlds)
        self.engines = self.engines[:worlds]

    def act(self, time: Array, wrench: Array) -> None:
        """Apply wrenches and changed parameters for the next step.

        Args:
            time: Times since the first frames [s], shape (B,).
            wrench: Acting wrenches, shape (B, N, 6).

        Raises:
            ValueError: If an effect changes what MuJoCo cannot change.
        """
        pose, twist = poses_and_twists(self.states())
        inputs = self._inputs.at(time, pose, twist, wrench)
        self._tell(inputs)
        pull = (inputs.mass[..., None] * (inputs.gravity - self._inputs.nominal.gravity)).numpy()
        for engine, load, at_mass in zip(self.engines, inputs.wrench.numpy(), pull, strict=True):
            engine.push(load, at_mass)

    def _tell(self, inputs: StepInputs) -> None:
        """Tell MuJoCo what differs from what it knows."""
        changed = self._inputs.changes(inputs, "MuJoCo")
        for world in sorted({*changed.get("mass", []), *changed.get("inertia", [])}):
            self.engines[world].set_inertia(inputs.mass[world].numpy(), inputs.inertia[world].numpy())
        rubbing = [worlds for name, worlds in changed.items() if "friction" in name or "restitution" in name]
        if rubbing:
            self._set_contacts(inputs, sorted(set().union(*rubbing)))
        if changed.keys() & {"ground_normal", "ground_offset"}:
            for engine in self.engines:
                engine.place_ground(inputs.ground_normal.numpy(), float(inputs.ground_offset))
        for world in changed.get("compliance", []):
            self.engines[world].set_compliance(inputs.compliance[world].numpy())
        self._inputs.known = inputs

    def _set_contacts(self, inputs: StepInputs, worlds: Sequence[int]) -> None:
        """Tell some worlds the coefficients of all contacts: products, changed as `StepInputs` says."""
        friction, restitution = inputs.friction, inputs.restitution
        values = (
            friction * inputs.ground_friction,
            (restitution + inputs.ground_restitution).clamp_min(0),
            friction[:, :, None] * friction[:, None] * inputs.body_friction[:, None, None],
            (restitution[:, :, None] * restitution[:, None] + inputs.body_restitution[:, None, None]).clamp_min(0),
        )
        for world in worlds:
            self.engines[world].set_contacts(*(value[world].numpy() for value in values))
