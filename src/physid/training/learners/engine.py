"""Which rules of the physics a module predicts with; a key of its configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from physid.effects import from_values
from physid.physics import Effect, PhysicsLayer, Plane, World
from physid.physics.contact import ContactRule, Speculative
from physid.physics.contact_problem.friction import Cone, FrictionLaw
from physid.physics.schemes.integration import Integration, Midpoint, SemiImplicit
from physid.scenes import Scene
from physid.strict import LARGEST


@dataclass(frozen=True)
class Engine:
    """The choices that a scene leaves open.

    Attributes:
        contact: When bodies touch; None for `Speculative`, or under `Midpoint` the rule of that.
        friction: Law of friction; None for `Cone`.
        substeps: Steps of the engine per frame; None for those of the simulator that made the recordings, or, where
            nobody says how these were integrated, for as many as it takes (see `chooses`).
        integration: How velocities become poses; None for the scheme of the simulator that made the recordings, or,
            where nobody says, for `Midpoint`.
        gyroscopic: Whether the term w x I w acts (the paper drops it).
        effects: Effects at work, by name, with the values of their parameters: viscous_drag: {coefficient: 0.3}.
    """

    contact: ContactRule | None = None
    friction: FrictionLaw | None = None
    substeps: int | None = None
    integration: Integration | None = None
    gyroscopic: bool = True
    effects: Mapping[str, Mapping[str, float]] | None = None

    def __post_init__(self) -> None:
        most = LARGEST["substeps"]
        if self.substeps is not None and not 1 <= self.substeps <= most:
            raise ValueError(
                f"model.engine.substeps must be from 1 to {most}, or null to choose them, got {self.substeps}"
            )

    def chooses(self, scene: Scene) -> bool:
        """Return whether steps follow from the recordings: nobody says how these were integrated, nor in what steps."""
        return self.substeps is None and scene.integration is None

    def known_effects(self) -> tuple[Effect, ...]:
        """Return the effects at work.

        Raises:
            ValueError: If an effect or a parameter of it does not exist.
        """
        return tuple(from_values(name, values) for name, values in (self.effects or {}).items())

    def layer(self, scene: Scene, effects: Sequence[Effect] | None = None) -> PhysicsLayer:
        """Build the physics of a scene.

        Args:
            scene: Time step, gravity, ground, and how recordings were integrated.
            effects: Effects at work, where some are learned; None for those that are known.

        Raises:
            ValueError: If an effect or a parameter of it does not exist, or scheme and contact contradict each other.
        """
        made = scene.integration
        substeps = self.substeps or (1 if made is None else max(1, round(scene.time_step / made.step)))
        world = World(
            time_step=scene.time_step,
            substeps=substeps,
            gravity=scene.gravity,
            ground=Plane(scene.ground.normal, scene.ground.offset),
            friction=self.friction or Cone(),
            contact=self.contact or Speculative(),
            gyroscopic=self.gyroscopic,
            integration=self.integration or self._scheme(scene),
        )
        return PhysicsLayer(world, self.known_effects() if effects is None else effects)

    def _scheme(self, scene: Scene) -> Integration:
        """Return the scheme of the maker, else that of second order; other rules of contact know the first alone."""
        own_rule = self.contact is not None and self.contact != Speculative()
        if scene.integration is None:
            return SemiImplicit() if own_rule else Midpoint()
        return SemiImplicit(scene.integration.step)
