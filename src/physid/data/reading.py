"""Where the poses of a recording set come from if they were read from films: reading.yaml beside recording.yaml."""

from __future__ import annotations

import dataclasses
import hashlib
import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import torch
import yaml
from torch import Tensor

from physid.data.files import write_text
from physid.data.format import DESCRIPTION, FOLDER, RecordingSet
from physid.strict import one_line
from physid.typed_files import CLOSED, read_yaml_as

logger = logging.getLogger("physid")
FILE, ECHO = "reading.yaml", "echo"


@dataclass(frozen=True)
class HiddenFrames:
    """Frames of a film in which much of what should be the bodies does not look like them.

    Attributes:
        trajectory: Whose film it is.
        frames: How many there are.
        first: The first of them.
        last: The last of them.
        share: How much of the bodies looks otherwise where it is most, 0 to 1.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    trajectory: int
    frames: int
    first: int
    last: int
    share: float

    def __str__(self) -> str:
        return (
            f"trajectory {self.trajectory}: in {self.frames} frame(s), from {self.first} to {self.last}, up to "
            f"{100 * self.share:.0f} % of what should be bodies looks otherwise than in the rest of the film: "
            "something hides them, or their light changes"
        )


@dataclass(frozen=True)
class Reading:
    """How poses were read from films.

    Beside the poses lies the set `echo`: the poses drawn by another engine, and read again in the same way. How far it
    is from the poses shows the reader's own error, along the same motion.

    Attributes:
        films: Folder of the set that holds the films.
        reader: What read them.
        chart: Which poses it could express: planar, hovering or spatial.
        stretch: By which share of their distance from the middle of the view all places were moved.
        stretch_deviation: How well that share is known, one standard deviation.
        key: Changes with the films.
        hidden: In which frames something hid the bodies, or their light changed.
        seen: Checksum of the films' files (see `checksum_of_files`), from which it is known again that these were read.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    films: str
    reader: str
    chart: str
    stretch: float
    stretch_deviation: float
    key: str
    hidden: tuple[HiddenFrames, ...] = ()
    seen: str = ""

    def films_folder(self) -> Path | None:
        """Return the folder of the films; None where it does not hold those that were read.

        The set may come from anyone, and so may the name of the folder: nothing of it is read unless its files have
        the names, sizes and times of those that were read, which only who has read them knows.
        """
        folder = Path(self.films)
        return folder if self.seen and checksum_of_files(folder) == self.seen else None


def checksum_of_files(films: Path) -> str:
    """Return a checksum of names, sizes and times of the trajectories of a set; none of them is opened."""
    try:
        facts = [(path.name, path.stat()) for path in sorted((films / FOLDER).glob("*.h5"))]
    except (OSError, ValueError):  # of a name that no file can have
        return ""
    plain = [(name, fact.st_size, fact.st_mtime_ns) for name, fact in facts]
    return hashlib.sha256(repr(plain).encode()).hexdigest() if plain else ""


def write_reading(folder: Path, reading: Reading) -> None:
    """Write reading.yaml, whole or not at all."""
    write_text(folder / FILE, yaml.safe_dump(dataclasses.asdict(reading), sort_keys=False))


def read_reading(folder: Path) -> Reading | None:
    """Read reading.yaml; None where the poses were not read from films.

    Raises:
        ValueError: If it breaks the format.
    """
    path = folder / FILE
    if not path.is_file():
        return None
    return read_yaml_as(Reading, path)


def echo_of(recordings: RecordingSet) -> RecordingSet | None:
    """Return the poses of a set, drawn and read again; None where they were not read from films."""
    folder = recordings.folder / ECHO
    return RecordingSet(folder) if (folder / DESCRIPTION).is_file() else None


def film_of(recordings: RecordingSet, index: int) -> tuple[RecordingSet, int]:
    """Return where the film of a trajectory is: in its own set, or in that from which its poses were read."""
    reading = read_reading(recordings.folder)
    films = None if reading is None else reading.films_folder()
    if reading is not None and films is None and os.path.exists(reading.films):
        _say_once(recordings.folder, reading.films)
    return recordings if films is None else RecordingSet(films), index


@cache
def _say_once(folder: Path, films: str) -> None:
    """Warn once that films are not inspected."""
    logger.warning(
        "%s: its poses were read from films of %s, and what lies there is not known to be these films; no picture of "
        "them is shown; name them again to have one (physid track FILMS --out THIS FOLDER, which reads nothing twice)",
        folder, one_line(films),
    )  # fmt: skip


def stretch_of(pose: Tensor, target: Sequence[float]) -> Tensor:
    """Return how poses from films change per share by which all places move away from the middle of the view.

    Args:
        pose: Position [m] and unit quaternion, shape (..., 7).
        target: Where the view is fixed, world frame [m].

    Returns:
        Rotation vectors, which are zero, and changes of positions [m], shape (..., 6).
    """
    stretch = torch.zeros_like(pose[..., :6])
    stretch[..., 3:] = pose[..., :3] - pose.new_tensor(target)
    return stretch
