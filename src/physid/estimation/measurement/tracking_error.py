"""The error of poses that were read from films, as far as reading them a second time shows it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from physid.estimation.measurement.deviation import bends
from physid.estimation.measurement.poses import pose_difference

SPANS = (1, 2, 4, 8, 16, 32)  # frames over which errors are averaged, to see how slowly they change
SURE = 0.15  # standard deviation of the logarithm of the errors' size: drawn films differ from real ones
UNREAD = 1e-6  # share of the variance of the worst direction below which a direction was not read at all
KINDS = (slice(0, 3), slice(3, 6))  # rotation, position


@dataclass(frozen=True)
class TrackingError:
    """What drawing and reading read poses once more does to them, along the recorded motion.

    Such an error depends on where edges fall between pixels: it is alike in neighbouring frames, the more so the slower
    a body moves, and some directions (the depth) are seen worse than others. How large it is follows from the
    recordings themselves (see `sized`): films that are drawn are easier to read than real ones.

    Attributes:
        track: Poses read again relative to those read first, as rotation vectors and positions, shape (R, T, N, 6).
        stretch: Change of the poses per share by which all places move away from the middle of the view; same shape.
        deviation: How well that share is known, one standard deviation.
        factors: By how much the errors of rotations and of positions are larger than those of `track`.
        sure: How well that is known, one standard deviation of its logarithm.
    """

    track: Tensor
    stretch: Tensor
    deviation: float
    factors: tuple[float, float] = (1.0, 1.0)
    sure: float = SURE

    @classmethod
    def between(cls, read: Tensor, again: Tensor, stretch: Tensor, deviation: float = 1.0) -> TrackingError:
        """Compare poses (R, T, N, 7) with what was read of them; `stretch` (R, T, N, 6) as above."""
        return cls(pose_difference(again, read), stretch, deviation)

    def sized(self, residual: Tensor, weight: Tensor) -> TrackingError:
        """Return it with factors at which r_t - (r_{t-1} + r_{t+1}) / 2 is as large as in residuals (R, T, N, 6).

        Args:
            residual: Observed minus predicted.
            weight: Weights of the frames, 0 for those to ignore, shape (R, T, N).
        """
        found, own = (_roughness(each, weight) for each in (residual, self.track))
        first, second = (max(1.0, a / max(b, 1e-12)) for a, b in zip(found, own, strict=True))
        return replace(self, factors=(first, second))

    @cached_property
    def spread(self) -> Tensor:
        """Standard deviations of white noise that disturbs slow changes as much: rotation vector, position; shape (6,).

        The largest over spans of n var(mean of n frames), whose square root this is; a constant of each trajectory is
        no error, since its initial state takes it up. Directions that a reader cannot err in, say off the ground, count
        as those that it can: nothing was seen there.
        """
        return torch.stack([self._spread(span) for span in SPANS if span <= self.track.shape[1] // 2]).amax(0)

    @cached_property
    def floor(self) -> float:
        """Root mean square error of a position [m], without what a first place and velocity take up."""
        left = without_line(self.track[..., KINDS[1]], torch.ones_like(self.track[..., 0, 0]))
        return self.factors[1] * float(left.square().sum(-1).mean().sqrt())

    @property
    def common(self) -> Tensor:
        """What one standard deviation of the scale, which all poses share, does to them, shape (R, T, N, 6)."""
        return self.deviation * self.stretch

    def left_by_fit(self, weight: Tensor) -> tuple[Tensor, Tensor]:
        """Return the mean square that errors leave of a perfect model, and how well that is known.

        Args:
            weight: 1 for frames that count, 0 for others, shape (R, T).

        Returns:
            For rotations [rad^2] and positions [m^2]: the mean square without what initial poses and velocities take
            up, and the standard deviation of its logarithm, by the spread over trajectories and of the errors' size.
        """
        count = weight.sum(1, keepdim=True).clamp_min(1)
        own, scale = (
            torch.stack([(part[..., kind].square().sum(-1).mean(-1) * weight).sum(1) for kind in KINDS], -1) / count
            for part in (without_line(value, weight) for value in (self._scaled, self.common))
        )
        mean = own.mean(0)
        # What a fit leaves, and what reading again has left, are both means over few trajectories.
        few = 2 * own.var(0, correction=min(1, len(own) - 1)) / len(own)
        among = few / mean.square().clamp_min(torch.finfo(mean.dtype).tiny)
        return mean + scale.mean(0), (among + (2 * self.sure) ** 2).sqrt()

    def draw(self, count: int, like: Tensor, generator: torch.Generator) -> Tensor:
        """Draw errors of so many data sets, each of the shape of `like` (R, T, N, 6), which is that of the track.

        Each trajectory has the error of a random one, forwards or backwards and with a random sign; errors are larger
        or smaller in all alike, for their size is not known exactly, and the scale is off in all alike.
        """
        rows = len(self.track)

        def random_sign() -> Tensor:
            return 2.0 * torch.randint(2, (count, rows, 1, 1, 1), generator=generator) - 1

        chosen = self._scaled[torch.randint(rows, (count, rows), generator=generator)]
        turned = torch.where(random_sign() > 0, chosen, chosen.flip(2))
        shape, kind = (count, 1, 1, 1, 1), self.track.dtype
        size = torch.exp(self.sure * torch.randn(shape, generator=generator, dtype=kind))
        share = self.deviation * torch.randn(shape, generator=generator, dtype=kind)
        return random_sign() * size * turned + share * self.stretch

    @property
    def _scaled(self) -> Tensor:
        factors = self.track.new_tensor([self.factors[0]] * 3 + [self.factors[1]] * 3)
        return factors * self.track

    @property
    def _varying(self) -> Tensor:
        return self.track - self.track.mean(1, keepdim=True)

    def _spread(self, span: int) -> Tensor:
        """Return the root of n var(mean of n frames) of each coordinate, at least that of the second best direction."""
        found = []
        for kind, factor in zip(KINDS, self.factors, strict=True):
            means = self._varying[..., kind].unfold(1, span, span).mean(-1).flatten(0, 2)
            power = span * means.T @ means / len(means)
            _, second, first = torch.linalg.eigvalsh(power)
            least = second if float(second) > UNREAD * float(first) else first
            found.append(factor * power.diagonal().maximum(least).clamp_min(0).sqrt())
        return torch.cat(found)


def without_line(value: Tensor, weight: Tensor) -> Tensor:
    """Take out of each trajectory what a first pose and velocity take up: a line over the frames, by least squares.

    Args:
        value: Of N bodies, shape (R, T, N, 3 or 6).
        weight: 1 for frames that count, 0 for others, shape (R, T).
    """
    weight = weight[..., None, None] / weight.sum(1).clamp_min(1)[:, None, None, None]
    value = value - (weight * value).sum(1, keepdim=True)
    time = torch.linspace(-1, 1, value.shape[1], dtype=value.dtype)[:, None, None]
    time = time - (weight * time).sum(1, keepdim=True)
    square = (weight * time.square()).sum(1, keepdim=True).clamp_min(torch.finfo(value.dtype).tiny)
    line: Tensor = value - time * (weight * time * value).sum(1, keepdim=True) / square
    return line


def _roughness(value: Tensor, weight: Tensor) -> tuple[float, float]:
    """Return the median length of what leaves the middle of its neighbours, of rotations and of positions."""
    bent, good = bends(value, weight)
    first, second = (float(bent[good][:, kind].norm(dim=-1).median()) for kind in KINDS)
    return first, second
