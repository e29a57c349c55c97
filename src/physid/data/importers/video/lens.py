"""A real camera: lens and place, checked, and the ideal pinhole camera that stands for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.video.pictures import MOST_PIXELS
from physid.scenes.camera import Camera

Array = NDArray[np.float64]
LONGEST_SIDE = 32_766
"""[px] Of an image: OpenCV numbers pixels with 16 bits where it straightens one."""
FOCAL = (0.05, 1000.0)
"""Least and largest focal length over the longer side of the image [-]: a view of 170 degrees, and a telescope's."""
OBLONG = 2.5
"""Ratio of the focal lengths [-]: anamorphic lenses squeeze an image by two, nothing squeezes it more."""
MOST_SKEW = 0.05
"""Of the axes of the image, over the focal length [-]: those of sensors are at right angles to a thousandth."""
MOST_DISTORTION = 1e6
"""Of a distortion coefficient [-]: the higher ones of long lenses, which are hardly seen, reach some thousand."""
FARTHEST = 1e4
"""[m] Of a camera along each axis: from there a body of a metre is a pixel of a telescope's image."""
METRES = "are size, points and tvec of the camera in metres"


@final
@dataclass(frozen=True)
class Lens:
    """A real camera.

    Attributes:
        width: Columns [px].
        height: Rows [px].
        matrix: OpenCV's camera matrix, shape (3, 3); pixel centres are whole numbers.
        distortion: OpenCV's coefficients k1, k2, p1, p2, k3, ...; none for a pinhole.
        rotation: From the world's axes to the camera's (x right, y down, z forward), shape (3, 3).
        translation: Of the world's origin in the camera's axes [m], shape (3,).
        points_error: The largest distance [px] of a given point of the image from where this camera sees it; None where
            the place was not found from points.

    Raises:
        ValueError: If no camera is like that: every pose would be off with it.
    """

    width: int
    height: int
    matrix: Array
    distortion: Array
    rotation: Array
    translation: Array
    points_error: float | None = None

    def __post_init__(self) -> None:
        self._check_image()
        self._check_matrix()
        if not (np.abs(self.distortion) <= MOST_DISTORTION).all():  # which NaN is not either
            raise ValueError(
                f"distortion_coefficients: expected numbers within {MOST_DISTORTION:g}, got {self.distortion.tolist()}"
            )
        with np.errstate(all="ignore"):
            apart = np.abs(self.rotation @ self.rotation.T - np.eye(3)).max()
            away = np.abs(self.position).max()
        if not apart < 1e-6:
            raise ValueError("rvec: expected a rotation of the camera, got one whose axes are not at right angles")
        if not away <= FARTHEST:
            raise ValueError(
                f"place: expected a camera within {FARTHEST:g} m of the origin, got one {away:.3g} m away; {METRES}?"
            )

    def _check_image(self) -> None:
        """Check the size of the image."""
        if max(self.width, self.height) > LONGEST_SIDE or self.width * self.height > MOST_PIXELS:
            raise ValueError(
                f"expected an image of at most {MOST_PIXELS:,} pixels and {LONGEST_SIDE} a side, got {self.width} x "
                f"{self.height}; calibrate at the size of the film"
            )

    def _check_matrix(self) -> None:
        """Check the camera matrix."""
        matrix, says = self.matrix, f"got {self.matrix.tolist()}"
        across, along = float(matrix[0, 0]), float(matrix[1, 1])
        if matrix[1, 0] != 0 or not np.array_equal(matrix[2], [0, 0, 1]):
            raise ValueError(f"camera_matrix: expected rows fx, skew, cx; 0, fy, cy; 0, 0, 1, {says}")
        if not (0 < matrix[0, 2] < self.width and 0 < matrix[1, 2] < self.height):
            raise ValueError(f"camera_matrix: expected a principal point within {self.width} x {self.height}, {says}")
        side, (least, most) = max(self.width, self.height), FOCAL
        if not least * side <= min(across, along) <= max(across, along) <= most * side:
            raise ValueError(
                f"camera_matrix: expected focal lengths from {least * side:g} to {most * side:g} px for images of "
                f"{self.width} x {self.height}, {says}"
            )
        if max(across, along) > OBLONG * min(across, along) or not abs(matrix[0, 1]) <= MOST_SKEW * across:
            raise ValueError(
                f"camera_matrix: expected pixels whose sides differ by a factor of {OBLONG:g} at most, and a skew of "
                f"at most {MOST_SKEW:g} fx, {says}"
            )

    @property
    def position(self) -> Array:
        """Where the camera is in the world [m], shape (3,)."""
        return np.asarray(-self.rotation.T @ self.translation)

    @property
    def ideal(self) -> bool:
        """Whether it is a pinhole with square pixels, its principal point in the middle."""
        middle = np.array([self.width / 2 - 0.5, self.height / 2 - 0.5])
        square = abs(self.matrix[0, 0] / self.matrix[1, 1] - 1) < 1e-9 and abs(self.matrix[0, 1]) < 1e-9
        return not self.distortion.any() and square and bool(np.allclose(self.matrix[:2, 2], middle, atol=1e-6))

    def pinhole(self) -> Camera:
        """Return the ideal camera at the same place, whose focal length is the mean one."""
        focal = (self.matrix[0, 0] + self.matrix[1, 1]) / 2
        position = self.position
        forward, up = self.rotation[2], -self.rotation[1]
        # The target is where the optical axis meets the height zero, or a metre away.
        away = -position[2] / forward[2] if forward[2] * position[2] < 0 else 1.0
        fov = float(np.degrees(2 * np.arctan(self.height / 2 / focal)))
        target = position + away * forward
        return Camera(self.width, self.height, _triple(position), _triple(target), _triple(up), fov)

    def maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return where pixels of the ideal image lie in the real one, columns and rows (H, W)."""
        from physid.data.importers.video.opencv import cv2

        focal = (self.matrix[0, 0] + self.matrix[1, 1]) / 2
        wanted = np.array([[focal, 0, self.width / 2 - 0.5], [0, focal, self.height / 2 - 0.5], [0, 0, 1]])
        size = (self.width, self.height)
        found = cv2.initUndistortRectifyMap(self.matrix, self.distortion, None, wanted, size, cv2.CV_32FC1)
        return np.asarray(found[0], dtype=np.float32), np.asarray(found[1], dtype=np.float32)


def _triple(vector: Array) -> tuple[float, float, float]:
    """Return a vector as plain numbers."""
    x, y, z = (float(f"{one:.12g}") for one in vector)
    return x, y, z
