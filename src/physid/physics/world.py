"""What a world is made of beside its bodies: gravity, ground, joints, and the rules of contact."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import combinations

from physid.physics.contact import ContactRule, Speculative
from physid.physics.contact_problem.friction import Cone, FrictionLaw
from physid.physics.joints import Joint
from physid.physics.schemes.integration import Integration, Midpoint, SemiImplicit
from physid.physics.schemes.units import velocity_unit
from physid.physics.shapes.shape import Shape
from physid.physics.shapes.table import contacts_of

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Plane:
    """The half space below the points p with normal . p = offset [m]; `normal` is made a unit vector."""

    normal: Vector = (0.0, 0.0, 1.0)
    offset: float = 0.0

    def __post_init__(self) -> None:
        length = math.sqrt(sum(x * x for x in self.normal))
        if not (math.isfinite(length) and length > 0):
            raise ValueError(f"normal must be a finite vector other than zero, got {self.normal}")
        x, y, z = self.normal
        object.__setattr__(self, "normal", (x / length, y / length, z / length))


@dataclass(frozen=True)
class World:
    """Everything of a simulation that is neither a state nor an identified parameter.

    Attributes:
        time_step: Time between frames, over which a wrench is held [s].
        substeps: Steps of the engine per frame.
        gravity: [m/s^2], world frame.
        ground: The ground, or None.
        joints: Equality joints.
        friction: Law of friction: a circular cone, or the paper's `Pyramid(directions)`.
        contact: When bodies touch: `Speculative`, or as in Bullet `Penetrating` or `Split`.
        gyroscopic: Whether the term w x I w acts (the paper drops it).
        integration: How velocities become poses: `SemiImplicit` for recordings of a simulator that steps so, `Midpoint`
            for any other. `Midpoint` has a rule of contact of its own.
        shapes: Those of the bodies, in their order; none where all are boxes.

    Raises:
        ValueError: If a value is off, or nobody knows the contacts of two of the shapes.
    """

    time_step: float = 1 / 240
    substeps: int = 1
    gravity: Vector = (0.0, 0.0, -9.81)
    ground: Plane | None = field(default_factory=Plane)
    joints: tuple[Joint, ...] = ()
    friction: FrictionLaw = field(default_factory=Cone)
    contact: ContactRule = field(default_factory=Speculative)
    gyroscopic: bool = True
    integration: Integration = field(default_factory=SemiImplicit)
    shapes: tuple[Shape, ...] = ()

    def __post_init__(self) -> None:
        if not (math.isfinite(self.time_step) and self.time_step > 0):
            raise ValueError(f"time_step must be positive [s], got {self.time_step}")
        if self.substeps < 1:
            raise ValueError(f"substeps must be at least 1, got {self.substeps}")
        if self.midpoint and self.contact != Speculative():
            raise ValueError(
                f"contact must be left out with integration=Midpoint(), which has a rule of its own, got {self.contact}"
            )

        for first, second in combinations(self.shapes, 2):
            contacts_of(first, second)

    @property
    def midpoint(self) -> bool:
        """Whether poses move with the mean velocity."""
        return isinstance(self.integration, Midpoint)

    @property
    def single_step(self) -> float | None:
        """Length [s] of the steps of a simulator that those of the engine follow (see `SemiImplicit`)."""
        return self.integration.step if isinstance(self.integration, SemiImplicit) else None

    @property
    def step(self) -> float:
        """Length of one step of the engine [s]."""
        return self.time_step / self.substeps

    @property
    def velocity_unit(self) -> float:
        """Unit of velocities in the contact problem of a step [m/s]."""
        return velocity_unit(self.step, midpoint=self.midpoint)
