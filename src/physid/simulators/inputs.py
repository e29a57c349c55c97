"""What effects make of the inputs of a step, for a batch of worlds that a simulator steps; no gradient."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physid.physics import Effect, State, StepInputs, widths_of
from physid.scenes import Body, Scene

Array = NDArray[np.float64]
SHARED = tuple(widths_of("ground"))  # the fields of StepInputs that all worlds of a batch share
BUILT_IN = ("size", "mass", "inertia", "centre_of_mass")  # what bodies are built with
NOT_COMPARED = ("time", "wrench", "gravity")  # what every step has anew, or is told as a force


class ChangingInputs:
    """The inputs of each step under a list of effects, and what of them a simulator does not know yet.

    An effect is a formula of torch for a batch: that costs about as much for one world as for all.

    Args:
        scene: The scene, with its nominal parameters.
        effects: Effects, applied in this order.
        worlds: How many worlds.

    Attributes:
        nominal: The inputs without effects.
        known: What the simulator was told last.
    """

    def __init__(self, scene: Scene, effects: Sequence[Effect], worlds: int) -> None:
        self._scene, self._effects = scene, tuple(effects)
        self.nominal = nominal_inputs(scene, worlds)
        self.known = self.nominal

    def build(self, pose: Array, twist: Array) -> list[tuple[list[Body], Array]]:
        """Return the bodies of each world as they are at the first step, and their centres of mass (N, 3).

        Args:
            pose: Initial poses, shape (B, N, 7).
            twist: Initial twists, shape (B, N, 6).
        """
        first = self.at(np.zeros(len(pose)), pose, twist, np.zeros_like(twist))
        self.known = self.nominal.replace(
            **{name: getattr(first, name).expand_as(getattr(self.nominal, name)) for name in BUILT_IN}
        )
        rows = zip(*(getattr(self.known, name) for name in BUILT_IN), strict=True)
        return [(self._bodies(size, mass, moments), centres.numpy()) for size, mass, moments, centres in rows]

    def _bodies(self, sizes: Tensor, masses: Tensor, moments: Tensor) -> list[Body]:
        """Return the bodies of one world, from sizes (N, 3), masses (N,) and moments (N, 3)."""
        rows = zip(self._scene.bodies, sizes.tolist(), masses.tolist(), moments.tolist(), strict=True)
        return [
            dataclasses.replace(body, size=tuple(size), mass=mass, inertia=tuple(moment))
            for body, size, mass, moment in rows
        ]

    @torch.no_grad()
    def at(self, time: Array, pose: Array, twist: Array, wrench: Array) -> StepInputs:
        """Return the inputs of a step after all effects.

        Args:
            time: Times since the first frames [s], shape (B,).
            pose: Present poses, shape (B, N, 7).
            twist: Present twists, shape (B, N, 6).
            wrench: Acting wrenches, shape (B, N, 6).
        """
        state = State(torch.from_numpy(pose), torch.from_numpy(twist))
        inputs = self.nominal.replace(time=torch.from_numpy(time), wrench=torch.from_numpy(wrench))
        for effect in self._effects:
            inputs = effect.act(state, inputs)
        return inputs

    def keep(self, worlds: int) -> None:
        """Go on with the first so many worlds."""
        self.nominal, self.known = _first(self.nominal, worlds), _first(self.known, worlds)

    def changes(self, inputs: StepInputs, simulator: str) -> dict[str, list[int]]:
        """Return the names of the fields that differ from what is known, and in which worlds they do.

        Raises:
            ValueError: If sizes or centres of mass changed, which no simulator can do.
        """
        found = {}
        for name, new in inputs.tensors().items():
            old = getattr(self.known, name)
            if name not in NOT_COMPARED and new is not old and not torch.equal(new, old):
                differs = new != old
                found[name] = (
                    [] if name in SHARED else differs.reshape(len(differs), -1).any(1).nonzero()[:, 0].tolist()
                )
        if found.keys() & {"size", "centre_of_mass"}:
            raise ValueError(f"{simulator} cannot change sizes or centres of mass between steps; let them be constant")
        return found


def _first(inputs: StepInputs, worlds: int) -> StepInputs:
    """Return the inputs of the first so many worlds."""
    return inputs.replace(**{name: value[:worlds] for name, value in inputs.tensors(but=("ground",)).items()})


def nominal_inputs(scene: Scene, worlds: int = 1) -> StepInputs:
    """Return the inputs of a step without effects and without forces, for a batch of worlds."""
    like = torch.zeros(worlds, len(scene.bodies), 7, dtype=torch.float64)
    known: dict[str, object] = {
        name: [[getattr(body, name) for body in scene.bodies]] for name in ("mass", "friction", "restitution")
    }
    known |= {"size": [scene.sizes], "inertia": [[body.moments() for body in scene.bodies]]}
    known |= {"gravity": [[scene.gravity] * len(scene.bodies)], "wrench": np.zeros((1, len(scene.bodies), 6))}
    known |= {"ground_normal": scene.ground.normal, "ground_offset": scene.ground.offset}
    return StepInputs.nominal(like, {name: like.new_tensor(np.array(value)) for name, value in known.items()})
