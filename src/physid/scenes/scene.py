"""What stands on the ground, as `recording.yaml` describes it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from physid.scenes.camera import Camera, Triple
from physid.strict import LARGEST, LARGEST_VALUE, nearest, number, quoted, seen, shown, triple
from physid.typed_files import CLOSED

PARAMETERS = ("mass", "friction", "restitution")
ROUNDED = 0.01  # share by which moments of three digits, of a thin plate, may be off
HIGHEST_RESTITUTION = 1.0  # with more, every bounce makes energy
SEMI_IMPLICIT_EULER = "semi_implicit_euler"
SCHEMES = (SEMI_IMPLICIT_EULER,)
GRAVITY: Triple = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Body:
    """A box.

    Attributes:
        name: How parameters refer to it ("block" in "block.friction").
        size: Full edge lengths [m].
        mass: Mass [kg].
        friction: Coulomb coefficient [-]; a pair has the product, the ground's is 1.
        restitution: Newton coefficient [-]; a pair has the product, the ground's is 1.
        inertia: Principal moments [kg m^2], or None for a uniform box.
        material: What it is made of; bodies of one material share friction and restitution. None: of its own.

    Raises:
        ValueError: If a value is of the wrong kind or sign, or a name holds what is not seen.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    name: str
    size: Triple
    mass: float
    friction: float
    restitution: float = 0.0
    inertia: Triple | None = None
    material: str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name or "." in self.name:
            raise ValueError(f"body name must be a word without a full stop, got {shown(self.name)}")
        seen(self.name, "body name")
        if min(triple(self.size, f"{self.name}.size")) <= 0 or max(self.size) > LARGEST_VALUE:
            raise ValueError(f"{self.name}.size must be positive edge lengths, got {self.size}")
        number(self.mass, f"{self.name}.mass", low=0.0, high=LARGEST_VALUE, strict=True)
        number(self.friction, f"{self.name}.friction", low=0.0, high=LARGEST_VALUE)
        if number(self.restitution, f"{self.name}.restitution", low=0.0) > HIGHEST_RESTITUTION:
            raise ValueError(
                f"{self.name}.restitution must be at most {HIGHEST_RESTITUTION:g}: a bounce makes no energy, "
                f"got {self.restitution:g}"
            )
        if self.material is not None and (not isinstance(self.material, str) or not self.material):
            raise ValueError(f"{self.name}.material must be a word or null, got {shown(self.material)}")
        seen(self.material or "", f"{self.name}.material")
        if self.inertia is not None:
            self._check_moments(self.inertia)

    def _check_moments(self, inertia: Triple) -> None:
        """Refuse what no distribution of mass has: the sum of two moments is at least the third."""
        low, middle, high = sorted(triple(inertia, f"{self.name}.inertia"))
        if low <= 0:
            raise ValueError(f"{self.name}.inertia must be positive principal moments or null, got {inertia}")
        if high > (low + middle) * (1 + ROUNDED):
            raise ValueError(
                f"{self.name}.inertia must be moments of which none is more than the sum of the others, got {inertia}; "
                "leave it out for a uniform box"
            )

    def moments(self) -> NDArray[np.float64]:
        """Return the principal moments [kg m^2], (3,): those given, or I_x = m (b^2 + c^2) / 12 and so on."""
        if self.inertia is not None:
            return np.array(self.inertia)
        square = np.square(self.size)
        return np.asarray(self.mass * (square.sum() - square) / 12)


@dataclass(frozen=True)
class Ground:
    """The points p with normal . p = offset [m]; the normal is of unit length.

    Raises:
        ValueError: If the normal is not a unit vector.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    normal: Triple = (0.0, 0.0, 1.0)
    offset: float = 0.0

    def __post_init__(self) -> None:
        length = math.hypot(*triple(self.normal, "ground.normal"))
        if abs(length - 1) > 1e-6:
            raise ValueError(f"ground.normal must have length 1, got {length:.6g}; divide it by its length")
        number(self.offset, "ground.offset")


@dataclass(frozen=True)
class Integration:
    """The integrator of the simulator that made recordings.

    Only a simulator has one: recordings of the real world, and those of which nothing is known, carry none, and nothing
    may be assumed of them.

    Attributes:
        scheme: `semi_implicit_euler`: v+ = v + h a, then x+ = x + h v+, as PyBullet does.
        step: Length h of its steps [s].

    Raises:
        ValueError: If the scheme is unknown, or the step is not positive.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    scheme: str
    step: float

    def __post_init__(self) -> None:
        if self.scheme not in SCHEMES:
            raise ValueError(
                f'integration.scheme: unknown scheme "{self.scheme}"{nearest(self.scheme, SCHEMES)}; leave '
                "`integration` out where it is another one, or not known"
            )
        number(self.step, "integration.step", low=0.0, strict=True)


@dataclass(frozen=True)
class Scene:
    """A scene, as far as it is known: the content of `recording.yaml`.

    Attributes:
        name: push, slide, collide, toss, or any other name.
        time_step: Time between frames [s].
        ground: The plane that the bodies stand on.
        bodies: The boxes, in the order of axis N.
        unknown: Parameters to identify ("block.friction"); the values in `bodies` are then only a first guess.
        camera: The camera, or None where there is no video.
        gravity: Acceleration of gravity [m/s^2], world frame.
        source: Free text: where the recordings come from.
        integration: How the simulator that made them integrated; None where no simulator did, or nothing is known.

    Raises:
        ValueError: If a value is of the wrong kind, the name holds what is not seen, two bodies share a name, or an
            unknown parameter has no body.
    """

    name: str
    time_step: float
    ground: Ground
    bodies: tuple[Body, ...]
    unknown: tuple[str, ...] = ()
    camera: Camera | None = None
    gravity: Triple = GRAVITY
    source: str = ""
    integration: Integration | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise ValueError(f"scene must be a name, got {shown(self.name)}")
        seen(self.name, "scene")
        number(self.time_step, "time_step", low=0.0, strict=True)
        triple(self.gravity, "gravity")
        names = [body.name for body in self.bodies]
        if not names or len(set(names)) < len(names):
            raise ValueError(f"bodies must be at least one, each with its own name, got {names}")
        if self.integration is not None and round(self.time_step / self.integration.step, 3) > LARGEST["substeps"]:
            raise ValueError(
                f"integration.step must be at least time_step / {LARGEST['substeps']}, got {self.integration.step:g} s "
                f"of {self.time_step:g} s"
            )
        for parameter in self.unknown:
            self.locate(parameter)
        if twice := {name for name in self.unknown if self.unknown.count(name) > 1}:
            raise ValueError(f"unknown: {', '.join(sorted(twice))} is named twice; name it once")

    @property
    def sizes(self) -> NDArray[np.float64]:
        """Full edge lengths of the bodies [m], shape (N, 3)."""
        return np.array([body.size for body in self.bodies])

    def locate(self, parameter: str) -> tuple[int, str]:
        """Return the index of the body and the field that "body.field" names.

        Raises:
            ValueError: If there is no such body, or no such parameter.
        """
        name, _, field = str(parameter).partition(".")
        known = [f"{body.name}.{each}" for body in self.bodies for each in PARAMETERS]
        if f"{name}.{field}" not in known:
            raise ValueError(f"unknown parameter {quoted(parameter)}{nearest(parameter, known)}")
        return [body.name for body in self.bodies].index(name), field

    def value(self, parameter: str) -> float:
        """Return the value of "body.field"."""
        index, field = self.locate(parameter)
        return float(getattr(self.bodies[index], field))

    def with_bodies(self, bodies: Iterable[Body]) -> Scene:
        """Return a copy with other bodies."""
        return dataclasses.replace(self, bodies=tuple(bodies))
