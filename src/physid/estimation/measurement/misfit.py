"""What residuals hold beside white noise, with no noise level assumed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

from torch import Tensor

SHARE_OF_NOISE, SHARE_OF_SIZE = 0.15, 2e-4
"""What a model may leave by default before it matters, to a fit and to a diagnosis alike: of the noise, and of the
largest edge of a body, whose faces are not flat and whose edges are not sharp."""
TINY = 1e-300
SQUARES = (1.0, 9.0, 9.0, 1.0)  # of the coefficients of a third difference
DEVIATION = 2 * (15**2 + 6**2 + 1) / 20**2 * 2
"""Variance of mean(r^2) - mean((D^3 r)^2) / 20 for n differences of white noise, in sigma^4 / n: twice the squares of
the off-diagonal entries of the quadratic form. Its diagonal is zero, so that heavy tails do not count."""


@final
@dataclass(frozen=True)
class Misfit:
    """How far a model leaves poses beyond what differs at random from frame to frame.

    Attributes:
        size: Root mean square of the distance, or angle, without the noise [m or rad]; zero where there is none.
        noise: Standard deviation of the noise along each axis [m or rad], the largest of the axes.
        score: Excess of the mean square, or of its logarithm over that of a tracking error, over its own deviation if
            there were noise alone; standard normal then.
    """

    size: float
    noise: float
    score: float

    @classmethod
    def of(cls, residual: Tensor, real: Tensor, tracked: tuple[float, float] | None = None) -> Misfit:
        """Compare residuals with their own third differences (von Neumann 1941, with differences of third order).

        White noise has the variance that its differences have, at any stamps; a motion that the model does not follow
        is smooth from frame to frame, and its differences nearly vanish. Fitted parameters take a little of the mean
        square away, so that the score is on the safe side.

        Args:
            residual: Predicted less recorded positions or rotation vectors of N bodies, shape (B, T, N, 3).
            real: Which frames count, shape (B, T).
            tracked: Where errors of the poses are as smooth as a motion, in films and of trackers: the mean square that
                these leave, and the standard deviation of its logarithm (see `TrackingError.left_by_fit`).

        Returns:
            The misfit; zero where no four frames follow each other.
        """
        inside = real.unfold(1, 4, 1).all(-1) if real.shape[1] >= 4 else real[:, :0]
        if not bool(inside.any()):
            return cls(0.0, 0.0, 0.0)
        # Frames count as often as the differences hold them, so that no single square is left in the excess.
        weights = residual.new_tensor(SQUARES) / sum(SQUARES)
        square = (residual.square().unfold(1, 4, 1) @ weights)[inside].mean(0)
        if tracked is not None:
            found, (expected, unsure) = float(square.sum(-1).mean()), tracked
            score = math.log(max(found, TINY) / max(expected, TINY)) / unsure
            return cls(math.sqrt(max(found - expected, 0.0)), math.sqrt(expected / residual.shape[-1]), score)
        noise = residual.diff(n=3, dim=1)[inside].square().mean(0) / sum(SQUARES)
        excess = float((square - noise).sum(-1).mean())
        deviation = math.sqrt(DEVIATION * float(noise.square().sum()) / float(inside.sum())) / len(noise)
        score = excess / deviation if deviation > 0 else math.copysign(math.inf, excess) if excess else 0.0
        return cls(math.sqrt(max(excess, 0.0)), math.sqrt(float(noise.max())), score)
