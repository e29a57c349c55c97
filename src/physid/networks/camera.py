"""A pinhole camera: where a point of the world falls in the image, and back."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class PinholeCamera:
    """A camera without distortion, with square pixels and its principal point in the middle of the image.

    Image coordinates (u, v) run from the upper left corner, u to the right and v down; the centre of the pixel in
    column c and row r is (c + 1/2, r + 1/2). Camera axes: x to the right, y down, z along the view.

    Attributes:
        width: Image width [px].
        height: Image height [px].
        position: Centre of projection, world frame [m].
        target: A point on the optical axis, world frame [m].
        up: A direction that appears upright in the image; need not be normal to the optical axis.
        fov_y: Full vertical opening angle [deg].

    Raises:
        ValueError: If the image is empty, the opening angle impossible, or the view direction undefined.
    """

    width: int
    height: int
    position: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float]
    fov_y: float

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise ValueError(f"camera width and height must be at least 1 px, got {self.width} x {self.height}")
        if not 0 < self.fov_y < 180:
            raise ValueError(f"camera fov_y must lie between 0 and 180 degrees, got {self.fov_y:.6g}")
        if not torch.isfinite(self.rotation).all():
            raise ValueError(
                f"camera must look somewhere: target {self.target} must differ from position {self.position}, "
                f"and up {self.up} must not be parallel to the view"
            )

    @property
    def focal_length(self) -> float:
        """Focal length f = height / (2 tan(fov_y / 2)) [px]."""
        return self.height / (2 * math.tan(math.radians(self.fov_y) / 2))

    @property
    def rotation(self) -> Tensor:
        """World to camera axes, rows right, down and forward; shape (3, 3), float64."""
        position, target, up = (torch.tensor(v, dtype=torch.float64) for v in (self.position, self.target, self.up))
        forward = target - position
        right = torch.linalg.cross(forward, up)
        down = torch.linalg.cross(forward, right)
        rows = torch.stack([right, down, forward])
        # An undefined direction becomes not-a-number, which the constructor reports.
        return rows / torch.where((norm := rows.norm(dim=-1, keepdim=True)) > 1e-9, norm, torch.nan)

    def to_camera(self, points: Tensor) -> Tensor:
        """Express points of the world in camera axes, R (p - position) [m]; shape (..., 3)."""
        # A sum of products, which stays exact where automatic mixed precision would round a matrix product.
        return ((points - points.new_tensor(self.position))[..., None, :] * self.rotation.to(points)).sum(-1)

    def project(self, points: Tensor) -> Tensor:
        """Map points of the world to the image, u = f x / z + width / 2 and v = f y / z + height / 2.

        Args:
            points: World frame [m], in front of the camera; shape (..., 3).

        Returns:
            Image coordinates [px], shape (..., 2).
        """
        seen = self.to_camera(points)
        middle = points.new_tensor([self.width / 2, self.height / 2])
        return self.focal_length * seen[..., :2] / seen[..., 2:] + middle

    def rays(self, pixels: Tensor) -> Tensor:
        """Give the directions of unit depth, world frame, that fall on image coordinates (..., 2); shape (..., 3)."""
        middle = pixels.new_tensor([self.width / 2, self.height / 2])
        plane = (pixels - middle) / self.focal_length
        ray = torch.cat([plane, torch.ones_like(plane[..., :1])], -1)
        return (ray[..., None] * self.rotation.to(pixels)).sum(-2)
