"""Which rules of the physics a module predicts with; a key of its configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from physid.effects import from_values
from physid.physics.contact import ContactRule, Speculative
from physid.physics.friction import Cone, FrictionLaw
from physid.physics.layer import PhysicsLayer
from physid.physics.world import Plane, World
from physid.scenes.scene import Scene


@dataclass(frozen=True)
class Engine:
    """The choices that a scene leaves open.

    Attributes:
        contact: When bodies touch; None for `Speculative`.
        friction: Law of friction; None for `Cone`.
        substeps: Steps of the engine per frame.
        gyroscopic: Whether the term w x I w acts (the paper drops it).
        effects: Effects at work, by name, with the values of their parameters: viscous_drag: {coefficient: 0.3}.
    """

    contact: ContactRule | None = None
    friction: FrictionLaw | None = None
    substeps: int = 1
    gyroscopic: bool = True
    effects: Mapping[str, Mapping[str, float]] | None = None

    def layer(self, scene: Scene) -> PhysicsLayer:
        """Build the physics of a scene.

        Raises:
            ValueError: If an effect or a parameter of it does not exist.
        """
        world = World(
            time_step=scene.time_step,
            substeps=self.substeps,
            gravity=scene.gravity,
            ground=Plane(scene.ground.normal, scene.ground.offset),
            friction=self.friction or Cone(),
            contact=self.contact or Speculative(),
            gyroscopic=self.gyroscopic,
        )
        return PhysicsLayer(world, [from_values(name, values) for name, values in (self.effects or {}).items()])
