"""Noise that is alike in neighbouring frames: of a tracker that smooths, or of poses that were interpolated."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

from physid.estimation.measurement.correlation import UNCORRELATED, WHITE, Correlation
from physid.estimation.measurement.deviation import bends, deviation
from physid.estimation.measurement.noise_settings import NoiseSettings
from physid.estimation.measurement.poses import pose_difference

KINDS = (slice(0, 3), slice(3, 6))  # rotation, position
NEIGHBOURS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)  # frames to those that a pose is compared with


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
        up: The ground's normal: coordinates along it and across it are inspected.
        settings: For how long noise may be alike, what counts as alike, and where nothing moves.
    """
    longest, axes = settings.alike_for / time_step, _axes_with(up)
    spans = [span for span in NEIGHBOURS if 2 * span < residual.shape[1] and span <= 3 * longest]
    sizes, correlations = [], []
    for kind, least in zip(KINDS, settings.least, strict=True):
        windows_of = partial(_Windows.of, residual, predicted, good, axes, kind)
        size, correlation = _of_kind(windows_of, spans, longest, settings)
        if size < least or float(correlation.between(np.ones(()))) < settings.alike:
            size, correlation = (float(windows_of(1).rough().max()) if spans else 0.0), UNCORRELATED
        sizes.append(max(size, least))
        correlations.append(correlation)
    if all(each == UNCORRELATED for each in correlations):
        return None
    return CorrelatedNoise((sizes[0], sizes[1]), (correlations[0], correlations[1]), residual.shape[1], settings.sure)


def _of_kind(
    windows_of: Callable[[int], _Windows], spans: Iterable[int], longest: float, settings: NoiseSettings
) -> tuple[float, Correlation]:
    """Return size and correlation of the noise of rotations or positions, white where little can be seen."""
    bends: dict[int, float] = {}
    for span in spans:
        windows = windows_of(span)
        if not bends and not windows.regular(settings):
            continue
        if not bends:
            unit = windows.rough()
            unit = torch.where(unit >= settings.still * unit.amax(), unit, torch.nan)
            first = windows.idle(unit, settings)
        ratio = windows.idle(unit, settings) / first
        if bool(ratio.isfinite().any()):
            bends[span] = float(ratio[ratio.isfinite()].min()) ** 2
        elif not bends:
            break
    if len(bends) < 3:
        return 0.0, UNCORRELATED
    correlation, variance = Correlation.of(bends, longest)
    return float(unit.nan_to_num(0.0).max()) * math.sqrt(variance), correlation


@dataclass(frozen=True)
class _Windows:
    """Frames with two neighbours, as many frames before as after.

    Attributes:
        span: Frames to a neighbour.
        bent: |r_t - (r_{t-k} + r_{t+k}) / 2|, shape (W, 3).
        moved: By how much the prediction moves from the one neighbour to the frame, or to the other one; same shape.
    """

    span: int
    bent: Tensor
    moved: Tensor

    @classmethod
    def of(cls, residual: Tensor, predicted: Tensor, good: Tensor, axes: Tensor, kind: slice, span: int) -> _Windows:
        """Return the windows whose three frames count, of rotations or positions along some axes (3, 3)."""
        bent, used = bends(residual[..., kind], good, span)
        ends = predicted[:, : -2 * span], predicted[:, 2 * span :]
        ways = [pose_difference(end, predicted[:, span:-span])[..., kind] for end in ends]
        along, *moved = ((each[used] @ axes.mT).abs() for each in (bent, *ways))
        return cls(span, along, torch.maximum(*moved))

    def regular(self, settings: NoiseSettings) -> bool:
        """Whether no axis goes along straight lines: of poses that were interpolated most lie between two others."""
        if len(self.bent) < settings.windows * self.span:
            return False
        high = torch.from_numpy(np.quantile(self.bent.numpy(), 0.9, axis=0))
        straight = (self.bent <= settings.straight * high).double().mean(0)
        return bool((straight <= 0.5)[high >= settings.still * high.amax()].all())

    def rough(self) -> Tensor:
        """Return the standard deviation of white noise that is as rough, by all windows, shape (3,)."""
        found: Tensor = torch.stack([deviation(values) for values in self.bent.T]) / WHITE**0.5
        return found

    def idle(self, unit: Tensor, settings: NoiseSettings) -> Tensor:
        """Return the same by windows in which the prediction moves by a part of `unit`; NaN where they are few."""
        few, still = settings.windows * self.span, self.moved <= settings.idle * unit
        rough = [
            deviation(values[idle]) if int(idle.sum()) >= few else values.new_tensor(torch.nan)
            for values, idle in zip(self.bent.T, still.T, strict=True)
        ]
        found: Tensor = torch.stack(rough) / WHITE**0.5
        return found


def _axes_with(up: Sequence[float]) -> Tensor:
    """Return three perpendicular unit vectors, the last one upwards, shape (3, 3)."""
    normal = np.array(up) / np.linalg.norm(up)
    across = np.linalg.svd(normal[None])[2][1:]
    return torch.from_numpy(np.stack([*across, normal]))
