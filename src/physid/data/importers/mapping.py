"""What a log means: which column is what, in which units and axes, on which clock. Checked and closed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.rotations import axes_of, check_sequence
from physid.data.importers.units import UNITS, factor_of
from physid.data.recording import SPLITS
from physid.scenes.scene import GRAVITY, Body, Ground
from physid.strict import check_keys, nearest, number, triple, whole
from physid.typed_files import check_as

Array = NDArray[np.float64]
Reference = str | float | int  # a column, "-" and a column, or a constant
ORDERS = ("xyzw", "wxyz")
ORIENTATIONS = ("quaternion", "euler", "matrix", "rotation_vector", "orientation")
OF_BODY = (
    "name", "size", "mass", "friction", "restitution", "inertia", "material", "position", *ORIENTATIONS, "order",
    "euler_order", "force", "torque", "visible", "tracked_point",
)  # fmt: skip
OF_SET = (
    "scene", "time", "rate", "time_step", "units", "axes", "header", "trajectory", "split", "protocol", "gravity",
    "ground", "unknown", "source", "lost", "forces", "bodies",
)  # fmt: skip
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
    tracked_point: tuple[float, float, float]


@dataclass(frozen=True)
class ForceLog:
    """Where forces are, if not in the rows of the poses.

    Attributes:
        file: A file beside each log of poses; `{stem}` stands for the name of that log, * for anything. None: the same.
        time: Column of stamps; None for that of the poses, or `rate`.
        rate: Rows per second where there are no stamps.
        offset: What is added to their stamps to be on the clock of the poses [s].
        header: Line that names the columns.
    """

    file: str | None = None
    time: Reference | None = None
    rate: float | None = None
    offset: float = 0.0
    header: int | None = None


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
        known = dict(check_keys(values, "mapping", (), (*OF_SET, *OF_BODY)))
        own = {name: known.pop(name) for name in OF_BODY if name in known}
        if known.get("bodies") is not None and own:
            raise ValueError(f"mapping: expected what is of a body under bodies, found {', '.join(own)} beside them")
        listed = known.get("bodies") or [own]
        if not isinstance(listed, list):
            raise ValueError(f"bodies: expected a list, got {listed!r}")
        units = _units(known.get("units") or {})
        bodies = tuple(_body(one, units, index, len(listed)) for index, one in enumerate(listed))
        header, lost = known.get("header"), str(known.get("lost", "nan"))
        if lost not in ("nan", "zeros"):
            raise ValueError(f"lost: expected nan or zeros, got {lost!r}")
        named, unsaid = known.get("unknown") or (), _unsaid(listed, bodies)
        unknown = tuple(map(str, named if isinstance(named, list | tuple) else [named]))
        return cls(
            scene=str(known.get("scene") or "imported"),
            bodies=bodies,
            time=known.get("time"),
            time_step=_step(known),
            units=units,
            axes=axes_of(known.get("axes") or "z-up"),
            forces=_forces(known.get("forces") or {}),
            header=None if header is None else whole(header, "header", low=1),
            trajectory=known.get("trajectory"),
            split=_shares(known.get("split") or {}),
            protocol=None if known.get("protocol") is None else str(known["protocol"]),
            gravity=triple(known.get("gravity", GRAVITY), "gravity"),
            ground=check_as(Ground, _plain(known.get("ground"), "ground"), "ground"),
            unknown=unknown + tuple(name for name in unsaid if name not in unknown),
            unsaid=unsaid,
            source=str(known.get("source") or ""),
            lost=lost,
        )


def _body(values: object, units: Mapping[str, str], index: int, count: int) -> BodyMap:
    """Build the map of one body."""
    where = f"bodies[{index}]." if count > 1 else ""
    known = check_keys(values, f"bodies[{index}]", (), OF_BODY)
    for name, why in (
        ("position", "the columns of its centre, say [x, y, z]"),
        ("size", "its edges, say [0.1, 0.1, 0.05]"),
        ("mass", "in kg; a first guess where it is unknown"),
    ):
        if known.get(name) is None:
            raise ValueError(f"mapping: missing {where}{name}: {why}")
    length = factor_of("size", units.get("size", "m"), "units.size")
    size = triple(known["size"], f"{where}size")
    inertia = known.get("inertia")
    kind, columns = _orientation(known, where)
    order = known.get("euler_order") if kind == "euler" else known.get("order")
    if kind == "euler":
        check_sequence(str(order or ""), columns)
    elif order is not None and (kind != "quaternion" or order not in ORDERS):
        raise ValueError(f"{where}order: expected xyzw or wxyz of a quaternion, got {order!r}")
    point = triple(known.get("tracked_point", (0.0, 0.0, 0.0)), f"{where}tracked_point")
    return BodyMap(
        body=Body(
            name=str(known.get("name") or ("block" if count == 1 else f"body{index}")),
            size=(size[0] * length, size[1] * length, size[2] * length),
            mass=number(known["mass"], f"{where}mass") * factor_of("mass", units.get("mass", "kg"), "units.mass"),
            friction=number(known.get("friction", GUESSED_FRICTION), f"{where}friction"),
            restitution=number(known.get("restitution", 0.0), f"{where}restitution"),
            inertia=None if inertia is None else triple(inertia, f"{where}inertia"),
            material=known.get("material"),
        ),
        position=_references(known["position"], f"{where}position", 3),
        orientation=kind,
        columns=columns,
        order=None if order is None else str(order),
        force=_references(known.get("force"), f"{where}force", 3),
        torque=_references(known.get("torque"), f"{where}torque", 3),
        visible=known.get("visible"),
        tracked_point=(point[0] * length, point[1] * length, point[2] * length),
    )


def _orientation(known: Mapping[str, Any], where: str) -> tuple[str, tuple[Reference, ...]]:
    """Return how orientations are written, and their columns."""
    given = [name for name in ORIENTATIONS if known.get(name) is not None]
    if len(given) != 1:
        raise ValueError(
            f"mapping: expected one of {', '.join(f'{where}{name}' for name in ORIENTATIONS)}, found "
            f"{' and '.join(given) or 'none'}; where a body does not turn: orientation: none"
        )
    if given[0] == "orientation":
        if str(known["orientation"]).lower() != "none":
            raise ValueError(
                f"{where}orientation: expected none, for a body that does not turn, got {known['orientation']!r}"
            )
        return "orientation", ()
    lengths = {"quaternion": (4,), "matrix": (9,), "rotation_vector": (3,), "euler": (1, 2, 3)}[given[0]]
    return given[0], _references(known[given[0]], f"{where}{given[0]}", *lengths)


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


def _forces(values: object) -> ForceLog:
    """Build where forces are."""
    known = check_keys(values, "forces", (), ("file", "time", "rate", "offset", "header"))
    rate, header = known.get("rate"), known.get("header")
    return ForceLog(
        file=None if known.get("file") is None else str(known["file"]),
        time=known.get("time"),
        rate=None if rate is None else number(rate, "forces.rate", low=0.0, strict=True),
        offset=number(known.get("offset", 0.0), "forces.offset"),
        header=None if header is None else whole(header, "forces.header", low=1),
    )


def _units(values: object) -> dict[str, str]:
    """Check units by quantity; `forces.time` may differ from `time`."""
    quantities = (*UNITS, "forces_time")
    known = check_keys(values, "units", (), quantities)
    for name, unit in known.items():
        factor_of("time" if name == "forces_time" else name, unit, f"units.{name}")
    return {name: str(unit) for name, unit in known.items()}


def _step(known: Mapping[str, Any]) -> float | None:
    """Return the nominal time between frames, from `time_step` or `rate`."""
    rate, step = known.get("rate"), known.get("time_step")
    if rate is not None and step is not None:
        raise ValueError(f"mapping: expected rate or time_step, found both: {rate} and {step}")
    if rate is None and step is None:
        if known.get("time") is None:
            raise ValueError(
                "mapping: missing time, the column of stamps; where frames come evenly and have none, give rate "
                "(frames per second) instead"
            )
        return None
    return (
        number(step, "time_step", low=0.0, strict=True)
        if rate is None
        else 1 / number(rate, "rate", low=0.0, strict=True)
    )


def _shares(values: object) -> dict[str, float]:
    """Check shares of splits."""
    shares = dict(_plain(values, "split"))
    for name, share in shares.items():
        if name not in SPLITS:
            raise ValueError(f'unknown split "{name}"{nearest(str(name), SPLITS)}')
        number(share, f"split.{name}", low=0.0, strict=True)
    return shares


def _plain(values: object, where: str) -> Mapping[str, Any]:
    """Return a mapping; nothing is an empty one."""
    if values is not None and not isinstance(values, Mapping):
        raise ValueError(f"{where}: expected a mapping, got {values!r}")
    return values or {}


def _unsaid(listed: list[Any], bodies: tuple[BodyMap, ...]) -> tuple[str, ...]:
    """Return the frictions that nothing is said of: they are unknown."""
    both = zip(bodies, listed, strict=True)
    return tuple(f"{one.body.name}.friction" for one, values in both if "friction" not in values)
