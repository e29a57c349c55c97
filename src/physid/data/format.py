"""A recording set: a folder with recording.yaml, one HDF5 file per trajectory, and checksums."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from physid.data.files import sha256, write_text
from physid.data.observations.stamps import check_clocks
from physid.data.recording import Recording
from physid.data.trajectory import has_dataset, read_film, read_labels, read_trajectory
from physid.scenes import Scene
from physid.scenes.description import describe, read_description
from physid.strict import shown
from physid.yaml_files import YamlError, read_text, read_yaml

__all__ = ["Recording", "RecordingSet", "trajectory_path", "write_scene", "write_sums"]
DESCRIPTION, FOLDER, SUMS = "recording.yaml", "trajectories", "SHA256SUMS"


class RecordingSet:
    """A recording set on the disk; trajectories are read when asked for.

    Args:
        folder: The folder that holds recording.yaml.

    Attributes:
        folder: The same.
        scene: The scene as far as it is known; parameters that are unknown hold a first guess.
        paths: Files of the trajectories, in order.

    Raises:
        FileNotFoundError: If there is no recording.yaml, or no trajectory.
        ValueError: If recording.yaml breaks the format.
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self.scene = read_scene(self.folder)
        self.paths = sorted((self.folder / FOLDER).glob("*.h5"))
        if not self.paths:
            raise FileNotFoundError(f"{self.folder / FOLDER}: expected trajectories NNNNNN.h5, found none")

    def __len__(self) -> int:
        return len(self.paths)

    def __iter__(self) -> Iterator[Recording]:
        return (self.read(index) for index in range(len(self)))

    def read(self, index: int, *, video: bool = False, blank: bool = False) -> Recording:
        """Read trajectory `index`; frames, masks and background only with `video`.

        Without `video` a film without poses is an error, or with `blank` a recording of black frames that take no
        memory: what a film lasts, and what is known beside it.

        Raises:
            ValueError: If the file is damaged or breaks the format, or its time stamps contradict `time_step`.
        """
        skip = () if video else ("frames", "mask", "background")
        recording = read_trajectory(self.paths[index], bodies=len(self.scene.bodies), skip=skip, blank=blank)
        try:
            check_clocks(recording, self.scene.time_step)
        except ValueError as error:
            raise ValueError(f"{self.paths[index]}: {error}") from None
        return recording

    def film(self, index: int, which: list[int]) -> tuple[NDArray[np.uint8], NDArray[np.bool_], NDArray[np.uint8]]:
        """Read some frames (n, H, W, 3) of trajectory `index`, its masks (N, H, W) and its background (H, W, 3).

        Raises:
            ValueError: If one of them is not there, or the file is damaged.
        """
        return read_film(self.paths[index], which)

    def has_poses(self, index: int) -> bool:
        """Return whether trajectory `index` has poses, or a film alone."""
        return has_dataset(self.paths[index], "pose")

    def any_poses(self) -> bool:
        """Return whether any trajectory has poses, or all are films alone."""
        return any(self.has_poses(index) for index in range(len(self)))

    def has_film(self, index: int) -> bool:
        """Return whether trajectory `index` has a film."""
        return has_dataset(self.paths[index], "frames")

    def splits(self) -> list[str | None]:
        """Return the split of each trajectory, None where the file names none."""
        return [read_labels(path)[0] for path in self.paths]

    def indices(self, names: Iterable[str]) -> list[int]:
        """Return the trajectories of some splits.

        Raises:
            ValueError: If there are none.
        """
        wanted, splits = set(names), self.splits()
        found = [index for index, split in enumerate(splits) if split in wanted]
        if not found:
            there = ", ".join(sorted({"without a split" if split is None else split for split in splits}))
            raise ValueError(
                f"{self.folder}: expected trajectories of split {', '.join(sorted(wanted))}, found only {there}; deal "
                "them out when they are imported or generated (split={train: 2, test: 1}), or name others "
                "(data.test=[train] tests on what was fitted)"
            )
        return found

    def verify(self) -> None:
        """Check every file against SHA256SUMS.

        Raises:
            ValueError: If a file is missing or differs, or SHA256SUMS is damaged.
            FileNotFoundError: If there is no SHA256SUMS.
        """
        for path, wanted, found in self.changed():
            raise ValueError(f"{path}: expected SHA-256 {wanted[:12]}..., found {found[:12]}")

    def changed(
        self, leave: Container[Path] = (), compared: Callable[[Path], object] = lambda path: None
    ) -> Iterator[tuple[Path, str, str]]:
        """Yield each file that is not as SHA256SUMS says: its path, the sum that is expected, and what is found.

        Args:
            leave: Files that are not inspected.
            compared: Called with each file that was.

        Raises:
            ValueError: If SHA256SUMS is no text, or names what is no file of the set.
            OSError: If SHA256SUMS cannot be read.
        """
        for line in read_sums(self.folder).splitlines():
            wanted, _, name = line.partition("  ")
            path = self.folder / name
            if not name or Path(name).is_absolute() or ".." in Path(name).parts:
                raise ValueError(
                    f"{self.folder / SUMS}: expected a checksum and a file of the set, found {shown(line)}; delete it"
                )
            if path not in leave:
                found = sha256(path) if path.is_file() else "no such file"
                compared(path)
                if found != wanted:
                    yield path, wanted, found

    def labels(self, index: int) -> tuple[str | None, str | None]:
        """Return split and protocol of trajectory `index`, None where the file names none."""
        return read_labels(self.paths[index])


def trajectory_path(folder: Path, index: int) -> Path:
    """Return the file of trajectory `index`."""
    return folder / FOLDER / f"{index:06d}.h5"


def read_scene(folder: Path) -> Scene:
    """Read recording.yaml.

    Raises:
        FileNotFoundError: If there is none.
        ValueError: If it breaks the format.
    """
    path = folder / DESCRIPTION
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: expected a recording set, found no {DESCRIPTION} there; "
            "make one with physid import or physid generate, or write one (docs/recordings.md)"
        )
    try:
        return read_description(read_yaml(path))
    except YamlError:
        raise
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def write_scene(folder: Path, scene: Scene) -> None:
    """Write recording.yaml, whole or not at all."""
    text = yaml.safe_dump(describe(scene), sort_keys=False, default_flow_style=None, width=160)
    write_text(folder / DESCRIPTION, text)


def list_sums(folder: Path) -> str:
    """Return what SHA256SUMS holds: recording.yaml and the trajectories (not truth.yaml, which may be taken away)."""
    files = [folder / DESCRIPTION, *sorted((folder / FOLDER).glob("*.h5"))]
    return "".join(f"{sha256(path)}  {path.relative_to(folder).as_posix()}\n" for path in files)


def read_sums(folder: Path) -> str:
    """Read SHA256SUMS.

    Raises:
        FileNotFoundError: If there is none.
        ValueError: If it is no text.
    """
    path = folder / SUMS
    try:
        return read_text(path, most=None)
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{path}: expected checksums as text in UTF-8, found byte {error.object[error.start]:#04x}; copy the set "
            "again, or delete this file if you trust the recordings"
        ) from None


def write_sums(folder: Path) -> None:
    """Write SHA256SUMS."""
    write_text(folder / SUMS, list_sums(folder))
