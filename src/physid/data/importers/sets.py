"""Where an import ends: a recording set that is there whole or not at all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from physid.data import Recording, assign_splits, trajectory_path, write_scene, write_sums
from physid.data.files import finish, holds_anything, whole_folder, write_text
from physid.data.trajectory import write_film
from physid.scenes import Scene

MAPPING = "import.yaml"  # the mapping as it was used, beside what it gave


@dataclass(frozen=True)
class Imported:
    """What an import did.

    Attributes:
        folder: The recording set.
        trajectories: How many there are.
        notes: What was taken for granted, a line each.
    """

    folder: Path
    trajectories: int
    notes: tuple[str, ...]


@contextmanager
def new_set(out: Path, values: Mapping[str, Any]) -> Iterator[Path]:
    """Give a folder to write a set into, which takes its name, and the mapping, once all of it is there.

    Raises:
        FileExistsError: If there is something already, or something else has the name OUT.part.
        FolderInUseError: If another process is writing the set.
        OSError: If nothing can be written there.
    """
    finish(out)
    if holds_anything(out):
        raise FileExistsError(f"{out}: expected a new or an empty folder, found something there; choose another --out")
    with whole_folder(out) as part:
        yield part
        write_text(part / MAPPING, yaml.safe_dump(dict(values), sort_keys=False, default_flow_style=None, width=120))


def write_films(
    folder: Path,
    scene: Scene,
    films: Iterable[tuple[Recording, Iterable[NDArray[np.uint8]]]],
    count: int,
    split: Mapping[str, float],
) -> None:
    """Write a set of films, image by image (see `write_film`), and its description.

    Args:
        folder: Where.
        scene: The description.
        films: What is known of each, and its images.
        count: How many there are.
        split: Shares of splits; empty for none.
    """
    splits = assign_splits(count, split) if split else [None] * count
    for index, ((recording, images), use) in enumerate(zip(films, splits, strict=True)):
        write_film(trajectory_path(folder, index), replace(recording, split=use), images)
    write_scene(folder, scene)
    write_sums(folder)
