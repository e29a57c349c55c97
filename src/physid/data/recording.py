"""One recorded trajectory in memory."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

SPLITS = ("train", "val", "test", "fit", "select", "report_same", "report_transfer")
UNIT_TOLERANCE = 1e-3
# dataset: (shape, type); T frames, N bodies, H rows and W columns of the image
LAYOUT: dict[str, tuple[str, type[np.generic]]] = {
    "pose": ("T N 7", np.float64),
    "wrench": ("T N 6", np.float64),
    "time": ("T", np.float64),
    "twist": ("T N 6", np.float64),
    "frames": ("T H W 3", np.uint8),
    "mask": ("N H W", np.bool_),
    "background": ("H W 3", np.uint8),
}


@dataclass(frozen=True)
class Recording:
    """One trajectory of T frames of N bodies; every array is optional, but poses or frames must be there.

    Attributes:
        pose: Position of the centre [m] and unit quaternion x y z w, world frame; shape (T, N, 7).
        wrench: Commanded torque [N m] and force [N], held from frame t to t+1; shape (T, N, 6). Absent means zero.
        time: Time of each frame [s], shape (T,). Absent means t * time_step.
        twist: Angular [rad/s] and linear [m/s] velocity, shape (T, N, 6).
        frames: RGB video, shape (T, H, W, 3).
        mask: Segmentation of the first frame, shape (N, H, W).
        background: Image of the empty scene, shape (H, W, 3).
        split: What the trajectory is for: one of train, val, test, fit, select, report_same, report_transfer.
        protocol: How it was excited.

    Raises:
        ValueError: If shapes or types disagree, a value is not finite, a quaternion is not of unit length, or time
            does not increase.
    """

    pose: NDArray[np.float64] | None = None
    wrench: NDArray[np.float64] | None = None
    time: NDArray[np.float64] | None = None
    twist: NDArray[np.float64] | None = None
    frames: NDArray[np.uint8] | None = None
    mask: NDArray[np.bool_] | None = None
    background: NDArray[np.uint8] | None = None
    split: str | None = None
    protocol: str | None = None

    def __post_init__(self) -> None:
        if self.pose is None and self.frames is None:
            raise ValueError("pose or frames must be there, got neither")
        check_arrays(self.arrays())
        if self.split is not None and self.split not in SPLITS:
            raise ValueError(f"split must be one of {', '.join(SPLITS)}, got {self.split!r}")

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that are there, by name."""
        values = {field.name: getattr(self, field.name) for field in fields(self) if field.name in LAYOUT}
        return {name: value for name, value in values.items() if value is not None}

    @property
    def length(self) -> int:
        """Number of frames T."""
        return len(self.pose) if self.pose is not None else len(self.frames if self.frames is not None else ())


def check_arrays(arrays: dict[str, NDArray[Any]], bodies: int | None = None) -> None:
    """Check types, shapes and values of the arrays of one trajectory against each other.

    Args:
        arrays: Arrays by name.
        bodies: Number of bodies N that the scene has, if known.

    Raises:
        ValueError: If something is off; the message names the dataset, what was expected and what was found.
    """
    lengths: dict[str, int] = {} if bodies is None else {"N": bodies}
    for name, array in arrays.items():
        layout, kind = LAYOUT[name]
        if array.dtype != kind:
            raise ValueError(f"{name}: expected type {np.dtype(kind)}, found {array.dtype}")
        wanted = [int(axis) if axis.isdigit() else lengths.get(axis, axis) for axis in layout.split()]
        fits = len(wanted) == array.ndim and all(
            isinstance(want, str) or want == have for want, have in zip(wanted, array.shape, strict=True)
        )
        if not fits:
            shape = ", ".join(str(axis) for axis in wanted)
            raise ValueError(f"{name}: expected shape ({shape}), found {array.shape}")
        lengths |= {axis: have for axis, have in zip(layout.split(), array.shape, strict=True) if not axis.isdigit()}
        _check_values(name, array)


def _check_values(name: str, array: NDArray[Any]) -> None:
    """Check what can be checked of the values of one array."""
    if array.dtype == np.float64 and not np.isfinite(array).all():
        frame = int(np.argwhere(~np.isfinite(array))[0, 0])
        raise ValueError(f"{name}: expected finite values, found {array[frame].tolist()} in frame {frame}")
    if name == "pose":
        length = np.linalg.norm(array[..., 3:], axis=-1)
        worst = np.unravel_index(np.abs(length - 1).argmax(), length.shape)
        if abs(length[worst] - 1) > UNIT_TOLERANCE:
            raise ValueError(
                f"pose: expected unit quaternions x y z w, found one of length {length[worst]:.6g} in frame {worst[0]}"
            )
    if name == "time" and (np.diff(array) <= 0).any():
        frame = int(np.argmax(np.diff(array) <= 0)) + 1
        raise ValueError(f"time: expected increasing times, found {array[frame]:.9g} s in frame {frame}")
