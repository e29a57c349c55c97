"""How far polished positions are off, as a share of their distance from the middle of the view."""

from __future__ import annotations

from typing import final

import torch
from torch import Tensor, nn

from physid.networks.camera import PinholeCamera
from physid.networks.chart import PoseChart


@final
class Calibration(nn.Module):
    """Takes an error out of polished poses that all of them share: a scale, a' = (1 + s) a.

    Drawn images never fit those of a camera wholly; a twentieth of a pixel at the edge of the view, 0.1 %, is 0.1 % of
    every acceleration, hence of a friction, and no number of trajectories makes it smaller. It is measured where poses
    are known anyway, in the first frames that the look of the bodies is cut from.

    Attributes:
        stretch: s; 0 until it was measured. Part of a checkpoint.
        deviation: Standard deviation of s; 0 until it was measured.
    """

    stretch: Tensor
    deviation: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("stretch", torch.zeros(()))
        self.register_buffer("deviation", torch.zeros(()))

    @torch.no_grad()
    def measure(self, camera: PinholeCamera, found: Tensor, true: Tensor) -> None:
        """Regress the errors of polished places in the image on them: s = sum a (a_true - a) / sum a^2.

        Args:
            camera: Says where in the image a pose is; a is counted from its middle.
            found: Polished poses, uncalibrated, shape (M, N, 7).
            true: Known poses, shape (M, N, 7).
        """
        middle = found.new_tensor([camera.width, camera.height], dtype=torch.float64) / 2
        here, there = ((camera.project(pose[..., :3].double()) - middle).flatten() for pose in (found, true))
        power = here.square().sum()
        stretch = (here * (there - here)).sum() / power
        rest = there - (1 + stretch) * here
        self.stretch.fill_(float(stretch))
        self.deviation.fill_(float((rest.square().sum() / max(len(rest) - 1, 1) / power).sqrt()))

    def forward(self, chart: PoseChart, pose: Tensor) -> Tensor:
        """Calibrate polished poses (..., N, 7)."""
        return stretched(chart, pose, float(self.stretch))


def stretched(chart: PoseChart, pose: Tensor, share: float) -> Tensor:
    """Move poses (..., N, 7) away from the middle of the view, by a share of their distance from it."""
    numbers = chart.to_numbers(pose)
    longer = torch.cat([(1 + share) * numbers[..., :2], numbers[..., 2:]], -1)
    moved = chart.to_pose(longer)[..., :3] - chart.to_pose(numbers)[..., :3]
    return torch.cat([pose[..., :3] + moved, pose[..., 3:]], -1)
