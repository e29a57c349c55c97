"""An encoder whose places vote: where a body is and how it is turned is read beside it, wherever that is."""

from __future__ import annotations

from typing import final

import torch
from torch import Tensor, nn

from physid.networks.chart import PoseChart
from physid.networks.convolutions import convolve_focused, field_of
from physid.networks.encoder import (
    CONVOLUTIONS,
    EARLY,
    INITIAL_SPREAD,
    Encoder,
    Layers,
    build_convolutions,
    in_fast_precision,
    scale_weights,
)

VOTING = CONVOLUTIONS[-1][1]
"""Channels from which a place votes: as many as the paper's last convolution has."""
BELOW = 0.05
"""Of a height below the ground: bodies rest on it. What is read below is nearly zero, yet has a slope to learn by."""
CORRECTION = 64
"""Units of the layer that corrects what is voted, by where all bodies are."""


@final
class VotingPoseEncoder(Encoder):
    """Reads poses by votes: each place of the third convolution's map says where every body is, and how it is turned.

    A place sees 29 x 29 pixels, a body and what surrounds it, and says the same of a body wherever that is: it votes
    for positions relative to its own, so that the network need not learn them at every place anew, as connected layers
    must. The votes are averaged by weights that the places give themselves, w = softmax(a): number k of a body is
    sum_p w_p (g_p + v_p), with g_p the place itself for the first two numbers of the chart and the neutral pose for
    the others. Votes are those of Peng et al. (2019), the mean over a softmax is that of Levine et al. (2016). What
    depends on where a body is, such as how a height moves it in the image, a small connected layer adds. Where bodies
    may hover, none is below the ground: heights below it are shortened to a twentieth.

    Args:
        chart: What the outputs mean.
        height: Image height [px].
        width: Image width [px].
        layers: How the layers begin and compute.

    Raises:
        ValueError: If images are smaller than what a place sees.
    """

    grid: Tensor
    apart: Tensor
    neutral: Tensor
    below: Tensor

    def __init__(self, chart: PoseChart, height: int = 128, width: int = 128, layers: Layers = Layers()) -> None:
        super().__init__(chart, layers)
        self.fast = layers.fast
        self.convolutions = build_convolutions(0, EARLY)
        self.convolutions.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        seen, count = CONVOLUTIONS[EARLY - 1][1], chart.bodies * chart.numbers
        self.hidden = nn.Sequential(nn.Conv2d(seen, VOTING, 1), nn.ELU(), nn.Conv2d(VOTING, VOTING, 1), nn.ELU())
        self.votes = nn.Conv2d(VOTING, count + chart.bodies, 1)
        last = nn.Linear(CORRECTION, count)
        self.correction = nn.Sequential(nn.Linear(count, CORRECTION), nn.ELU(), last)
        if layers.initial_weights == "scaled":
            scale_weights(self)
        with torch.no_grad():
            for weight in (self.votes.weight, last.weight):
                weight.mul_(INITIAL_SPREAD)
        field, stride = field_of(list(self.convolutions))
        if min(height, width) < field:
            raise ValueError(
                f"frames of {height} x {width} px are too small for the encoder; use at least {field} x {field} px"
            )
        rows, columns = (
            (field + 2 * torch.arange(0, length - field + 1, stride)) / length - 1 for length in (height, width)
        )
        self.register_buffer("grid", torch.stack(torch.meshgrid(columns, rows, indexing="xy")), persistent=False)
        self.register_buffer("apart", torch.tensor([[2 * stride / width], [2 * stride / height]]), persistent=False)
        self.register_buffer("neutral", chart.neutral()[2:], persistent=False)
        below = torch.ones(chart.bodies, chart.numbers)
        below[:, chart.heights] = BELOW
        self.register_buffer("below", below.flatten(), persistent=False)

    def read(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Average the votes of all places; they have no distribution."""
        device, occupied = image.device.type, image[:, -1] != 0
        with in_fast_precision(device, self.fast):
            detail = convolve_focused(self.convolutions, image, occupied)
        with torch.autocast(device, enabled=False):
            seen = self.hidden(detail.to(self.grid.dtype))
            said = self.votes(seen).unflatten(1, (self.chart.bodies, -1)).flatten(-2)
            own, votes = said[:, :, :1], said[:, :, 1:]
            place = self.grid.flatten(1) + self.apart * votes[:, :, :2]
            others = self.neutral[:, None] + votes[:, :, 2:]
            voted = (own.softmax(-1) * torch.cat([place, others], 2)).sum(-1).flatten(1)
            flat = voted + self.correction(voted)
            flat = torch.where(flat < 0, self.below * flat, flat)
        return flat, flat.new_zeros(len(flat)), detail.float().sum((-2, -1)), seen.sum((-2, -1))
