"""Drawn images compared with those seen, both blurred: where bodies hardly overlap, sharp ones have no slope."""

from __future__ import annotations

from torch import Tensor

from physid.networks import GaussianBlur
from physid.training.parameters import mean_over_time


def mismatch(blur: GaussianBlur, drawn: Tensor, seen: Tensor, real: Tensor) -> Tensor:
    """Return how far drawn images are from those seen, the mean square of the colours.

    Args:
        blur: The blur.
        drawn: Images in [0, 1], not blurred yet, shape (B, f, 3, H, W).
        seen: Blurred images, of the same shape.
        real: Which images count, shape (B, f).

    Returns:
        The mean over the images of each trajectory, shape (B,).
    """
    difference: Tensor = blur(drawn) - seen
    return mean_over_time(difference.square().mean((-3, -2, -1)), real)


def left_undrawn(blur: GaussianBlur, seen: Tensor, background: Tensor, real: Tensor) -> Tensor:
    """Return what the empty scenes leave of images seen, the same mean square of all real ones, shape ().

    Args:
        blur: The blur.
        seen: Blurred images, shape (B, f, 3, H, W).
        background: The empty scenes in [0, 1], not blurred yet, shape (B, 3, H, W).
        real: Which images count, shape (B, f).
    """
    nothing = (seen - blur(background)[:, None]).square().mean((-3, -2, -1))
    unit: Tensor = nothing[real].mean()
    return unit
