"""One recorded trajectory in memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physid.strict import LARGEST_VALUE

Array = NDArray[np.float64]
SPLITS = ("train", "val", "test", "fit", "select", "report_same", "report_transfer")
UNIT_TOLERANCE = 1e-3
MEASURED = ("pose", "wrench", "twist")
# dataset: (shape, type); T frames, S rows of forces, N bodies, H rows and W columns of the image
LAYOUT: dict[str, tuple[str, type[np.generic]]] = {
    "pose": ("T N 7", np.float64),
    "time": ("T", np.float64),
    "wrench": ("S N 6", np.float64),
    "wrench_time": ("S", np.float64),
    "twist": ("T N 6", np.float64),
    "frames": ("T H W 3", np.uint8),
    "mask": ("N H W", np.bool_),
    "background": ("H W 3", np.uint8),
}


@dataclass(frozen=True)
class Recording:
    """One trajectory of T frames of N bodies; every array is optional, but poses or frames must be there.

    Attributes:
        pose: Position of the centre [m] and unit quaternion x y z w, world frame; shape (T, N, 7). Seven NaN for a body
            that was not seen in a frame.
        wrench: Commanded torque [N m] and force [N], shape (S, N, 6): row s is held from its time stamp to the next,
            the last one to the last frame; before the first stamp there is none. Absent means zero.
        time: Time of each frame [s], shape (T,). Absent means t * time_step.
        twist: Angular [rad/s] and linear [m/s] velocity, shape (T, N, 6); NaN where a body was not seen.
        frames: RGB video, shape (T, H, W, 3).
        mask: Segmentation of the first frame, shape (N, H, W).
        background: Image of the empty scene, shape (H, W, 3).
        split: What the trajectory is for: one of train, val, test, fit, select, report_same, report_transfer.
        protocol: How it was excited.
        wrench_time: Time of each row of `wrench` [s], on the clock of `time`, shape (S,). Absent means that of the
            frames, and S = T.

    Raises:
        ValueError: If shapes or types disagree, a pose is known in part only, a value is not finite, a quaternion is
            not of unit length, or time does not increase.
    """

    pose: Array | None = None
    wrench: Array | None = None
    time: Array | None = None
    twist: Array | None = None
    frames: NDArray[np.uint8] | None = None
    mask: NDArray[np.bool_] | None = None
    background: NDArray[np.uint8] | None = None
    split: str | None = None
    protocol: str | None = None
    wrench_time: Array | None = None

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

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Which body was seen in which frame, shape (T, N).

        Raises:
            ValueError: If there are no poses.
        """
        if self.pose is None:
            raise ValueError("pose: expected poses, found a recording with video only; read them first (physid track)")
        return np.isfinite(self.pose[..., 0])

    def stamps(self, time_step: float) -> Array:
        """Return the time of each frame [s], shape (T,): as recorded, or t * time_step.

        Args:
            time_step: Nominal time between frames [s].
        """
        return np.asarray(np.arange(self.length) * time_step if self.time is None else self.time)

    def wrench_stamps(self, time_step: float) -> Array:
        """Return from when on each row of `wrench` is held [s], shape (S,): as recorded, or the times of the frames."""
        return self.stamps(time_step) if self.wrench_time is None else self.wrench_time


def layout_of(names: Mapping[str, Any]) -> dict[str, tuple[list[str], type[np.generic]]]:
    """Return axes and type of each dataset, given which others are there: forces without a clock go with the frames."""
    rows = "S" if "wrench_time" in names else "T"
    return {
        name: ([rows if axis == "S" and name == "wrench" else axis for axis in axes.split()], kind)
        for name, (axes, kind) in LAYOUT.items()
    }


def check_shapes(found: Mapping[str, tuple[np.dtype[Any], tuple[int, ...]]], bodies: int | None = None) -> None:
    """Check types and shapes of the arrays of one trajectory against each other, before any is read.

    Args:
        found: Type and shape of each array, by name.
        bodies: Number of bodies N that the scene has, if known.

    Raises:
        ValueError: If something is off; the message names the dataset, what was expected and what was found.
    """
    lengths: dict[str, int] = {} if bodies is None else {"N": bodies}
    for name, (axes, kind) in layout_of(found).items():
        if name not in found:
            continue
        dtype, shape = found[name]
        if dtype != kind:
            raise ValueError(
                f'{name}: expected type {np.dtype(kind)}, found {dtype}; convert it, values.astype("{np.dtype(kind)}")'
            )
        wanted = [int(axis) if axis.isdigit() else lengths.get(axis, axis) for axis in axes]
        fits = len(wanted) == len(shape) and all(
            isinstance(want, str) or want == have for want, have in zip(wanted, shape, strict=True)
        )
        if not fits:
            raise ValueError(f"{name}: expected shape ({', '.join(map(str, wanted))}), found {shape}")
        lengths |= {axis: have for axis, have in zip(axes, shape, strict=True) if not axis.isdigit()}
        if 0 in shape:
            raise ValueError(f"{name}: expected at least one of each axis, found shape {shape}")
    if "wrench_time" in found and "wrench" not in found:
        raise ValueError("wrench_time: expected forces (wrench) that it belongs to, found none")


def check_arrays(arrays: Mapping[str, NDArray[Any]], bodies: int | None = None) -> None:
    """Check types, shapes and values of the arrays of one trajectory against each other.

    Args:
        arrays: Arrays by name.
        bodies: Number of bodies N that the scene has, if known.

    Raises:
        ValueError: If something is off; the message names the dataset, what was expected and what was found.
    """
    check_shapes({name: (array.dtype, array.shape) for name, array in arrays.items()}, bodies)
    unseen = _check_poses(arrays["pose"]) if "pose" in arrays else None
    for name, array in arrays.items():
        if array.dtype == np.float64 and name != "pose":
            finite = np.isfinite(array)
            if name == "twist" and unseen is not None:
                finite |= (unseen & np.isnan(array).all(-1))[..., None]
            _require_finite(name, array, finite)
        if name in ("time", "wrench_time") and (np.diff(array) <= 0).any():
            row = int(np.argmax(np.diff(array) <= 0)) + 1
            again = "the same again" if array[row] == array[row - 1] else f"after {array[row - 1]:.9g} s"
            raise ValueError(
                f"{name}: expected increasing times, found {array[row]:.9g} s in {_row_of(name)} {row}, {again}; sort "
                "the rows by time, leave out those that are doubled, or cut the recording there"
            )


def _check_poses(pose: Array) -> NDArray[np.bool_]:
    """Check poses (T, N, 7) and return which were not seen, shape (T, N)."""
    unseen = np.isnan(pose).all(-1)
    partly = ~unseen & ~np.isfinite(pose).all(-1)
    if partly.any():
        frame, body = (int(one) for one in np.argwhere(partly)[0])
        raise ValueError(
            f"pose: expected seven finite values, or seven NaN for a body that was not seen, found "
            f"{pose[frame, body].tolist()} in frame {frame}, body {body}"
        )
    _require_finite("pose", pose, np.isfinite(pose) | np.isnan(pose))
    length = np.where(unseen, 1.0, np.linalg.norm(pose[..., 3:], axis=-1))
    frame, body = (int(one) for one in np.unravel_index(np.abs(length - 1).argmax(), length.shape))
    if abs(length[frame, body] - 1) > UNIT_TOLERANCE:
        raise ValueError(
            f"pose: expected unit quaternions x y z w, found one of length {length[frame, body]:.6g} in frame {frame}"
        )
    return np.asarray(unseen)


def _require_finite(name: str, array: Array, finite: NDArray[np.bool_]) -> None:
    """Refuse values that are not finite."""
    if not finite.all():
        row = int(np.argwhere(~finite)[0, 0])
        raise ValueError(f"{name}: expected finite values, found {array[row].tolist()} in {_row_of(name)} {row}")
    large = np.asarray(np.abs(array) > LARGEST_VALUE) if name in MEASURED else np.zeros(1, dtype=bool)
    if large.any():
        row = int(np.argwhere(large)[0, 0])
        raise ValueError(
            f"{name}: expected values of at most {LARGEST_VALUE:g} in SI, found {array[row].tolist()} in "
            f"{_row_of(name)} {row}; correct the unit, or write NaN for a body that was not seen"
        )


def _row_of(name: str) -> str:
    """Return what a row of a dataset is called."""
    return "row" if name == "wrench_time" else "frame"
