"""What a fit leaves where something happens: at more events than chance does, it is the model that fails there."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from scipy.stats import binom
from torch import Tensor

from physid.estimation.measurement import Noise
from physid.estimation.prediction import Segmentation
from physid.estimation.segmented_fit.settings import UnexplainedSettings


@dataclass(frozen=True)
class UnexplainedEvents:
    """Segments with an event, too many of which no initial state explains.

    Attributes:
        unexplained: How many are not explained.
        among: Of how many.
        position: What the model leaves of positions there, beyond noise: root mean square, the median of these [m].
        rotation: The same of rotations [rad].
    """

    unexplained: int
    among: int
    position: float
    rotation: float


def unexplained_events(
    square: Tensor, struck: Tensor, noise: Noise, settings: UnexplainedSettings
) -> UnexplainedEvents | None:
    """Return what the model leaves at events, or None where it explains as many of them as a true one would.

    In a few segments with an impact no initial state is found that explains them, or a tracker errs there. Frames and
    segments like these count little in a fit, and so does what the model leaves there. Where more are unexplained than
    chance allows it has to be said, since the errors of the fit do not show it: k of n, where k or more have a
    probability of less than `chance` if each has that of `usual` (binomial).

    Args:
        square: Mean squared length of the residuals of rotations [rad^2] and positions [m^2] in each segment (see
            `squares_of_segments`), zeros where nothing was seen, shape (K, 2).
        struck: Which segments hold an event, shape (K,).
        noise: Of the poses.
        settings: What is unexplained, and how many by chance.
    """
    left = square[struck & (square > 0).any(-1)]
    unexplained = misfit_of_segments(left, noise) > settings.misfit
    count = int(unexplained.sum())
    if not count or binom.sf(count - 1, len(left), settings.usual) >= settings.chance:
        return None
    rotation, position = (left[unexplained] - _floor(noise)).clamp_min(0).sqrt().median(0).values.tolist()
    return UnexplainedEvents(count, len(left), position, rotation)


def misfit_of_segments(square: Tensor, noise: Noise) -> Tensor:
    """Return mean squared residuals in those of the noise, (K,), from those of rotations and positions (K, 2)."""
    misfit: Tensor = (square / _floor(noise)).mean(-1)
    return misfit


def _floor(noise: Noise) -> Tensor:
    return torch.tensor([noise.rotation_floor, noise.floor], dtype=torch.float64).square()


def squares_of_segments(segments: Segmentation, residual: Tensor, present: Tensor) -> Tensor:
    """Return the mean squared length of residuals of rotations and positions in each segment, shape (K, 2).

    The worst frame of each is left out: a frame that stands alone says nothing of an impact, which lasts.

    Args:
        segments: The segments.
        residual: Observed minus predicted, shape (R, T, N, 6).
        present: Frames that exist and are not outliers, shape (R, T, N).
    """
    square = residual.unflatten(-1, (2, 3)).square().sum(-1) * present[..., None]
    total, count = square.sum(2), present.sum(2)
    found: Tensor = square.new_zeros(len(segments), 2)
    for batch in segments.batches:
        own, frames = batch.cut(total[None], fill=0.0)[0], batch.cut(count[None].to(square), fill=0.0)[0]
        worst = (own / frames.clamp_min(1)[..., None]).argmax(1, keepdim=True)
        left = own.sum(1) - own.gather(1, worst)[:, 0]
        seen = frames.sum(1, keepdim=True) - frames[..., None].expand_as(own).gather(1, worst)[:, 0]
        found[batch.segments] = left / seen.clamp_min(1)
    return found
