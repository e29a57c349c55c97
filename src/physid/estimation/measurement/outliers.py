"""Which observed poses are outliers, and how much the others count."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from physid.estimation.measurement.deviation import NORMAL_MAD
from physid.estimation.measurement.noise_settings import DEFAULT, NoiseSettings
from physid.estimation.measurement.poses import pose_difference
from physid.estimation.measurement.sensor_noise import Noise

NEXT = 5  # frames that an end is judged by: of the ten slopes of their pairs an outlier among them bends four


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

    At an end both neighbours lie on the same side, and the line through them is continued. The other one is that at
    k + 3 frames, so that no frame is a neighbour for two k.
    """
    index, last = torch.arange(pose.shape[1]), pose.shape[1] - 1
    low, high = index < k, index > last - k
    near = torch.where(low, index + k, index - k).clamp(0, last)
    far = torch.where(low, index + k + 3, torch.where(high, index - k - 3, index + k)).clamp(0, last)
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


def frame_weights(
    residual: Tensor, present: Tensor, time: Tensor, noise: Noise, settings: NoiseSettings = DEFAULT
) -> Tensor:
    """Weigh frames by how far they leave the running median of the residuals (Huber 1964, cut off when outliers).

    An error of the model moves whole stretches, or grows from frame to frame, and keeps its weight; an outlier stands
    alone, continues neither the frames before nor those after, and loses it. The first and the last frame stand alone
    where they leave the line of the five beside them. Frames that are not present have no say.

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
    away = ((residual - _running_median(residual, real)) / noise.spread()).abs().amax(-1)  # none at an end
    alone = away.maximum((_from_what_ends_continue(residual, time, real) / noise.spread()).abs().amax(-1))
    for side in (-1, 1):
        beyond, larger = _from_a_side(lambda index: residual[:, index] - residual, time, real, side, 2)
        alone = alone.minimum((beyond / larger / noise.spread()).abs().amax(-1))
    weight = (settings.soft / away.clamp_min(settings.soft)) * (alone < settings.wild)
    return torch.where(real, weight * present, 0.0)


def _running_median(values: Tensor, real: Tensor) -> Tensor:
    """Return the median of each frame and its neighbours, two on each side, as far as they count.

    Beyond the first and the last frame that count, these go on.

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
    return _median(around, -1)


def _from_what_ends_continue(values: Tensor, time: Tensor, real: Tensor) -> Tensor:
    """Return how far the first and the last frame that count leave the line of the five beside them.

    The line has the median slope of all pairs and goes through the median (Theil 1950, Sen 1968): an outlier among the
    five hardly moves it. The distance is divided by what the line of least squares of the five enlarges white noise by.

    Args:
        values: Shape (R, T, N, 6).
        time: Times of the frames [s], shape (R, T).
        real: Frames that count, shape (R, T, N).

    Returns:
        Shape (R, T, N, 6), zero for other frames, and where one of the five does not count.
    """
    found, frames = torch.zeros_like(values), values.shape[1]
    if frames <= NEXT:
        return found
    one, other = torch.triu_indices(NEXT, NEXT, 1)
    index, beside = torch.arange(frames)[None, :, None], torch.arange(NEXT + 1)[None, :, None]
    first = torch.where(real, index, frames - 1).amin(1, keepdim=True) + beside
    last = torch.where(real, index, 0).amax(1, keepdim=True) - beside
    for line in (first, last):
        place = line.clamp(0, frames - 1)
        chosen = place[..., None].expand(-1, -1, -1, values.shape[-1])
        end, value = values.gather(1, chosen).split((1, NEXT), 1)
        since = time[..., None].expand(real.shape).gather(1, place)
        since = (since[:, 1:] - since[:, :1])[..., None]
        slope = _median((value[:, one] - value[:, other]) / (since[:, one] - since[:, other]), 1)
        away = end[:, 0] - _median(value - slope[:, None] * since, 1)
        middle = since.mean(1)
        enlarged = (1 + 1 / NEXT + middle.square() / (since - middle[:, None]).square().sum(1)).sqrt()
        known = ((line == place) & real.gather(1, place)).all(1)
        found.scatter_(1, chosen[:, :1], (away / enlarged).masked_fill(~known[..., None], 0.0)[:, None])
    return found


def _median(values: Tensor, axis: int) -> Tensor:
    """Return the median along an axis, without NaN; of an even number the mean of the middle two.

    `nanmedian` takes the smaller one, so that what is mirrored would have another.
    """
    median: Tensor = (values.nanmedian(axis).values - (-values).nanmedian(axis).values) / 2
    return median
