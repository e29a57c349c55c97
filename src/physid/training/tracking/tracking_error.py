"""How far poses that were read from films can be trusted: similar motions are drawn, and read in the same way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate, normalize

from physid.networks import PlanarChart, PoseChart
from physid.physics.rotations import conjugate, exponential, multiply
from physid.training.tracking.films import FirstSight

SMOOTH = 17
"""Frames over which read poses are smoothed before they are drawn."""
TURN = 0.07
"""Largest angle by which a drawn motion is turned [rad]; the most that a body of 15 px notices as half a pixel."""
FINER = 3
"""Texels of a drawn face per texel of a cut one."""
SILENT = 0.5
"""Noise of a colour [of 255] below which it is rounding."""


@final
class TrackingStudy:
    """Motions like those that were read, to be drawn: smoothed, and moved by up to half a pixel.

    Read poses are drawn to places between the pixels where a reader errs least; drawn there, they would look better
    than they are.

    Args:
        chart: Which poses the reader can express.
        width: Of the images [px].
        read: Poses (T, N, 7) of each trajectory.
    """

    def __init__(self, chart: PoseChart, width: int, read: Sequence[Tensor]) -> None:
        self._read = read
        generator = torch.Generator().manual_seed(0)
        self.poses = [_moved(chart, width, smoothed(pose), generator) for pose in read]

    def echo(self, index: int, again: Tensor) -> Tensor:
        """Apply to what was read what reading `again` (T, N, 7) has done to what was drawn."""
        drawn, read = self.poses[index], self._read[index]
        turn = multiply(again[..., 3:], conjugate(drawn[..., 3:]))
        return torch.cat([read[..., :3] + again[..., :3] - drawn[..., :3], multiply(turn, read[..., 3:])], -1)


def smoothed(pose: Tensor) -> Tensor:
    """Fit a parabola around each frame of (T, N, 7) and take its middle (Savitzky, Golay 1964); ends stay."""
    reach = min(SMOOTH, len(pose) - 1 + len(pose) % 2) // 2
    steady = torch.where((pose[1:, :, 3:] * pose[:-1, :, 3:]).sum(-1, keepdim=True) < 0, -1.0, 1.0).cumprod(0)
    pose = torch.cat([pose[..., :3], torch.cat([pose[:1, :, 3:], steady * pose[1:, :, 3:]])], -1)
    at = torch.arange(-reach, reach + 1, dtype=pose.dtype)
    weight = torch.linalg.pinv(torch.stack([at**0, at, at**2], 1))[0]
    middle = (pose.unfold(0, 2 * reach + 1, 1) * weight).sum(-1)
    smooth = torch.cat([pose[:reach], middle, pose[len(pose) - reach :]])
    return torch.cat([smooth[..., :3], normalize(smooth[..., 3:], dim=-1)], -1)


def _moved(chart: PoseChart, width: int, pose: Tensor, generator: torch.Generator) -> Tensor:
    """Shift a motion (T, N, 7) by up to half a pixel, and turn each body by up to `TURN`, to poses of the chart."""
    bodies = pose.shape[1]
    axis = chart.normal if isinstance(chart, PlanarChart) else torch.tensor([0.0, 0.0, 1.0])
    angle = TURN * (2 * torch.rand(bodies, 1, generator=generator) - 1)
    turn = exponential((angle * axis).to(pose)).expand(*pose.shape[:2], 4)
    numbers = chart.to_numbers(torch.cat([pose[..., :3], multiply(turn, pose[..., 3:])], -1))
    shift = (2 * torch.rand(bodies, 2, generator=generator) - 1) / width
    moved = chart.to_pose(torch.cat([numbers[..., :2] + shift.to(pose), numbers[..., 2:]], -1))
    return torch.cat([moved[..., :3], normalize(moved[..., 3:], dim=-1)], -1)


def hard_edged(patches: Tensor) -> Tensor:
    """Turn patches (N, 6, 3, P, P) in [0, 1] into finer ones of two colours each, shape (N, 6, 3, Q, Q).

    A camera blurs edges, and what is cut out of its images is blurred; but it is at sharp edges that a reader errs.
    """
    fine = interpolate(patches.flatten(0, 1), scale_factor=FINER, mode="bicubic", align_corners=False)
    colour = fine.flatten(2).mT
    bright = colour.mean(-1)
    pair = torch.stack([colour[torch.arange(len(colour)), bright.min(1).indices],
                        colour[torch.arange(len(colour)), bright.max(1).indices]], 1)  # fmt: skip
    for _ in range(20):  # Lloyd's
        share = torch.nn.functional.one_hot(torch.cdist(colour, pair).argmin(-1), 2).to(colour)
        count = share.sum(1)[..., None]
        pair = torch.where(count > 0, share.mT @ colour / count.clamp_min(1), pair)
    drawn: Tensor = (share @ pair).clamp(0, 1).mT.reshape(*patches.shape[:3], *fine.shape[-2:])
    return drawn


def colour_noise(sights: Sequence[FirstSight]) -> float:
    """Estimate the noise of a colour [of 255] from where first frames show the background, by the median deviation."""
    rest = [(frame.astype(float) - background)[~mask.any(0)].ravel() for frame, mask, background in sights]
    noise = 1.4826 * float(np.median(np.abs(np.concatenate(rest))))
    return noise if noise > SILENT else 0.0
