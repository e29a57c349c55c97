"""Noise that is alike in neighbouring frames: of a tracker that smooths, or of poses that were interpolated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import matmul_toeplitz
from scipy.optimize import nnls
from torch import Tensor

from physid.estimation.measurement.noise_settings import NoiseSettings
from physid.estimation.measurement.poses import pose_difference

Array = NDArray[np.float64]
KINDS = (slice(0, 3), slice(3, 6))  # rotation, position
NORMAL_MAD = 1.4826  # standard deviation over median absolute deviation, for a normal distribution
TRIM, TRIMMED = 3.0, 0.98661  # cut [standard deviations], and what it leaves of a normal standard deviation
SPANS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)  # frames to the neighbours that a pose is compared with
TIMES = (0.7, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0)  # [frames] over which noise is alike
POWERS = (1, 2)  # of the correlations exp(-(frames / time)^power): rough processes, and smooth ones
SEEN, BEYOND = 2.5, 2.0  # longest spans, and the time of what is no noise, in the longest times of noise
MEANS = (1, 2, 4, 8, 16, 32)  # frames over which noise is averaged, to see how slowly it changes
WHITE = 1.5  # variance of r_t - (r_{t-k} + r_{t+k}) / 2 of white noise, in variances of r
ENOUGH = 20  # windows, times their span, that say how far poses leave their neighbours at that span
REGULAR = 0.2  # of the largest tenth of deviations, that their median exceeds: 0.41 where they are normal
LEAST_SPAN, FEW = 4, 3  # [frames] that are seen at least, and spans that say nothing yet
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
        columns = [_bent(spans, *part) for part in (*parts, (BEYOND * longest, 2))]
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
        return max(self._of_mean(n) for n in MEANS if n <= max(count // 2, 1))

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


@dataclass(frozen=True)
class CorrelatedNoise:
    """Noise of poses that is alike in neighbouring frames, of rotations and of positions.

    Attributes:
        sizes: Standard deviations of a rotation vector's components [rad] and of coordinates [m].
        correlations: Of rotations and of positions.
        frames: Of a trajectory.
        sure: How well the sizes are known, one standard deviation of their logarithm.
    """

    sizes: tuple[float, float]
    correlations: tuple[Correlation, Correlation]
    frames: int
    sure: float

    @property
    def spread(self) -> Tensor:
        """Standard deviations of white noise that disturbs slow changes as much: rotation vector, position; shape (6,).

        The largest over n of n var(mean of n frames), whose square root this is.
        """
        pairs = zip(self.sizes, self.correlations, strict=True)
        found = [size * math.sqrt(each.slow(self.frames)) for size, each in pairs]
        return torch.tensor(found, dtype=torch.float64).repeat_interleave(3)

    @property
    def floor(self) -> float:
        """Root mean square error of a position [m], without what a first place and velocity take up."""
        return self._floor(1)

    @property
    def rotation_floor(self) -> float:
        """Root mean square error of a rotation [rad], without what a first attitude and velocity take up."""
        return self._floor(0)

    def draw(self, count: int, like: Tensor, generator: torch.Generator) -> Tensor:
        """Draw the noise of so many data sets, each of the shape of `like` (R, T, N, 6).

        It is larger or smaller in all trajectories of a set alike, for its size is not known exactly.
        """
        shape = like.new_empty(count, *like.shape[:-1], 3)
        pairs = zip(self.sizes, self.correlations, strict=True)
        white = torch.cat([size * each.draw(shape, generator) for size, each in pairs], -1)
        return white * torch.exp(self.sure * torch.randn(count, 1, 1, 1, 1, generator=generator, dtype=like.dtype))

    def left_by_fit(self, values: float) -> list[tuple[float, float]]:
        """Return the mean square that it leaves of a perfect model, and how well that is known (see `Misfit.of`).

        Args:
            values: Coordinates of one kind that are compared.

        Returns:
            For rotations [rad^2] and positions [m^2]: the mean square, and the standard deviation of its logarithm, by
            as many independent values as noise that is alike is worth, and by how well its size is known.
        """
        slow = [each.slow(self.frames) for each in self.correlations]
        unsure = [math.sqrt(2 * each / max(values, 1.0) + (2 * self.sure) ** 2) for each in slow]
        return list(zip((self.rotation_floor**2, self.floor**2), unsure, strict=True))

    def _floor(self, kind: int) -> float:
        return math.sqrt(3 * self.correlations[kind].left_by_line(self.frames)) * self.sizes[kind]


def correlated_noise(
    residual: Tensor, predicted: Tensor, good: Tensor, time_step: float, up: Sequence[float], settings: NoiseSettings
) -> CorrelatedNoise | None:
    """Return what coordinates show of the noise in which a model says that nothing moves; None where that is white.

    Observed minus predicted, r, holds what a model lacks as well, which is alike in neighbouring frames. It is not
    where a body rests, and for one that slides not across the plane: there, r_t - (r_{t-k} + r_{t+k}) / 2 of all spans
    k is noise. Its variance is 1.5 sigma^2 for white noise; for correlations rho_k it is (1.5 - 2 rho_k + rho_{2k} / 2)
    sigma^2. The least that any such coordinate shows at a span, in units of what it shows at the first one, is taken
    for the noise of all.

    Args:
        residual: Observed minus predicted, shape (R, T, N, 6).
        predicted: Poses, shape (R, T, N, 7).
        good: Frames that count, shape (R, T, N).
        time_step: From frame to frame [s].
        up: The ground's normal: coordinates along it and across it are looked at.
        settings: For how long noise may be alike, what counts as alike, and where nothing moves.
    """
    longest, axes = settings.alike_for / time_step, _axes_with(up)
    spans = [span for span in SPANS if 2 * span < residual.shape[1] and span <= max(SEEN * longest, LEAST_SPAN)]
    windows = [_Windows.of(residual, predicted, good, span, axes) for span in spans]
    sizes, correlations = [], []
    for kind, least in zip(KINDS, settings.least, strict=True):
        size, correlation = _of_kind([each.of_kind(kind) for each in windows], longest, settings)
        if size < least or float(correlation.between(np.ones(()))) < settings.alike:
            size, correlation = _largest(windows[0].of_kind(kind), settings) if windows else 0.0, UNCORRELATED
        sizes.append(max(size, least))
        correlations.append(correlation)
    if all(each == UNCORRELATED for each in correlations):
        return None
    return CorrelatedNoise((sizes[0], sizes[1]), (correlations[0], correlations[1]), residual.shape[1], settings.sure)


def _of_kind(windows: list[_Windows], longest: float, settings: NoiseSettings) -> tuple[float, Correlation]:
    """Return size and correlation of the noise of rotations or positions, white where little can be seen."""
    first = next((each for each in windows if each.regular), None)
    if first is None:
        return 0.0, UNCORRELATED
    unit = first.rough()
    unit = torch.where(unit >= settings.still * unit.amax(), unit, torch.nan)
    bends = {first.span: 1.0}
    for each in windows[windows.index(first) + 1 :]:
        ratio = each.idle(settings.idle * unit) / first.idle(settings.idle * unit)
        if bool(ratio.isfinite().any()):
            bends[each.span] = float(ratio[ratio.isfinite()].min()) ** 2
    if len(bends) < FEW:
        return 0.0, UNCORRELATED
    correlation, variance = Correlation.of(bends, longest)
    return float(unit.nan_to_num(0.0).max()) * math.sqrt(variance), correlation


def _largest(windows: _Windows, settings: NoiseSettings) -> float:
    """Return the size of white noise that is as rough, of the axis that has most."""
    return float(windows.rough().max()) if len(windows.bent) else 0.0


@dataclass(frozen=True)
class _Windows:
    """Frames with two neighbours, as many frames before as after.

    Attributes:
        span: Frames to a neighbour.
        bent: |r_t - (r_{t-k} + r_{t+k}) / 2|, shape (W, 6) or (W, 3).
        moved: By how much the prediction moves from the one neighbour to the frame, or to the other one; same shape.
    """

    span: int
    bent: Tensor
    moved: Tensor

    @classmethod
    def of(cls, residual: Tensor, predicted: Tensor, good: Tensor, span: int, axes: Tensor) -> _Windows:
        """Return the windows whose three frames count, in coordinates along some axes (3, 3)."""
        before, middle, after = slice(None, -2 * span), slice(span, -span), slice(2 * span, None)
        used = (good[:, before] > 0) & (good[:, middle] > 0) & (good[:, after] > 0)
        bent = residual[:, middle] - (residual[:, before] + residual[:, after]) / 2
        ways = [pose_difference(predicted[:, end], predicted[:, middle])[used] for end in (before, after)]
        along, *moved = ((each.unflatten(-1, (2, 3)) @ axes.mT).flatten(-2).abs() for each in (bent[used], *ways))
        return cls(span, along, torch.maximum(*moved))

    def of_kind(self, kind: slice) -> _Windows:
        """Return those of rotations or of positions."""
        return _Windows(self.span, self.bent[:, kind], self.moved[:, kind])

    @property
    def regular(self) -> bool:
        """Whether deviations are spread as normal ones are; of poses that were interpolated most are nearly zero."""
        if len(self.bent) < ENOUGH * self.span:
            return False
        middle, high = self.bent.quantile(torch.tensor([0.5, 0.9], dtype=self.bent.dtype), 0)
        return float((middle / high).nan_to_num(0.0).max()) > REGULAR

    def rough(self) -> Tensor:
        """Return the standard deviation of white noise that is as rough, by all windows, shape (6,) or (3,)."""
        found: Tensor = torch.stack([deviation(values) for values in self.bent.T]) / WHITE**0.5
        return found

    def idle(self, most: Tensor) -> Tensor:
        """Return the same by windows in which the prediction moves less than `most`; NaN where they are few."""
        rough = [
            deviation(values[still]) if int(still.sum()) >= ENOUGH * self.span else values.new_tensor(torch.nan)
            for values, still in zip(self.bent.T, (self.moved <= most).T, strict=True)
        ]
        found: Tensor = torch.stack(rough) / WHITE**0.5
        return found


def deviation(values: Tensor) -> Tensor:
    """Estimate a standard deviation from absolute values: by their median, then by those within a few of it."""
    rough = NORMAL_MAD * values.median()
    normal = values[values <= TRIM * rough]
    found: Tensor = normal.square().mean().sqrt() / TRIMMED
    return found


def _axes_with(up: Sequence[float]) -> Tensor:
    """Return three perpendicular unit vectors, the last one upwards, shape (3, 3)."""
    normal = np.array(up) / np.linalg.norm(up)
    across = np.linalg.svd(normal[None])[2][1:]
    return torch.from_numpy(np.stack([*across, normal]))


def _alike(frames: Array, time: float, power: int) -> Array:
    """Return exp(-(frames / time)^power); of white noise, which has no time, that of a frame with itself."""
    alike: Array = np.exp(-((frames / time) ** power)) if time else (frames == 0).astype(np.float64)
    return alike


def _bent(span: Array, time: float, power: int) -> Array:
    """Return the variance of r_t - (r_{t-k} + r_{t+k}) / 2 over that of white noise."""
    bent: Array = (WHITE - 2 * _alike(span, time, power) + _alike(2 * span, time, power) / 2) / WHITE
    return bent
