"""What a fit leaves where something happens: at most events more than chance does, it is the model that fails there."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.estimation.least_squares import Fit
from physid.estimation.measurement import Noise
from physid.estimation.prediction import Segmentation
from physid.estimation.segmented_fit.settings import UnexplainedSettings


@dataclass(frozen=True)
class UnexplainedEvents:
    """Segments with an event, most of which no initial state explains.

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
    """Return what the model leaves at events, or None where it explains half of them.

    In a few segments with an impact no initial state is found that explains them, or a tracker errs there. Frames and
    segments like these count little in a fit, and so does what the model leaves there. Where most are unexplained that
    is no chance, and has to be said, since the errors of the fit do not show it.

    Args:
        square: Mean squared length of the residuals of rotations [rad^2] and positions [m^2] in each segment, all
            frames alike, zeros where nothing was seen, shape (K, 2).
        struck: Which segments hold an event, shape (K,).
        noise: Of the poses.
        settings: What is unexplained, and of how many.
    """
    floor = torch.tensor([noise.rotation_floor, noise.floor], dtype=square.dtype).square()
    left = square[struck & (square > 0).any(-1)]
    unexplained = (left / floor).mean(-1) > settings.misfit
    if not bool(unexplained.any()) or float(unexplained.double().mean()) <= settings.most:
        return None
    rotation, position = (left[unexplained] - floor).clamp_min(0).sqrt().median(0).values.tolist()
    return UnexplainedEvents(int(unexplained.sum()), len(left), position, rotation)


def squares_of_segments(segments: Segmentation, fit: Fit, present: Tensor) -> Tensor:
    """Return the mean squared length of the residuals of rotations and positions of each segment, shape (K, 2).

    Args:
        segments: The segments.
        fit: What they leave.
        present: Frames that exist and are not outliers, shape (R, T, N).
    """
    square = fit.residual.unflatten(-1, (2, 3)).square().sum(-1) * present[..., None]
    count = segments.sum_frames(present.sum(-1)[None].to(square))[0]
    return segments.sum_frames(square.sum(2).movedim(-1, 0)).T / count.clamp_min(1)[:, None]
