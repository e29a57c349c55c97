"""How far refined positions are off alike: by a share of their distance from the middle of the view, and an offset."""

from __future__ import annotations

from typing import final

import torch
from torch import Tensor, nn

from physid.networks import PinholeCamera, PoseChart

SHARED = 3
"""Errors that all poses share: a scale, and an offset to the right and down."""


@final
class Calibration(nn.Module):
    """Takes errors out of refined poses that all of them share: a' = (1 + s) a + o.

    Drawn images never fit those of a camera wholly; a twentieth of a pixel at the edge of the view, 0.1 %, is 0.1 % of
    every acceleration, hence of a friction, and no number of trajectories makes it smaller. Where all bodies slide the
    same way a fiftieth of a pixel everywhere does the same. Both are measured where poses are known anyway, in the
    first frames that the look of the bodies is cut from.

    Attributes:
        stretch: s; 0 until it was measured. Part of a checkpoint, as are all of these.
        deviation: Standard deviation of s; 0 until it was measured.
        offset: o, to the right and down [px], shape (2,); 0 unless it was measured.
        root: A root R of the covariance R R^T of (s, o), shape (3, 3).
    """

    stretch: Tensor
    deviation: Tensor
    offset: Tensor
    root: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("stretch", torch.zeros(()))
        self.register_buffer("deviation", torch.zeros(()))
        self.register_buffer("offset", torch.zeros(2))
        self.register_buffer("root", torch.zeros(SHARED, SHARED))

    @torch.no_grad()
    def measure(self, camera: PinholeCamera, found: Tensor, true: Tensor, *, offset: bool = False) -> None:
        """Regress the errors of refined places in the image, a_true - a, on (a, 1), or on a alone.

        Args:
            camera: Says where in the image a pose is; a is counted from its middle.
            found: Polished poses, uncalibrated, shape (M, N, 7).
            true: Known poses, shape (M, N, 7).
            offset: Whether there is an offset. Where initial poses and goals are read alike it moves both, and does no
                harm.
        """
        middle = found.new_tensor([camera.width, camera.height], dtype=torch.float64) / 2
        here, there = (camera.project(pose[..., :3].double()) - middle for pose in (found, true))
        sides = torch.eye(2).to(here).expand(*here.shape, 2)
        unknown = torch.cat([here[..., None], sides], -1).flatten(0, -2)[:, : SHARED if offset else 1]
        inverse = torch.linalg.inv(unknown.T @ unknown)
        error = (there - here).flatten()
        best = inverse @ (unknown.T @ error)
        variance = (error - unknown @ best).square().sum() / max(len(error) - len(best), 1)
        root = torch.zeros(SHARED, SHARED).to(here)
        # A perfect fit leaves a variance of zero, which has a root but no Cholesky factor.
        root[: len(best), : len(best)] = variance.sqrt() * torch.linalg.cholesky(inverse)
        self.stretch.fill_(float(best[0]))
        self.deviation.fill_(float(root[0].norm()))
        self.offset.copy_(best[1:] if offset else torch.zeros(2))
        self.root.copy_(root)

    def forward(self, chart: PoseChart, camera: PinholeCamera, pose: Tensor) -> Tensor:
        """Calibrate refined poses (..., N, 7)."""
        return moved(camera, stretched(chart, pose, float(self.stretch)), self.offset)

    def shared_errors(self, chart: PoseChart, camera: PinholeCamera, pose: Tensor) -> list[Tensor]:
        """Add a standard deviation of each error that all poses (..., N, 7) share, independent of each other."""
        columns = [column for column in self.root.unbind(-1) if column.any()]
        return [moved(camera, stretched(chart, pose, float(one[0])), one[1:]) for one in columns]


def stretched(chart: PoseChart, pose: Tensor, share: float) -> Tensor:
    """Move poses (..., N, 7) away from the middle of the view, by a share of their distance from it."""
    numbers = chart.to_numbers(pose)
    longer = torch.cat([(1 + share) * numbers[..., :2], numbers[..., 2:]], -1)
    way = chart.to_pose(longer)[..., :3] - chart.to_pose(numbers)[..., :3]
    return torch.cat([pose[..., :3] + way, pose[..., 3:]], -1)


def moved(camera: PinholeCamera, pose: Tensor, offset: Tensor) -> Tensor:
    """Move poses (..., N, 7) to the right and down in the image, by an offset (2,) [px], as far away as they are."""
    depth = camera.to_camera(pose[..., :3])[..., 2:]
    across = offset.to(pose) @ camera.rotation[:2].to(pose)
    return torch.cat([pose[..., :3] + depth / camera.focal_length * across, pose[..., 3:]], -1)
