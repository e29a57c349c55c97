"""Where the poses of a recording set come from if they were read from films: reading.yaml beside recording.yaml."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import torch
import yaml
from torch import Tensor

from physid.data.files import write_text
from physid.data.format import DESCRIPTION, RecordingSet
from physid.typed_files import CLOSED, read_yaml_as

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
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    films: str
    reader: str
    chart: str
    stretch: float
    stretch_deviation: float
    key: str
    hidden: tuple[HiddenFrames, ...] = ()


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
    if reading is None or not (Path(reading.films) / DESCRIPTION).is_file():
        return recordings, index
    return RecordingSet(reading.films), index


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
