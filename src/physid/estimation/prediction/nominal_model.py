"""The nominal model: the scene with its unknown parameters, as the PhysicsLayer simulates it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from physid.physics.contact import ContactRule, Speculative, Split
from physid.physics.effect import Effect
from physid.physics.parameters import Parameters
from physid.physics.schemes.integration import Midpoint, SemiImplicit
from physid.physics.shapes.box import Box
from physid.physics.world import Plane, World
from physid.scenes.parameters import bodies_of, highest_value
from physid.scenes.scene import Scene

SMALLEST = 1e-6


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
    """

    scene: Scene
    effects: tuple[Effect, ...] = ()
    substeps: int | None = None
    contact: ContactRule | None = None
    rules: World | None = None
    logarithmic: bool = False

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of the parameters that are fitted ("block.friction")."""
        return self.scene.unknown

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
            integration=SemiImplicit() if known else Midpoint(),
        )

    @property
    def guess(self) -> Tensor:
        """First guess of the unknown parameters in the coordinates of the fit, shape (P,)."""
        values = [self.scene.value(name) for name in self.unknown]
        return self.to_coordinates(torch.tensor(values, dtype=torch.float64))

    def to_coordinates(self, values: Tensor) -> Tensor:
        """Return logarithms of masses and friction coefficients; see `logarithmic` for restitution. Shape (..., P)."""
        return torch.where(self._linear, values, values.clamp_min(SMALLEST).log())

    def to_values(self, coordinates: Tensor) -> Tensor:
        """Invert `to_coordinates`; a restitution is cut at 0 and 1."""
        values = torch.where(self._linear, coordinates.clamp_min(0), coordinates.clamp(-14, 14).exp())
        return values.minimum(self._highest)

    def slopes(self, coordinates: Tensor) -> Tensor:
        """Return d value / d coordinate, shape (..., P)."""
        return torch.where(self._linear, torch.ones_like(coordinates), self.to_values(coordinates))

    def parameters(self, coordinates: Tensor) -> Parameters:
        """Build the parameters of a batch.

        Args:
            coordinates: Unknown parameters in the coordinates of the fit, shape (B, P).
        """
        batch, bodies = coordinates.shape[0], self.scene.bodies
        values = self.to_values(coordinates)
        fields = {
            name: torch.tensor([[getattr(body, name) for body in bodies]], dtype=torch.float64).repeat(batch, 1)
            for name in ("mass", "friction", "restitution")
        }
        for column, name in enumerate(self.unknown):
            field = name.partition(".")[2]
            for number in bodies_of(self.scene, name):
                fields[field][:, number] = values[:, column]
        size = torch.tensor([[body.size for body in bodies]], dtype=torch.float64)
        inertia = Box().inertia(fields["mass"], size)
        for index, body in enumerate(bodies):
            if body.inertia is not None:
                given = torch.tensor(body.inertia, dtype=torch.float64)
                inertia[:, index] = given * (fields["mass"][:, index, None] / body.mass)
        return Parameters.of_boxes(size, fields["mass"], fields["friction"], fields["restitution"], inertia)

    @cached_property
    def _highest(self) -> Tensor:
        return torch.tensor([highest_value(name) for name in self.unknown], dtype=torch.float64)

    @cached_property
    def _linear(self) -> Tensor:
        linear = [name.endswith(".restitution") and not self.logarithmic for name in self.unknown]
        return torch.tensor(linear, dtype=torch.bool)
