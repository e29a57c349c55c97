"""The nominal model: the scene with its unknown parameters, as the PhysicsLayer simulates it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import torch
from torch import Tensor

from physid.estimation.prediction.coordinates import Coordinates
from physid.physics import Effect, Parameters, Plane, State, StepInputs, World, with_sizes
from physid.physics.case import nominal_inputs
from physid.physics.contact import ContactRule, Speculative, Split
from physid.physics.schemes.integration import Midpoint, SemiImplicit
from physid.scenes import Scene, bodies_of, with_parameters


@dataclass(frozen=True)
class NominalModel:
    """What is believed of the system before the diagnosis.

    Attributes:
        scene: Bodies, ground, gravity; values of unknown parameters are a first guess.
        effects: Effects that are known already, with their values.
        substeps: Steps of the engine per frame; None for those of the maker of the recordings, or as many as it takes.
        contact: When bodies touch, in steps of a simulator that is known; None for Bullet's `Split`.
        rules: Rules of the physics, where they are given; None for those that follow from the scene.
        logarithmic: Whether a restitution is fitted as a logarithm too, and therefore never zero.
        sizes: Parameters of the effects that are unknown ("viscous_drag.coefficient"); their values are a first guess.
    """

    scene: Scene
    effects: tuple[Effect, ...] = ()
    substeps: int | None = None
    contact: ContactRule | None = None
    rules: World | None = None
    logarithmic: bool = False
    sizes: tuple[str, ...] = ()

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of the parameters that are fitted ("block.friction"), those of effects last."""
        return (*self.scene.unknown, *self.sizes)

    @cached_property
    def coordinates(self) -> Coordinates:
        """The coordinates of the fit."""
        return Coordinates.of(self.unknown, logarithmic=self.logarithmic)

    @property
    def world(self) -> World:
        """The static description that the PhysicsLayer takes."""
        if self.rules is not None:
            return self.rules
        ground = Plane(self.scene.ground.normal, self.scene.ground.offset)
        known = self.scene.integration is not None
        return World(
            self.scene.time_step,
            1,
            self.scene.gravity,
            ground,
            contact=(self.contact or Split()) if known else Speculative(),
            integration=SemiImplicit(self.made_in) if known else Midpoint(),
        )

    @property
    def made_in(self) -> float | None:
        """Length of the steps of the simulator that made the recordings [s]; None where nobody says."""
        return None if self.scene.integration is None else self.scene.integration.step

    @property
    def guess(self) -> Tensor:
        """First guess of the unknown parameters in the coordinates of the fit, shape (P,)."""
        sizes = [float(self._effect(label).values()[label.partition(".")[2]]) for label in self.sizes]
        values = [self.scene.value(name) for name in self.scene.unknown] + sizes
        return self.to_coordinates(torch.tensor(values, dtype=torch.float64))

    def to_coordinates(self, values: Tensor) -> Tensor:
        """Return the coordinates of values (..., P)."""
        return self.coordinates.to_coordinates(values)

    def to_values(self, coordinates: Tensor) -> Tensor:
        """Invert `to_coordinates`; beyond an end of its range every value is that of the end."""
        return self.coordinates.to_values(coordinates)

    def slopes(self, coordinates: Tensor) -> Tensor:
        """Return d value / d coordinate, shape (..., P)."""
        return self.coordinates.slopes(coordinates)

    def scene_at(self, coordinates: Tensor) -> Scene:
        """Return the scene with the values of bodies that coordinates (P,) stand for."""
        values = self.to_values(coordinates).tolist()
        return with_parameters(
            self.scene, dict(zip(self.scene.unknown, values[: len(self.scene.unknown)], strict=True))
        )

    def with_unknown(self, which: Sequence[int], coordinates: Tensor) -> NominalModel:
        """Return the model with some of its unknown parameters; the others have the values of coordinates (P,)."""
        names = tuple(self.unknown[k] for k in which)
        scene = replace(self.scene_at(coordinates), unknown=tuple(one for one in names if one in self.scene.unknown))
        sizes = tuple(one for one in names if one in self.sizes)
        return replace(self, scene=scene, effects=self.effects_at(coordinates[None]), sizes=sizes)

    def effects_at(self, coordinates: Tensor) -> tuple[Effect, ...]:
        """Return the effects with the sizes that coordinates (C, P) stand for, shape (C,); known ones as they are."""
        return with_sizes(self.effects, self.sizes_at(coordinates))

    def sizes_at(self, coordinates: Tensor) -> dict[str, Tensor]:
        """Return the unknown parameters of effects by name, for coordinates (C, P), shape (C,) each."""
        values = self.to_values(coordinates)[:, len(self.scene.unknown) :]
        return dict(zip(self.sizes, values.unbind(1), strict=True))

    def parameters(self, coordinates: Tensor) -> Parameters:
        """Build the parameters of a batch.

        Args:
            coordinates: Unknown parameters in the coordinates of the fit, shape (B, P).
        """
        bodies, new = self.scene.bodies, partial(torch.tensor, dtype=torch.float64, device=coordinates.device)
        values = self.to_values(coordinates)
        fields = {
            name: new([[getattr(body, name) for body in bodies]]).expand(len(values), -1)
            for name in ("mass", "friction", "restitution")
        }
        for column, name in enumerate(self.scene.unknown):
            field, own = name.partition(".")[2], torch.zeros(len(bodies), dtype=torch.bool, device=values.device)
            own[list(bodies_of(self.scene, name))] = True
            fields[field] = torch.where(own, values[:, column, None], fields[field])
        moments, mass = new([[body.moments().tolist() for body in bodies]]), new([[body.mass for body in bodies]])
        inertia = moments * (fields["mass"] / mass)[..., None]
        size = new([[body.size for body in bodies]])
        return Parameters(size, fields["mass"], inertia, fields["friction"], fields["restitution"])

    def inputs(self, state: State, coordinates: Tensor) -> StepInputs:
        """Return the inputs of the first step without effects and without forces, from B states.

        Args:
            state: States.
            coordinates: Unknown parameters in the coordinates of the fit, shape (B, P), or (1, P) for all alike.
        """
        return nominal_inputs(state, torch.zeros_like(state.twist)[:, None], self.parameters(coordinates), self.world)

    def _effect(self, label: str) -> Effect:
        return next(effect for effect in self.effects if effect.name == label.partition(".")[0])
