"""The pinhole camera that looks at a scene, and what it sees of a box."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from physid.scenes.rotations import rotate
from physid.strict import number, triple, whole
from physid.typed_files import CLOSED

Triple = tuple[float, float, float]
CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with square pixels.

    Attributes:
        width: Columns of the image [pixel].
        height: Rows of the image [pixel].
        position: Centre of projection [m], world frame.
        target: A point on the optical axis [m], world frame.
        up: Direction that is up in the image.
        fov_y: Vertical opening angle [deg].

    Raises:
        ValueError: If a value is of the wrong kind, or the view has no direction.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    width: int
    height: int
    position: Triple
    target: Triple
    up: Triple
    fov_y: float

    def __post_init__(self) -> None:
        whole(self.width, "camera.width", low=1)
        whole(self.height, "camera.height", low=1)
        fov = number(self.fov_y, "camera.fov_y", low=0.0, strict=True)
        if fov >= 180:
            raise ValueError(f"camera.fov_y must be below 180 degrees, got {fov:g}")
        for name in ("position", "target", "up"):
            triple(getattr(self, name), f"camera.{name}")
        forward = np.subtract(self.target, self.position)
        if np.linalg.norm(np.cross(forward, self.up)) < 1e-9:
            raise ValueError("camera.up must not be parallel to the line from camera.position to camera.target")

    @property
    def pixel(self) -> float:
        """Edge of a pixel at the distance of the target, 2 |p - t| tan(fov / 2) / height [m]."""
        distance = float(np.linalg.norm(np.subtract(self.position, self.target)))
        return 2 * distance * math.tan(math.radians(self.fov_y) / 2) / self.height

    def axes(self) -> NDArray[np.float64]:
        """Return the unit vectors right, up and backward of the image in the world frame; rows of (3, 3)."""
        backward = np.subtract(self.position, self.target)
        right = np.cross(self.up, backward)
        upward = np.cross(backward, right)
        return np.stack([axis / np.linalg.norm(axis) for axis in (right, upward, backward)])

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Project points onto the image.

        Args:
            points: World positions [m], shape (..., 3).

        Returns:
            Column and row [pixel], the corner of the first pixel being (0, 0), and depth along the axis [m]; (..., 3).
        """
        seen = (points - np.array(self.position)) @ self.axes().T
        depth = -seen[..., 2]
        scale = 0.5 * self.height / np.tan(np.radians(self.fov_y) / 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            column = 0.5 * self.width + scale * seen[..., 0] / depth
            row = 0.5 * self.height - scale * seen[..., 1] / depth
        return np.stack([column, row, depth], -1)

    def sees(self, pose: NDArray[np.float64], size: NDArray[np.float64], margin: float = 0.0) -> NDArray[np.bool_]:
        """Return whether boxes lie wholly inside the image.

        Args:
            pose: Poses of the boxes, shape (..., N, 7).
            size: Full edge lengths [m], shape (N, 3).
            margin: Least distance from the border [pixel].

        Returns:
            True where all eight corners are inside; shape (..., N).
        """
        image = self.project(corners(pose, size))
        column, row, depth = np.moveaxis(image, -1, 0)
        inside = (column >= margin) & (column <= self.width - margin) & (row >= margin) & (row <= self.height - margin)
        return np.asarray((inside & (depth > 0)).all(-1))


def corners(pose: NDArray[np.float64], size: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners of boxes [m]: pose (..., N, 7) and size (N, 3) give (..., N, 8, 3)."""
    arms = CORNERS * size[:, None, :]
    return np.asarray(pose[..., None, :3] + rotate(pose[..., None, 3:], arms))
