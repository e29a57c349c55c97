"""One trajectory as an HDF5 file."""

from __future__ import annotations

import shutil
from collections.abc import Container, Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from physid.data.files import write_whole
from physid.data.hdf5 import FormatError, declared, names_in, opened, read_dataset, read_text
from physid.data.recording import LAYOUT, Recording, check_arrays, check_shapes
from physid.strict import nearest

GZIP, FAST = 4, 1


def write_trajectory(path: Path, recording: Recording) -> None:
    """Write a trajectory: whole or not at all, with checksums, the same bytes each time.

    Args:
        path: The file, trajectories/NNNNNN.h5.
        recording: What to write.
    """

    def write(part: Path) -> None:
        # In memory first: HDF5 cannot close a file that the disk has no room for, and crashes when Python ends.
        with h5py.File(part, "w", libver=("v110", "v110"), driver="core", backing_store=False) as file:
            for name, array in recording.arrays().items():
                chunks = (1, *array.shape[1:]) if name == "frames" else array.shape
                file.create_dataset(name, data=array, chunks=chunks, **_options(array.dtype))
                file.flush()  # else the order of the chunks in the file depends on when Python frees the dataset
            _label(file, recording)
            file.flush()
            part.write_bytes(file.id.get_file_image())

    write_whole(path, write)


def write_film(path: Path, recording: Recording, images: Iterable[NDArray[np.uint8]]) -> None:
    """Write a trajectory whose images come one by one: no more than one of them is in memory.

    Args:
        path: The file, trajectories/NNNNNN.h5.
        recording: What to write; of its frames only the shape (T, H, W, 3) is looked at.
        images: The frames, T images (H, W, 3).

    Raises:
        OSError: If the disk has no room for them.
        ValueError: If there are more or fewer.
    """
    assert recording.frames is not None
    shape = recording.frames.shape
    path.parent.mkdir(parents=True, exist_ok=True)
    if shutil.disk_usage(path.parent).free < recording.frames.size:
        raise OSError(
            f"{path}: expected room for {recording.frames.size / 1e9:.3g} GB of frames on the disk, found less; choose "
            "another --out, or cut the film"
        )

    def write(part: Path) -> None:
        with h5py.File(part, "w", libver=("v110", "v110")) as file:
            for name, array in recording.arrays().items():
                if name != "frames":
                    file.create_dataset(name, data=array, chunks=array.shape, **_options(array.dtype))
            film = file.create_dataset(
                "frames", shape, np.uint8, chunks=(1, *shape[1:]), **_options(np.dtype(np.uint8), FAST)
            )
            count = 0
            for count, image in enumerate(images, 1):
                if count <= len(film):
                    film[count - 1] = image
            if count != len(film):
                raise ValueError(f"expected {len(film)} frames as before, found {count}: the film was changed")
            _label(file, recording)

    write_whole(path, write)


def _options(kind: np.dtype[Any], compression: int = GZIP) -> dict[str, Any]:
    """Return how a dataset is stored: with checksums; numbers of images and masks compressed."""
    packed = {} if kind == np.float64 else {"compression": "gzip", "compression_opts": compression}
    return {"track_times": False, "fletcher32": True, **packed}


def _label(file: h5py.File, recording: Recording) -> None:
    """Write what a trajectory is for, and how it was excited."""
    for name in ("split", "protocol"):
        if getattr(recording, name) is not None:
            file.attrs[name] = getattr(recording, name)


def read_trajectory(
    path: Path, *, bodies: int | None = None, skip: Iterable[str] = (), blank: bool = False
) -> Recording:
    """Read and check a trajectory.

    Args:
        path: The file.
        bodies: Number of bodies N that the scene has, if known.
        skip: Datasets to leave on the disk, say "frames".
        blank: Whether frames that are left on the disk where no poses are there are black, so that only their number
            and size count, in no memory; otherwise that is an error.

    Returns:
        The trajectory.

    Raises:
        ValueError: If the file is damaged or breaks the format; the message names the file, the dataset, what was
            expected and what was found.
        FileNotFoundError: If there is no such file.
    """
    left = set(skip)
    with opened(path) as file:
        names = names_in(file)
        arrays: dict[str, Any] = _read_arrays(file, names, left, bodies)
        attributes: dict[str, Any] = {name: read_text(file, name) for name in ("split", "protocol")}
        if blank and "pose" not in names and "frames" in names:
            arrays["frames"] = np.broadcast_to(np.uint8(0), declared(file, "frames")[1])
    try:
        check_arrays(arrays, bodies)
        if "pose" not in arrays and "frames" in left - {*arrays} and "frames" in names:
            raise ValueError("pose: expected to be there when frames are left on the disk, found none")
        return Recording(**arrays, **attributes)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _read_arrays(
    file: h5py.File, names: list[str], left: Container[str], bodies: int | None
) -> dict[str, NDArray[Any]]:
    """Read datasets but for those that are left, once what all declare, these too, has been checked."""
    for name in names:
        if name not in LAYOUT:
            raise FormatError(f'unknown dataset "{name}"{nearest(name, LAYOUT)}')
    try:
        check_shapes(
            {
                name: (file[name].dtype, file[name].shape or ()) if name in left else declared(file, name)
                for name in names
            },
            bodies,
        )
    except ValueError as error:
        raise FormatError(str(error)) from None
    return {name: read_dataset(file, name) for name in LAYOUT if name in names and name not in left}


def read_film(path: Path, which: list[int]) -> tuple[NDArray[np.uint8], NDArray[np.bool_], NDArray[np.uint8]]:
    """Read some frames (n, H, W, 3), the masks (N, H, W) and the background (H, W, 3) of a trajectory.

    Frames may be asked for in any order, and more than once; each is decoded once.

    Raises:
        ValueError: If one of the datasets is missing, a frame does not exist, or the file is damaged.
    """
    with opened(path) as file:
        there = names_in(file)
        for name in ("frames", "mask", "background"):
            if name not in there:
                raise FormatError(
                    f"{name}: expected it for learning from video, found none; record it, or generate the set with "
                    "video=true"
                )
        count = len(file["frames"])
        if not all(0 <= one < count for one in which):
            raise FormatError(f"frames: expected frames below {count} to be asked for, found {which}")
        once, order = np.unique(which, return_inverse=True)
        first, last = int(once[0]), int(once[-1])
        if last - first + 1 == len(once):
            frames = read_dataset(file, "frames", slice(first, last + 1))
        else:  # one by one, since h5py takes far longer for a list of indices
            frames = np.stack([read_dataset(file, "frames", int(one)) for one in once])
        return frames[order], read_dataset(file, "mask"), read_dataset(file, "background")


def has_dataset(path: Path, name: str) -> bool:
    """Tell whether a trajectory has a dataset."""
    with opened(path) as file:
        return name in file


def read_labels(path: Path) -> tuple[str | None, str | None]:
    """Return split and protocol of a trajectory, None where the file names none."""
    with opened(path) as file:
        return read_text(file, "split"), read_text(file, "protocol")
