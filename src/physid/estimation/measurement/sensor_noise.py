"""How noisy the observed poses are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.estimation.measurement.correlated_noise import CorrelatedNoise
from physid.estimation.measurement.deviation import bends, deviation
from physid.estimation.measurement.noise_settings import DEFAULT, NoiseSettings
from physid.estimation.measurement.poses import pose_difference
from physid.estimation.measurement.tracking_error import TrackingError

WINDOW = 4  # frames of a third difference, in which a smooth motion hardly shows


@dataclass(frozen=True)
class Noise:
    """Noise of the observed poses: white, or as white noise that disturbs slow changes as much.

    Attributes:
        rotation: Standard deviation of each component of a rotation vector [rad].
        position: Standard deviation of each coordinate [m].
        error: What this noise stands for where it is not white: the error of a reader of films, or of a tracker whose
            errors are alike in neighbouring frames.
        least: Least noise of rotations [rad] and of positions [m].
    """

    rotation: float
    position: float
    error: TrackingError | CorrelatedNoise | None = None
    least: tuple[float, float] = DEFAULT.least

    @property
    def floor(self) -> float:
        """Root mean square position error of a perfect model, sqrt(3) sigma where the noise is white [m]."""
        return 3**0.5 * self.position if self.error is None else self.error.floor

    @property
    def rotation_floor(self) -> float:
        """Root mean square rotation error of a perfect model, sqrt(3) sigma where the noise is white [rad]."""
        if isinstance(self.error, CorrelatedNoise):
            return self.error.rotation_floor
        return 3**0.5 * self.rotation

    def spread(self) -> Tensor:
        """Return the standard deviations of the six coordinates of a pose, shape (6,)."""
        if self.error is not None:
            return self.error.spread.maximum(torch.tensor(self.least, dtype=torch.float64).repeat_interleave(3))
        return torch.tensor([self.rotation] * 3 + [self.position] * 3, dtype=torch.float64)

    def or_less(self, other: Noise) -> Noise:
        """Return this noise with the smaller deviations of both: each estimate holds motion that it did not remove."""
        return replace(self, rotation=min(self.rotation, other.rotation), position=min(self.position, other.position))

    def of_tracker(self, error: CorrelatedNoise | None) -> Noise:
        """Return the noise of a tracker whose errors are alike in neighbouring frames; the same where none are."""
        return self if error is None else Noise(*_largest(error.spread, self.least), error, self.least)

    def draw(self, count: int, like: Tensor, generator: torch.Generator) -> Tensor:
        """Draw the noise of so many data sets, each of the shape of `like` (R, T, N, 6)."""
        if self.error is not None:
            return self.error.draw(count, like, generator)
        return torch.randn(count, *like.shape, generator=generator, dtype=like.dtype) * self.spread()


UNSEEN = Noise(*DEFAULT.unseen)
"""What is assumed where there is too little to tell."""


def estimate_noise(
    residual: Tensor, weight: Tensor, error: TrackingError | None = None, settings: NoiseSettings = DEFAULT
) -> Noise:
    """Estimate white noise from residuals: by r_t - (r_{t-1} + r_{t+1}) / 2, which an error of the model hardly enters.

    Args:
        residual: Observed minus predicted, shape (R, T, N, 6).
        weight: Weights of the frames, 0 for those to ignore, shape (R, T, N).
        error: That of a reader of films, whose size is then estimated.
        settings: The least noise, and when an axis says nothing.
    """
    if error is not None:
        error = replace(error.sized(residual, weight), sure=settings.sure)
        return Noise(*_largest(error.spread, settings.least), error, settings.least)
    bent, good = bends(residual, weight)
    return _of_differences(bent[good] / 1.5**0.5, settings)


def noise_of_poses(pose: Tensor, real: Tensor, time: Tensor | None = None, settings: NoiseSettings = DEFAULT) -> Noise:
    """Estimate white noise from poses alone, before any model is fitted.

    Third divided differences of a smooth motion vanish with the third power of the time step; what remains is noise.
    Their median magnitude does not see the few frames around an impact (Rice 1984, Hampel 1974). Weights are
    w_i = 1 / prod_j (t_i - t_j), over the root of their sum of squares, so that white noise keeps its size.

    Args:
        pose: Recorded poses, at least four frames of each trajectory, shape (B, T, N, 7).
        real: Frames that count, shape (B, T).
        time: Times of the frames [s], shape (B, T); None for even ones.
        settings: The least noise, what is assumed where too little is seen, and when an axis says nothing.

    Returns:
        The noise, at least the least; what is assumed where trajectories are too short to tell.
    """
    if pose.shape[1] < WINDOW:
        return Noise(*settings.unseen)
    time = torch.arange(pose.shape[1]).to(pose).expand(pose.shape[:2]) if time is None else time
    windows, since = pose.unfold(1, WINDOW, 1).movedim(-1, 2), time.unfold(1, WINDOW, 1)
    inside = real.unfold(1, WINDOW, 1).all(-1)
    apart = since[..., :, None] - since[..., None, :] + torch.eye(WINDOW).to(since)
    weight = 1 / torch.where(inside[..., None], apart.prod(-1), 1.0)
    weight = weight / weight.norm(dim=-1, keepdim=True)
    motion = pose_difference(windows, windows[:, :, :1].expand_as(windows))
    return _of_differences(torch.einsum("btw,btwni->btni", weight, motion)[inside].flatten(0, 1), settings)


def _of_differences(values: Tensor, settings: NoiseSettings) -> Noise:
    """Estimate noise from differences (n, 6) that have its size; axes in which nothing moves say nothing."""
    if not len(values):
        return Noise(*settings.unseen)
    found = []
    for kind, floor in zip(values.abs().split(3, -1), settings.least, strict=True):
        rough = kind.median(0).values
        found.append(max(float(deviation(kind[:, rough >= settings.still * rough.max()].flatten())), floor))
    return Noise(found[0], found[1], least=settings.least)


def _largest(spread: Tensor, least: tuple[float, float]) -> tuple[float, float]:
    """Return the largest standard deviation of a rotation and of a position, of six."""
    return max(float(spread[:3].max()), least[0]), max(float(spread[3:].max()), least[1])
