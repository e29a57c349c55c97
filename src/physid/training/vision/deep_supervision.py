"""Deep supervision: convolutions learn what tells rotations apart, before the last layer can make use of it."""

from __future__ import annotations

from typing import final

import torch
from torch import Tensor, nn

from physid.networks import Encoding, PlanarChart, PoseChart
from physid.networks.encoder import CONVOLUTIONS, EARLY

HARMONICS = (1, 2, 4)
PLACES = 12.0
"""About how many places of a map of features see a body: what is summed over the map is divided by it."""


@final
class DeepSupervision(nn.Module):
    """Reads rotations linearly from what the third and the last convolution see anywhere (Lee et al. 2015).

    A block and its opposite look nearly alike, so that (cos yaw, sin yaw), the first harmonic, is uncorrelated with
    everything a network sees at first, and a squared error of it stays on a plateau. The fourth harmonic, which edges
    show, and the second, which the long axis shows, are learnt at once, and the first one from their features. These
    layers serve in training alone; the encoder's stay what they are.

    Args:
        chart: What the encoder's numbers mean.
    """

    def __init__(self, chart: PoseChart) -> None:
        super().__init__()
        outputs = rotation_features(chart, chart.neutral().expand(chart.bodies, -1)).numel()
        channels = [wider for _, wider, _, _ in CONVOLUTIONS]
        self.early, self.late = nn.Linear(channels[EARLY - 1], outputs), nn.Linear(channels[-1], outputs)

    def forward(self, chart: PoseChart, encoding: Encoding, numbers: Tensor) -> Tensor:
        """Compute how far the rotations are from what is read.

        Args:
            chart: What the numbers mean.
            encoding: Of B f images.
            numbers: Those of the poses that the images show, shape (B, f, N, K).

        Returns:
            Squared errors of both layers, summed over bodies; shape (B, f).
        """
        goal = rotation_features(chart, numbers).flatten(-2)
        read = (self.early(encoding.early / PLACES), self.late(encoding.late / PLACES))
        return torch.stack([(one - goal).square().sum(-1) for one in read]).sum(0)


def rotation_features(chart: PoseChart, numbers: Tensor) -> Tensor:
    """Return harmonics (cos n a, sin n a) of angles, or the numbers of rotations in space; shape (..., N, F)."""
    turn = numbers[..., chart.turning]
    if not isinstance(chart, PlanarChart):
        return turn
    angle = torch.atan2(turn[..., 1], turn[..., 0])[..., None] * turn.new_tensor(HARMONICS)
    return torch.cat([angle.cos(), angle.sin()], -1)
