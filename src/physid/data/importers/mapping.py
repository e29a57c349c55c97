"""What a log means: which column is what, in which units and axes, on which clock. Checked and closed."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from physid.data import SPLITS
from physid.data.importers.rotations import axes_of, check_sequence
from physid.data.importers.units import UNITS, factor_of
from physid.scenes import Body, Ground
from physid.scenes.camera import Triple
from physid.scenes.scene import GRAVITY
from physid.strict import nearest, quoted
from physid.typed_files import CLOSED, check_as, without_nulls

Array = NDArray[np.float64]
Reference = str | float | int  # a column, "-" and a column, or a constant
Line = Annotated[int, Ge(1)]
Positive = Annotated[float, Gt(0)]
ORIENTATIONS = {"quaternion": (4,), "euler": (1, 2, 3), "matrix": (9,), "rotation_vector": (3,), "orientation": ()}
"""How orientations may be written, and in how many columns; "orientation: none" for a body that does not turn."""
GUESSED_FRICTION = 0.3  # where nothing is said: then it is unknown


@dataclass(frozen=True)
class BodyMap:
    """Which columns tell of a body.

    Attributes:
        body: Its nominal properties, SI.
        position: Three references.
        orientation: How orientations are written: a key of `ORIENTATIONS`.
        columns: References of the orientation; none for "orientation".
        order: Of a quaternion (xyzw, wxyz, or None where names tell), or of Euler angles.
        force: Three references, or none.
        torque: Three references, or none.
        visible: Column that is zero where the body was not seen, or None.
        clock: Column of the body's own stamps, or None where all bodies share one.
        tracked_point: Of what the position is, seen from the centre, along the body's edges [m].
    """

    body: Body
    position: tuple[Reference, ...]
    orientation: str
    columns: tuple[Reference, ...]
    order: str | None
    force: tuple[Reference, ...]
    torque: tuple[Reference, ...]
    visible: Reference | None
    clock: Reference | None
    tracked_point: tuple[float, float, float]


@dataclass(frozen=True)
class ForceLog:
    """Where forces are, if not in the rows of the poses.

    Attributes:
        file: A file beside each log of poses; `{stem}` stands for the name of that log, * for anything. None: the same.
        time, rate: Column of stamps, or rows per second; with neither the stamps are those of the poses.
        offset: What is added to their stamps to be on the clock of the poses [s].
        between: What acts between two rows: the first (None too), or what lies on the line from the one to the other.
        axes: Whether forces are in the log's world, or in the axes of the body, as of a sensor that turns with it.
        header: Line that names the columns.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    file: str | None = None
    time: Any = None
    rate: Positive | None = None
    offset: float = 0.0
    between: Literal["held", "linear"] | None = None
    axes: Literal["world", "body"] = "world"
    header: Line | None = None


@dataclass(frozen=True)
class BodyKeys:
    """What a mapping may say of a body; `BodyMap` says what it means. References to columns are checked there."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    name: str | None = None
    size: Triple | None = None
    mass: float | None = None
    friction: float | None = None
    restitution: float = 0.0
    inertia: Triple | None = None
    material: str | None = None
    position: Any = None
    quaternion: Any = None
    euler: Any = None
    matrix: Any = None
    rotation_vector: Any = None
    orientation: Any = None
    order: Literal["xyzw", "wxyz"] | None = None
    euler_order: str | None = None
    force: Any = None
    torque: Any = None
    visible: Any = None
    clock: Any = None
    tracked_point: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class MappingKeys(BodyKeys):
    """What a mapping may say; with one body, the body's keys may stand beside the others."""

    scene: str = "imported"
    time: Any = None
    rate: Positive | None = None
    time_step: Positive | None = None
    units: dict[str, str] = field(default_factory=dict)
    axes: Any = "z-up"
    header: Line | None = None
    trajectory: Any = None
    split: dict[str, Positive] = field(default_factory=dict)
    protocol: str | None = None
    gravity: Triple = GRAVITY
    ground: Ground = field(default_factory=Ground)
    unknown: tuple[str, ...] = ()
    source: str = ""
    lost: Literal["nan", "zeros"] = "nan"
    forces: ForceLog = field(default_factory=ForceLog)
    bodies: tuple[BodyKeys, ...] = ()

    def __post_init__(self) -> None:
        for name, unit in self.units.items():
            if name not in QUANTITIES:
                raise ValueError(f"units: unknown key {quoted(name)}{nearest(name, QUANTITIES)}")
            factor_of("time" if name == "forces_time" else name, unit, f"units.{name}")
        for name in self.split:
            if name not in SPLITS:
                raise ValueError(f"unknown split {quoted(name)}{nearest(name, SPLITS)}")
        if self.rate is not None and self.time_step is not None:
            raise ValueError(f"expected rate or time_step, found both: {self.rate:g} and {self.time_step:g}")
        if self.rate is None and self.time_step is None and self.time is None:
            raise ValueError("missing time, the column of stamps; where there are none, give rate (frames per second)")


OF_BODY = tuple(each.name for each in dataclasses.fields(BodyKeys))
OF_SET = tuple(each.name for each in dataclasses.fields(MappingKeys) if each.name not in OF_BODY)
QUANTITIES = (*UNITS, "forces_time")  # that have units; stamps of forces may have another one than those of poses


@dataclass(frozen=True)
class LogMap:
    """What the columns of logs mean.

    Attributes:
        scene: Name of the scene.
        bodies: The bodies.
        time: Column of stamps, or None where frames come at `time_step`.
        time_step: Nominal time between frames [s]; None where the stamps show it.
        units: Unit of each quantity that is given, by its name in `UNITS`.
        axes: Turns vectors of the log into the world frame, shape (3, 3).
        forces: Where forces are.
        header: Line that names the columns.
        trajectory: Column that numbers trajectories within a file.
        split: Shares of splits; empty for none.
        protocol: How the bodies were excited.
        gravity: In the world frame [m/s^2].
        ground: In the world frame.
        unknown: Parameters to identify.
        source: Free text.
        unsaid: Those of them that nothing is said of.
        lost: "nan", or "zeros" where a row of zeros says that a body was lost.
    """

    scene: str
    bodies: tuple[BodyMap, ...]
    time: Reference | None
    time_step: float | None
    units: Mapping[str, str]
    axes: Array
    forces: ForceLog
    header: int | None
    trajectory: Reference | None
    split: Mapping[str, float]
    protocol: str | None
    gravity: tuple[float, float, float]
    ground: Ground
    unknown: tuple[str, ...]
    unsaid: tuple[str, ...]
    source: str
    lost: str

    @classmethod
    def from_mapping(cls, values: object) -> LogMap:
        """Build it from plain values; with one body, the body's keys may stand beside the others.

        Raises:
            ValueError: If a key is unknown or missing, or values contradict each other.
        """
        given = without_nulls(values)
        if isinstance(given, Mapping):
            own = [name for name in OF_BODY if name in given]
            if given.get("bodies") and own:
                raise ValueError(f"mapping: expected what is of a body under bodies, found {', '.join(own)} beside it")
            if isinstance(given.get("unknown"), str):
                given = {**given, "unknown": [given["unknown"]]}
        known = check_as(MappingKeys, given, "mapping")
        listed = known.bodies or (known,)
        bodies = tuple(_body(one, known.units, index, len(listed)) for index, one in enumerate(listed))
        both = zip(bodies, listed, strict=True)
        unsaid = tuple(f"{one.body.name}.friction" for one, keys in both if keys.friction is None)
        return cls(
            scene=known.scene,
            bodies=bodies,
            time=known.time,
            time_step=known.time_step if known.rate is None else 1 / known.rate,
            units=known.units,
            axes=axes_of(known.axes),
            forces=known.forces,
            header=known.header,
            trajectory=known.trajectory,
            split=known.split,
            protocol=known.protocol,
            gravity=known.gravity,
            ground=known.ground,
            unknown=known.unknown + tuple(name for name in unsaid if name not in known.unknown),
            unsaid=unsaid,
            source=known.source,
            lost=known.lost,
        )


def _body(known: BodyKeys, units: Mapping[str, str], index: int, count: int) -> BodyMap:
    """Build the map of one body."""
    where = f"bodies[{index}]." if count > 1 else ""
    for name, why in (
        ("position", "the columns of its centre, say [x, y, z]"),
        ("size", "its edges, say [0.1, 0.1, 0.05]"),
        ("mass", "in kg; a first guess where it is unknown"),
    ):
        if getattr(known, name) is None:
            raise ValueError(f"mapping: missing {where}{name}: {why}")
    assert known.size is not None
    assert known.mass is not None
    length = factor_of("size", units.get("size", "m"), "units.size")
    kind, columns = _orientation(known, where)
    if kind == "euler":
        check_sequence(known.euler_order or "", columns)
    elif known.order is not None and kind != "quaternion":
        raise ValueError(f"{where}order: expected xyzw or wxyz of a quaternion, found it beside {kind}")
    (width, depth, height), (x, y, z) = known.size, known.tracked_point
    return BodyMap(
        body=Body(
            name=known.name or ("block" if count == 1 else f"body{index}"),
            size=(width * length, depth * length, height * length),
            mass=known.mass * factor_of("mass", units.get("mass", "kg"), "units.mass"),
            friction=GUESSED_FRICTION if known.friction is None else known.friction,
            restitution=known.restitution,
            inertia=known.inertia,
            material=known.material,
        ),
        position=_references(known.position, f"{where}position", 3),
        orientation=kind,
        columns=columns,
        order=known.euler_order if kind == "euler" else known.order,
        force=_references(known.force, f"{where}force", 3),
        torque=_references(known.torque, f"{where}torque", 3),
        visible=known.visible,
        clock=known.clock,
        tracked_point=(x * length, y * length, z * length),
    )


def _orientation(known: BodyKeys, where: str) -> tuple[str, tuple[Reference, ...]]:
    """Return how orientations are written, and their columns."""
    given = [name for name in ORIENTATIONS if getattr(known, name) is not None]
    if len(given) != 1:
        raise ValueError(
            f"mapping: expected one of {', '.join(f'{where}{name}' for name in ORIENTATIONS)}, found "
            f"{' and '.join(given) or 'none'}; where a body does not turn: orientation: none"
        )
    value = getattr(known, given[0])
    if given[0] == "orientation":
        if str(value).lower() != "none":
            raise ValueError(f"{where}orientation: expected none, for a body that does not turn, got {value!r}")
        return "orientation", ()
    return given[0], _references(value, f"{where}{given[0]}", *ORIENTATIONS[given[0]])


def _references(value: object, where: str, *lengths: int) -> tuple[Reference, ...]:
    """Return references to columns: a list of so many, or the one name of an array that holds as many."""
    if value is None:
        return ()
    listed = value if isinstance(value, list | tuple) else [value]
    if not all(isinstance(one, str | int | float) and not isinstance(one, bool) for one in listed):
        raise ValueError(f"{where}: expected names of columns, got {value!r}")
    if len(listed) not in (1, *lengths):
        raise ValueError(f"{where}: expected {' or '.join(map(str, lengths))} columns, got {len(listed)}: {listed}")
    return tuple(listed)
