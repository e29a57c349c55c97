"""How alike the noise of a coordinate is from frame to frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import matmul_toeplitz
from scipy.optimize import nnls
from torch import Tensor

from physid.estimation.measurement.tracking_error import SPANS

Array = NDArray[np.float64]
TIMES = (0.7, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0)  # [frames] over which noise is alike
POWERS = (1, 2)  # of the correlations exp(-(frames / time)^power): rough processes, and smooth ones
WHITE = 1.5  # variance of r_t - (r_{t-k} + r_{t+k}) / 2 of white noise, in variances of r
FORGOTTEN = 8  # times after which nothing is alike any more


@dataclass(frozen=True)
class Correlation:
    """How alike the noise of a coordinate is in frames that are k apart: sum_i s_i exp(-(k / t_i)^p_i).

    Attributes:
        parts: Share of the variance s, time t [frames] and power p of each; those of white noise have no time.
    """

    parts: tuple[tuple[float, float, int], ...]

    @classmethod
    def of(cls, bends: dict[int, float], longest: float) -> tuple[Correlation, float]:
        """Explain how far poses leave the middle of their neighbours by noise, and by what a model lacks.

        What a model lacks is a smooth process of twice the longest time of noise, half the longest span at most.

        Args:
            bends: Variance of r_t - (r_{t-k} + r_{t+k}) / 2 by span k, in that of white noise of some size.
            longest: Time over which noise is alike [frames].

        Returns:
            The correlation and the variance of the noise, by least squares without negative shares: relative variances
            count by the inverse of their span.
        """
        spans, values = np.array(list(bends)), np.array(list(bends.values()))
        longest = min(longest, max(bends) / 2)
        parts = [(0.0, 1), *((time, power) for time in TIMES if time <= longest for power in POWERS)]
        columns = [_bent(spans, *part) for part in (*parts, (2 * longest, 2))]
        rows = 1 / (values * np.sqrt(spans))
        shares, _ = nnls(np.stack(columns, 1) * rows[:, None], values * rows)
        variance = float(shares[:-1].sum())
        return cls(
            tuple((float(s) / variance, *part) for s, part in zip(shares[:-1], parts, strict=True) if s > 0)
        ), variance

    def between(self, frames: Array) -> Array:
        """Return the correlation of frames that lie so far apart, of any shape."""
        alike: Array = sum(
            (share * _alike(frames, time, power) for share, time, power in self.parts), np.zeros(frames.shape)
        )
        return alike

    def slow(self, count: int) -> float:
        """Return the largest of n var(mean of n frames) in variances of one, n at most half of so many frames."""
        return max(self._of_mean(n) for n in SPANS if n <= max(count // 2, 1))

    def left_by_line(self, count: int) -> float:
        """Return the share of the variance that is left by a line over so many frames."""
        rows = np.stack([np.ones(count), np.linspace(-1.0, 1.0, count)])
        rows /= np.linalg.norm(rows, axis=1, keepdims=True)
        taken = (rows.T * matmul_toeplitz(self.between(np.arange(float(count))), rows.T)).sum()
        return max(1 - float(taken) / count, 0.0)

    def draw(self, like: Tensor, generator: torch.Generator) -> Tensor:
        """Draw noise of variance one, of the shape of `like`, whose frames are along the third axis from the last.

        White noise with the spectrum of the correlations, over a circle so long that its ends do not meet.
        """
        count = like.shape[-3]
        around = count + math.ceil(FORGOTTEN * max(time for _, time, _ in self.parts))
        apart = np.minimum(np.arange(around), around - np.arange(around))
        power = np.fft.rfft(self.between(apart.astype(np.float64))).real.clip(0)
        white = torch.randn(*like.shape[:-3], around, *like.shape[-2:], generator=generator, dtype=like.dtype)
        gain = torch.from_numpy(np.sqrt(power)).to(like.dtype)[:, None, None]
        drawn: Tensor = torch.fft.irfft(torch.fft.rfft(white, dim=-3) * gain, n=around, dim=-3)
        return drawn.narrow(-3, 0, count)

    def _of_mean(self, count: int) -> float:
        apart = np.arange(1.0 - count, count)
        return float(((1 - np.abs(apart) / count) * self.between(np.abs(apart))).sum())


UNCORRELATED = Correlation(((1.0, 0.0, 1),))
"""White noise."""


def _alike(frames: Array, time: float, power: int) -> Array:
    """Return exp(-(frames / time)^power); of white noise, which has no time, that of a frame with itself."""
    alike: Array = np.exp(-((frames / time) ** power)) if time else (frames == 0).astype(np.float64)
    return alike


def _bent(span: Array, time: float, power: int) -> Array:
    """Return the variance of r_t - (r_{t-k} + r_{t+k}) / 2 over that of white noise."""
    bent: Array = (WHITE - 2 * _alike(span, time, power) + _alike(2 * span, time, power) / 2) / WHITE
    return bent
