"""Encoded poses, made better by comparing what the decoder draws with the image: a few Gauss-Newton steps."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor

from physid.networks import GaussianBlur, PlanarChart, PoseChart
from physid.training.vision.drawing.decoder import Decoder

AT_ONCE = 32
"""Images that are worked on at once."""
PIXEL = 0.25
"""Difference of the derivatives [px]: well below the width of an edge, on which an image is a linear function."""
MARGIN = 8.0
"""Pixels around the bodies that are looked at: how far the encoder may be off."""
LONGEST = 12
"""Longest step of a number, in units of its difference: beyond 3 px the image is no linear function any more."""
SETTLED = 1e-3
"""Relative change of an image's squared difference that ends its descent: what a hundredth of a pixel changes."""
TURNED_AWAY = 0.1
"""Share of an image's squared difference from the background above which all headings are tried; half around: 0.05."""
RIVAL = 1.2
"""How many times the present squared difference that of the pose half around may be to be worth a descent."""
DOUBTFUL = 0.05
"""Share of an image's squared difference from the background that a doubtful pose leaves; a right one leaves 0.03."""
DAMPING = 1e-2
"""Levenberg's, relative to the diagonal; ten times larger after a step that has made the images differ more."""


@dataclass(frozen=True)
class PoseRefinement:
    """How encoded poses are refined.

    The raw numbers n of all bodies in an image minimise |blur(decoded(n)) - blur(I)|^2, starting from the encoder's.
    This is inference by the decoder, started by the encoder (Kim et al. 2018 call it semi-amortised): the encoder need
    only be right to half the size of a body, the result is as good as the decoder, a tenth of a pixel.

    A heading that is wrong by more than some 30 degrees is out of reach of such steps. With several `headings`, all of
    them are drawn where the first half of the steps has brought the bodies, unless drawn and given images agree there;
    the best one goes on, and so does the one half around where it looks no worse, since a block and its opposite differ
    least. Where drawn and given images then still differ by much, a body may have chosen its heading beside another's
    wrong one: all are turned by eighths there.

    Attributes:
        steps: Gauss-Newton steps, the first half of them with a wider blur; 0 leaves the poses as they are.
        headings: Headings of each body that are tried, the encoder's and others evenly around; 1 trusts the encoder.
        sigma: Standard deviation of the blur [px].
        wider: Factor of the wider blur, which sees a body from further away.
    """

    steps: int = 0
    headings: int = 1
    sigma: float = 0.7
    wider: float = 4.0

    def __post_init__(self) -> None:
        if self.steps < 0 or self.headings < 1 or self.sigma <= 0:
            raise ValueError(
                f"pose_refinement needs steps >= 0, headings >= 1 and sigma > 0, got {self.steps}, "
                f"{self.headings}, {self.sigma}"
            )

    @torch.no_grad()
    def __call__(self, chart: PoseChart, decoder: Decoder, pose: Tensor, image: Tensor, background: Tensor) -> Tensor:
        """Refine encoded poses.

        Args:
            chart: Which poses there are.
            decoder: Draws them.
            pose: Encoded poses, shape (B, f, N, 7).
            image: What they were read from, shape (B, f, 3, H, W).
            background: The empty scenes, shape (B, 3, H, W).

        Returns:
            Poses, shape (B, f, N, 7).
        """
        if not self.steps:
            return pose
        behind = background[:, None].expand_as(image).flatten(0, 1)
        parts = zip(*(value.split(AT_ONCE) for value in (pose.flatten(0, 1), image.flatten(0, 1), behind)), strict=True)
        done = [self._refine_part(chart, decoder, *part) for part in parts]
        refined: Tensor = torch.cat(done).unflatten(0, pose.shape[:2])
        return refined

    def _refine_part(
        self, chart: PoseChart, decoder: Decoder, pose: Tensor, image: Tensor, background: Tensor
    ) -> Tensor:
        """Refine the poses (M, N, 7) of M images, from several headings each."""
        sigmas = (self.wider * self.sigma, self.sigma)
        wide, fine = (_Mismatch(sigma, decoder, chart, pose, image, background) for sigma in sigmas)
        numbers, _ = self._descend(chart, wide, chart.to_numbers(pose), self.steps // 2)
        rest = self.steps - self.steps // 2
        if self.headings == 1 or not isinstance(chart, PlanarChart):
            return chart.to_pose(self._descend(chart, fine, numbers, rest)[0])
        away = _shares(fine, fine(numbers[:, None])[:, 0]) > TURNED_AWAY
        if away.any():
            some = numbers[away]
            for body in range(chart.bodies):
                some = _best_heading(fine.of(away), some, body, self.headings)
            numbers[away] = some
        numbers, residual = self._descend(chart, fine, numbers, rest)
        numbers, residual = self._turn_over(chart, fine, numbers, residual, (4,), RIVAL)
        doubtful = _shares(fine, residual) > DOUBTFUL
        if doubtful.any():
            given = (value[doubtful] for value in (chart.to_pose(numbers), image, background))
            again, found = _Mismatch(self.sigma, decoder, chart, *given), numbers[doubtful]
            residual = again(found[:, None])[:, 0]
            for _ in range(chart.bodies):
                found, residual = self._turn_over(chart, again, found, residual, tuple(range(1, 8)))
            numbers[doubtful], _ = self._descend(chart, again, found, self.steps)
        return chart.to_pose(numbers)

    def _turn_over(
        self,
        chart: PoseChart,
        mismatch: _Mismatch,
        numbers: Tensor,
        residual: Tensor,
        eighths: Sequence[int],
        rival: float = math.inf,
    ) -> tuple[Tensor, Tensor]:
        """Descend once more with each body turned by eighths of a turn, and keep what differs least."""
        numbers, residual = numbers.clone(), residual.clone()
        for body in range(chart.bodies):
            for eighth in eighths:
                turned = _turned(numbers, body, eighth * math.pi / 4)
                near = _power(mismatch(turned[:, None])[:, 0]) < rival * _power(residual)
                if not near.any():
                    continue
                other, difference = self._descend(chart, mismatch.of(near), turned[near], self.steps - self.steps // 2)
                better = _power(difference) < _power(residual[near])
                chosen = near.nonzero()[better, 0]
                numbers[chosen], residual[chosen] = other[better], difference[better]
        return numbers, residual

    def _descend(self, chart: PoseChart, mismatch: _Mismatch, numbers: Tensor, steps: int) -> tuple[Tensor, Tensor]:
        """Take some steps from numbers (M, N, K), fewer where it settles; return the last and the residuals (M, P)."""
        numbers, residual = numbers.clone(), mismatch(numbers[:, None])[:, 0]
        damping = torch.full((len(numbers), 1), DAMPING, device=numbers.device)
        moving = torch.arange(len(numbers), device=numbers.device)
        for _ in range(steps):
            part, here, before = mismatch.of(moving), numbers[moving], residual[moving]
            moved = _normal(chart, here + part.step(part.slope(here), before, damping[moving]))
            tried = part(moved[:, None])[:, 0]
            change = _power(tried) / _power(before) - 1
            better = change < 0
            numbers[moving] = torch.where(better[:, None, None], moved, here)
            residual[moving] = torch.where(better[:, None], tried, before)
            damping[moving] *= torch.where(better, 0.1, 10.0)[:, None]
            moving = moving[~(change.abs() < SETTLED)]
            if not len(moving):
                break
        return numbers, residual


def _power(residual: Tensor) -> Tensor:
    """Add up the squares of residuals (M, P); shape (M,)."""
    return residual.square().sum(-1)


def _shares(mismatch: _Mismatch, residual: Tensor) -> Tensor:
    """Return the squared residuals (M, P) as shares of how images differ from their backgrounds; shape (M,)."""
    return _power(residual) / mismatch.content


def _best_heading(mismatch: _Mismatch, numbers: Tensor, body: int, headings: int) -> Tensor:
    """Turn one body of numbers (M, N, K) to that of several headings at which drawn and given images differ least."""
    turned = [_turned(numbers, body, 2 * math.pi * turn / headings) for turn in range(headings)]
    tried = torch.stack(turned, 1)
    best = mismatch(tried).square().sum(-1).argmin(1)
    return tried[torch.arange(len(numbers), device=numbers.device), best]


def _turned(numbers: Tensor, body: int, angle: float) -> Tensor:
    """Turn one body of numbers (M, N, K) of a planar chart by an angle of its raw numbers."""
    turned = numbers.clone()
    cosine, sine = numbers[:, body, 2], numbers[:, body, 3]
    turned[:, body, 2] = math.cos(angle) * cosine - math.sin(angle) * sine
    turned[:, body, 3] = math.sin(angle) * cosine + math.cos(angle) * sine
    return turned


def _normal(chart: PoseChart, numbers: Tensor) -> Tensor:
    """Return numbers of the same poses as the chart itself would give them."""
    return chart.to_numbers(chart.to_pose(numbers))


@final
class _Mismatch:
    """Differences between drawn and given images, in a window around the bodies.

    Args:
        sigma: Standard deviation of the blur [px].
        decoder: Draws images.
        chart: What the numbers mean.
        pose: About where the bodies are, shape (M, N, 7).
        image: Given images, shape (M, 3, H, W).
        background: The empty scenes, shape (M, 3, H, W).
    """

    def __init__(
        self, sigma: float, decoder: Decoder, chart: PoseChart, pose: Tensor, image: Tensor, background: Tensor
    ) -> None:
        self.decoder, self.chart = decoder, chart
        rows, columns = _window(decoder, pose)
        self.corner = torch.stack([columns[:, 0], rows[:, 0]], -1)
        self.background = _cut(background, rows, columns)
        self.blur = GaussianBlur(2 * math.ceil(3 * sigma) + 1, sigma)
        self.seen = self._look(_cut(image, rows, columns)[:, None])
        self.content = (self.seen - self._look(self.background[:, None])).square().sum((-2, -1))
        self.difference = _differences(decoder, chart).to(image)

    def of(self, images: Tensor) -> _Mismatch:
        """Return the differences for some of the images, by index or mask."""
        part = copy.copy(self)
        part.background, part.seen, part.content = self.background[images], self.seen[images], self.content[images]
        part.corner = self.corner[images]
        return part

    def __call__(self, numbers: Tensor) -> Tensor:
        """Return residuals (M, c, P) of c candidates (M, c, N, K) for each image."""
        drawn = self.decoder(self.chart.to_pose(numbers), self.background, corner=self.corner)
        return self._look(drawn) - self.seen

    def _look(self, window: Tensor) -> Tensor:
        """Blur windows (M, c, 3, h, w); (M, c, P)."""
        blurred: Tensor = self.blur(window)
        return blurred.flatten(2)

    def slope(self, numbers: Tensor) -> Tensor:
        """Differentiate the residuals by the numbers: (M, N K, P)."""
        bodies, count = numbers.shape[1:]
        moves = torch.diag_embed(self.difference.repeat(bodies)).view(bodies * count, bodies, count)
        both = self(numbers[:, None] + torch.cat([moves, -moves]))
        plus, minus = both.chunk(2, 1)
        slope: Tensor = (plus - minus) / (2 * self.difference.repeat(bodies)[:, None])
        return slope

    def step(self, slope: Tensor, residual: Tensor, damping: Tensor) -> Tensor:
        """Solve (J^T J + damping diag) x = -J^T r for each image, and hold each number's step to 3 px; (M, N, K)."""
        square: Tensor = slope @ slope.transpose(-1, -2)
        diagonal = square.diagonal(dim1=-2, dim2=-1)
        floor = 1e-6 * diagonal.amax(-1, keepdim=True) + torch.finfo(slope.dtype).tiny
        damped = square + torch.diag_embed(damping * diagonal + floor)
        solved: Tensor = torch.linalg.solve(damped, -(slope @ residual[..., None])[..., 0])
        step: Tensor = torch.unflatten(solved, -1, (-1, self.chart.numbers))
        longest = LONGEST * self.difference
        return torch.maximum(torch.minimum(step, longest), -longest)


def _differences(decoder: Decoder, chart: PoseChart) -> Tensor:
    """Choose by how much each number is changed for its derivative, (K,): a quarter of a pixel where it can."""
    camera, size = decoder.renderer.camera, decoder.renderer.size
    radius = _pixels(decoder, float(size[:, :2].mean()) / 2)
    change = torch.full((chart.numbers,), 2 * PIXEL / min(camera.height, camera.width))
    change[chart.turning] = PIXEL / radius
    if isinstance(chart, PlanarChart) and chart.hovering:
        # Height changes little but the size of the image.
        change[4] = 0.1 * float(size.mean())
    return change


def _window(decoder: Decoder, pose: Tensor) -> tuple[Tensor, Tensor]:
    """Find windows of one size that hold all bodies of each image: rows (M, h) and columns (M, w)."""
    camera, size = decoder.renderer.camera, decoder.renderer.size
    reach = _pixels(decoder, float(size.norm(dim=-1).max())) / 2 + MARGIN
    centre = camera.project(pose[..., :3])
    low, high = (centre.amin(1) - reach).floor(), (centre.amax(1) + reach).ceil()
    lines = []
    for axis, length in ((1, camera.height), (0, camera.width)):
        extent = min(int((high - low)[:, axis].max()), length)
        start = low[:, axis].clamp(0, length - extent).long()
        lines.append(start[:, None] + torch.arange(extent, device=pose.device))
    return lines[0], lines[1]


def _cut(image: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    """Cut windows, rows (M, h) and columns (M, w), out of images (M, 3, H, W); (M, 3, h, w)."""
    each = torch.arange(len(image), device=image.device)[:, None, None]
    return image.movedim(1, -1)[each, rows[:, :, None], columns[:, None, :]].movedim(-1, 1)


def _pixels(decoder: Decoder, length: float) -> float:
    """Return how many pixels a length [m] spans in the middle of the view."""
    camera = decoder.renderer.camera
    return length * camera.focal_length / math.dist(camera.position, camera.target)
