"""How noisy the observed poses are, and which of them are outliers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.estimation.measurement.poses import pose_difference
from physid.estimation.measurement.tracking_error import SURE, TrackingError
from physid.setting import Section, setting

NORMAL_MAD = 1.4826  # standard deviation over median absolute deviation, for a normal distribution
TRIM, TRIMMED = 3.0, 0.98661  # cut [standard deviations], and what it leaves of a normal standard deviation
WINDOW = 4  # frames of a third difference, in which a smooth motion hardly shows


class NoiseSettings(Section):
    """The noise of observed poses, and which of them count."""

    least: tuple[float, float] = setting(
        (1e-3, 1e-4), "rad, m", "least noise: below, engines differ by more, say in how a pushed block turns"
    )
    unseen: tuple[float, float] = setting((1e-2, 1e-3), "rad, m", "noise that is assumed where too little is seen")
    still: float = setting(
        1e-2, "share", "of the noise of the other axes below which an axis did not move, and says nothing", gt=0
    )
    jump: tuple[float, float] = setting(
        (0.1, 0.015), "rad, m", "least deviation of a pose from its neighbours that no motion explains"
    )
    usual: float = setting(10.0, "standard deviations", "from the neighbours, that are usual", gt=0)
    soft: float = setting(3.0, "standard deviations", "from the neighbours, beyond which a frame counts less", gt=0)
    wild: float = setting(6.0, "standard deviations", "beyond which it does not count at all", gt=0)
    sure: float = setting(
        SURE, "-", "deviation of the logarithm of the errors' size in films: drawn films differ from real ones", ge=0
    )


DEFAULT = NoiseSettings()


@dataclass(frozen=True)
class Noise:
    """White noise of the observed poses.

    Attributes:
        rotation: Standard deviation of each component of a rotation vector [rad].
        position: Standard deviation of each coordinate [m].
        error: Where poses were read from films, the error that this noise stands for; it is not white.
        least: Least noise of rotations [rad] and of positions [m].
    """

    rotation: float
    position: float
    error: TrackingError | None = None
    least: tuple[float, float] = DEFAULT.least

    @property
    def floor(self) -> float:
        """Root mean square position error of a perfect model, sqrt(3) sigma where the noise is white [m]."""
        return 3**0.5 * self.position if self.error is None else self.error.floor

    @property
    def rotation_floor(self) -> float:
        """Root mean square rotation error of a perfect model, sqrt(3) sigma [rad]."""
        return 3**0.5 * self.rotation

    def spread(self) -> Tensor:
        """Return the standard deviations of the six coordinates of a pose, shape (6,)."""
        if self.error is not None:
            return self.error.spread.maximum(torch.tensor(self.least, dtype=torch.float64).repeat_interleave(3))
        return torch.tensor([self.rotation] * 3 + [self.position] * 3, dtype=torch.float64)

    def or_less(self, other: Noise) -> Noise:
        """Return this noise with the smaller deviations of both: each estimate holds motion that it did not remove."""
        return replace(self, rotation=min(self.rotation, other.rotation), position=min(self.position, other.position))

    def draw(self, count: int, like: Tensor, generator: torch.Generator) -> Tensor:
        """Draw the noise of so many data sets, each of the shape of `like` (R, T, N, 6)."""
        if self.error is not None:
            return self.error.draw(count, generator)
        return torch.randn(count, *like.shape, generator=generator, dtype=like.dtype) * self.spread()


UNSEEN = Noise(*DEFAULT.unseen)
"""What is assumed where there is too little to tell."""


def outlier_poses(
    pose: Tensor, present: Tensor, time: Tensor | None = None, settings: NoiseSettings = DEFAULT
) -> Tensor:
    """Find poses that continue neither what comes before nor what comes after: no motion explains them, no impact.

    Each pose is compared with the line between its neighbours k frames before and after, for k = 1, 2, 3: the median of
    the three deviations is small for smooth motions and for the neighbours of an outlier, and large for itself. A
    bounce between two frames of a slow camera, and a fall across lost frames, leave the poses beside them as far; but
    these go on along a line or a parabola from the frames of their own side. At an end there is one side alone. No
    model is needed.

    Args:
        pose: Shape (R, T, N, 7).
        present: Frames that exist, shape (R, T, N).
        time: Times of the frames [s], shape (R, T); None for even ones.
        settings: How far is too far.

    Returns:
        Shape (R, T, N).
    """
    real = present.bool()
    time = torch.arange(pose.shape[1]).to(pose).expand(pose.shape[:2]) if time is None else time
    odd = torch.stack([_from_the_middle(pose, time, k) for k in (1, 2, 3)]).median(0).values
    usual = settings.usual * NORMAL_MAD * odd[real].median(0).values
    limit = torch.maximum(usual, torch.tensor(settings.jump, dtype=pose.dtype))
    wild: Tensor = (odd > limit).any(-1) & real
    for side in (-1, 1):
        for count in (2, 3):
            away, _ = _from_a_side(lambda index: pose_difference(pose[:, index], pose), time, real, side, count)
            wild = wild & (_lengths(away) > limit).any(-1)
    return wild


def _from_the_middle(pose: Tensor, time: Tensor, k: int) -> Tensor:
    """Return how far poses are turned and shifted from the line through their neighbours at k frames [rad, m].

    At an end both neighbours lie on the same side, and the line through them is continued.
    """
    index, last = torch.arange(pose.shape[1]), pose.shape[1] - 1
    low, high = index < k, index > last - k
    near = torch.where(low, index + k, index - k).clamp(0, last)
    far = torch.where(low, index + 2 * k, torch.where(high, index - 2 * k, index + k)).clamp(0, last)
    apart = time[:, far] - time[:, near]
    share = ((time - time[:, near]) / torch.where(apart == 0, 1.0, apart))[..., None, None]
    one, other = pose_difference(pose[:, near], pose), pose_difference(pose[:, far], pose)
    return _lengths(one + share * (other - one))


def _from_a_side(
    relative: Callable[[Tensor], Tensor], time: Tensor, real: Tensor, side: int, count: int
) -> tuple[Tensor, Tensor]:
    """Return how far frames lie from the polynomial through as many frames of one side, by Lagrange's formula.

    Args:
        relative: The values of some frames (T,), less those of the frames themselves, shape (R, T, N, 6).
        time: Times of the frames [s], shape (R, T).
        real: Frames that count, shape (R, T, N).
        side: -1 for the frames before, 1 for those after.
        count: How many of them: 2 for a line, 3 for a parabola.

    Returns:
        Values less the polynomial, shape (R, T, N, 6), infinite where there are not so many frames; and by how much
        this enlarges white noise, shape (R, T, 1, 1).
    """
    index, frames = torch.arange(time.shape[1]), time.shape[1]
    others = [(index + side * j).clamp(0, frames - 1) for j in range(1, count + 1)]
    inside = (index + side * count >= 0) & (index + side * count < frames)
    known = inside[None, :, None] & torch.stack([real[:, other] for other in others]).all(0)
    away, square = torch.zeros(*real.shape, 6, dtype=time.dtype), torch.ones_like(time)
    for one in others:
        weight = torch.ones_like(time)
        for other in others:
            if other is not one:
                apart = time[:, one] - time[:, other]
                weight = weight * (time - time[:, other]) / torch.where(apart == 0, 1.0, apart)
        away = away - weight[..., None, None] * relative(one)
        square = square + weight.square()
    return away.masked_fill(~known[..., None], torch.inf), square.sqrt()[..., None, None]


def _lengths(values: Tensor) -> Tensor:
    """Return the lengths of rotations and of shifts (..., 6), shape (..., 2)."""
    lengths: Tensor = values.unflatten(-1, (2, 3)).norm(dim=-1)
    return lengths


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
    bent = residual[:, 1:-1] - (residual[:, :-2] + residual[:, 2:]) / 2
    good = (weight[:, 1:-1] > 0) & (weight[:, :-2] > 0) & (weight[:, 2:] > 0)
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
        found.append(max(_spread(kind[:, rough >= settings.still * rough.max()].flatten()), floor))
    return Noise(found[0], found[1], least=settings.least)


def _largest(spread: Tensor, least: tuple[float, float]) -> tuple[float, float]:
    """Return the largest standard deviation of a rotation and of a position, of six."""
    return max(float(spread[:3].max()), least[0]), max(float(spread[3:].max()), least[1])


def _spread(values: Tensor) -> float:
    """Estimate a standard deviation from absolute values: by their median, then by those within a few of it."""
    rough = NORMAL_MAD * values.median()
    normal = values[values <= TRIM * rough]
    return float(normal.square().mean().sqrt()) / TRIMMED


def frame_weights(
    residual: Tensor, present: Tensor, time: Tensor, noise: Noise, settings: NoiseSettings = DEFAULT
) -> Tensor:
    """Weigh frames by how far they leave the running median of the residuals (Huber 1964, cut off when outliers).

    An error of the model moves whole stretches, or grows from frame to frame, and keeps its weight; an outlier stands
    alone, continues neither the frames before nor those after, and loses it. Frames that are not present have no say.

    Args:
        residual: Observed minus predicted, shape (R, T, N, 6).
        present: Frames that exist and are not outliers, shape (R, T, N).
        time: Times of the frames [s], shape (R, T).
        noise: Scale of what is normal.
        settings: Beyond which a frame counts less, or not at all.

    Returns:
        Weights from 0 to 1, shape (R, T, N).
    """
    real = present > 0
    away = ((residual - _running_median(residual, real)) / noise.spread()).abs().amax(-1)
    alone = away
    for side in (-1, 1):
        beyond, larger = _from_a_side(lambda index: residual[:, index] - residual, time, real, side, 2)
        alone = alone.minimum((beyond / larger / noise.spread()).abs().amax(-1))
    weight = (settings.soft / away.clamp_min(settings.soft)) * (alone < settings.wild)
    return torch.where(real, weight * present, 0.0)


def _running_median(values: Tensor, real: Tensor) -> Tensor:
    """Return the median of each frame and its neighbours, two on each side, as far as they count.

    Beyond the first and the last frame that count, these go on. Of an even number it is the mean of the middle two:
    `nanmedian` takes the smaller one, so that what is mirrored would have another.

    Args:
        values: Shape (R, T, N, 6).
        real: Frames that count, shape (R, T, N).

    Returns:
        Shape (R, T, N, 6), NaN where no frame around counts.
    """
    frames = values.shape[1]
    reach, index = min(2, (frames - 1) // 2), torch.arange(frames)[None, :, None]
    first = torch.where(real, index, frames - 1).amin(1, keepdim=True)
    last = torch.where(real, index, 0).amax(1, keepdim=True)
    place = torch.arange(-reach, frames + reach)[None, :, None].clamp(first, last)
    known = values.masked_fill(~real[..., None], torch.nan)
    around = known.gather(1, place[..., None].expand(-1, -1, -1, values.shape[-1])).unfold(1, 2 * reach + 1, 1)
    return (around.nanmedian(-1).values - (-around).nanmedian(-1).values) / 2
