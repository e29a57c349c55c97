"""What the mapping of an import said of axes and forces, so that a mend can speak of the log's own columns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from physid.data.importers.rotations import PRESETS, axes_of
from physid.data.importers.sets import MAPPING
from physid.data.importers.units import UNITS
from physid.data.reading import HiddenFrames, read_reading
from physid.yaml_files import read_yaml

Array = NDArray[np.float64]
SIGNED = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}


@dataclass(frozen=True)
class Origin:
    """Where poses and forces come from.

    Attributes:
        axes: Turns vectors of the log into the world of the set, shape (3, 3).
        force: The log's columns of forces, as the mapping lists them.
        order: In which quaternions were read, xyzw or wxyz.
        newtons: What one of the log's unit of forces was taken for [N].
        newton_metres: What one of the log's unit of torques was taken for [N m].
        quaternion: The log's columns of quaternions, as the mapping lists them.
        mapped: Whether a mapping said what is known here.
        offset: What was added to the stamps of the forces [s].
        held: Whether forces are held from row to row.
        hidden: Frames of films in which something hid the bodies as poses were read from them.
    """

    axes: Array = field(default_factory=lambda: np.eye(3))
    force: tuple[str, ...] = ("fx", "fy", "fz")
    order: str = "xyzw"
    newtons: float = 1.0
    newton_metres: float = 1.0
    quaternion: tuple[str, ...] = ()
    mapped: bool = False
    offset: float = 0.0
    held: bool = True
    hidden: tuple[HiddenFrames, ...] = ()

    @classmethod
    def of(cls, folder: Path) -> Origin:
        """Read it from the mapping that an import leaves in its set; without one the log's world is the set's.

        Poses that were read from films have that of the films.
        """
        try:
            reading = None if (folder / MAPPING).is_file() else read_reading(folder)
        except (OSError, ValueError):
            return cls()
        hidden = () if reading is None else reading.hidden
        try:
            source = folder if reading is None else reading.films_folder()
            known = None if source is None else read_yaml(source / MAPPING)
            axes = axes_of(known.get("axes", "z-up")) if isinstance(known, dict) else np.eye(3)
        except (OSError, ValueError):
            return cls(hidden=hidden)
        if not isinstance(known, dict):
            return cls(hidden=hidden)
        listed = known.get("bodies")
        bodies = [one for one in listed if isinstance(one, dict)] if isinstance(listed, list) else [known]
        force, quaternion = _names(_first(bodies, "force"), "xyz"), _names(_first(bodies, "quaternion"), "xyzw")
        ends = "".join(name[-1:].lower() for name in quaternion)
        order = _first(bodies, "order") or ("wxyz" if ends in ("wxyz", "rijk") else "xyzw")
        units = known["units"] if isinstance(known.get("units"), dict) else {}
        given = known.get("forces")
        forces = given if isinstance(given, dict) else {}
        offset = forces.get("offset", 0.0)
        return cls(
            axes,
            force or cls.force,
            str(order),
            UNITS["force"].get(str(units.get("force")), 1.0),
            UNITS["torque"].get(str(units.get("torque")), 1.0),
            quaternion,
            True,
            float(offset) if isinstance(offset, int | float) else 0.0,
            forces.get("between") in (None, "held"),
            hidden,
        )

    def up(self, direction: str) -> tuple[str, str]:
        """Return which of the log's axes points along a signed axis of the set's world, and the axes that put it up.

        Args:
            direction: A key of `SIGNED`.
        """
        wanted = np.array(SIGNED[direction], dtype=np.float64) @ self.axes
        word = next(name for name, vector in SIGNED.items() if np.array_equal(vector, wanted))
        side = np.sign(np.linalg.det(self.axes))
        fitting = [
            name
            for name in PRESETS
            if np.array_equal(axes_of(name)[2], wanted) and np.sign(np.linalg.det(axes_of(name))) == side
        ]
        if fitting:
            return word, fitting[0]
        letters = [letter for letter in "xyz" if letter != word[-1]]
        spelled = [f"{first} {second} {word}" for first, second in (letters, letters[::-1])]
        return word, next(one for one in spelled if np.sign(np.linalg.det(axes_of(one))) == side)

    def inverse(self) -> str:
        """Return the key of the mapping that reads inverse rotations as rotations."""
        names = self.quaternion or (("qw", "qx", "qy", "qz") if self.order == "wxyz" else ("qx", "qy", "qz", "qw"))
        scalar = self.order.index("w")
        words = [name if place == scalar else _negative(name) for place, name in enumerate(names)]
        if self.mapped and not self.quaternion:
            return "rotations the other way round"
        return f"quaternion={_flow(words)}"

    def forces(self, change: Array) -> str:
        """Return the key of the mapping that lists the log's columns so as to change the world's forces (3, 3)."""
        wanted = self.axes.T @ change @ self.axes
        words = []
        for row in wanted:
            column = int(np.abs(row).argmax())
            name = self.force[column]
            words.append(_negative(name) if row[column] < 0 else name)
        return f"force={_flow(words)}"


def _flow(names: Sequence[str]) -> str:
    """Write columns as a list that YAML reads."""
    return yaml.safe_dump(list(names), default_flow_style=True, width=math.inf).strip()


def _negative(name: str) -> str:
    """Return a column with the other sign, as a mapping names it."""
    return name.removeprefix("-") if name.startswith("-") else f"-{name}"


def _first(bodies: Sequence[Mapping[str, object]], key: str) -> object:
    """Return what the first body that has a key says of it."""
    return next((one[key] for one in bodies if one.get(key) is not None), None)


def _names(value: object, letters: str) -> tuple[str, ...]:
    """Return names of columns, one for each letter: those that a mapping lists, or of the array that it names."""
    if isinstance(value, list) and len(value) == len(letters):
        return tuple(map(str, value))
    listed = value if isinstance(value, list) else [value]
    if len(listed) != 1 or not isinstance(listed[0], str):
        return ()
    name = listed[0]
    return tuple(f"{name}/{letter}" if "/" in name else f"{name}[{k}]" for k, letter in enumerate(letters))
