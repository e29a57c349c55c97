"""Contacts as values: where bodies touch, and which velocity a touch allows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor

PATCH = 4
"""Contacts in a patch: the four corners by which a face stands on a plane or on another face."""

SEVERAL = 1.5
"""A step that is so many times as long as one of a simulator stands for several of them: it is nearer to two [-]."""

WARP_COMPLIANCE = 0.1
FLATNESS = 1e-3


@dataclass(frozen=True)
class Patch:
    """Four possible contacts between body `second` and body `first` (None: the ground).

    Attributes:
        first: Index of the body that the normal leaves, or None for the ground.
        second: Index of the body that the normal points to.
        point: Contact points, world frame [m], shape (B, 4, 3).
        gap: Distances along the normal, negative where the bodies overlap [m], shape (B, 4).
        frame: Rows normal, tangent, tangent (world frame), shape (B, 3, 3).
        active: Which of the four exist, shape (B, 4).
        scale: A length of the touching face [m], shape (B,).
        together: Weight of an impact of all four at once, shape (B,); None for none.
        rolling: Whether the points move over the bodies as these turn, as on a sphere, and not with them, as a corner.
    """

    first: int | None
    second: int
    point: Tensor
    gap: Tensor
    frame: Tensor
    active: Tensor
    scale: Tensor
    together: Tensor | None = None
    rolling: bool = False

    def flatness(self) -> Tensor:
        """Weigh whether the four contacts lie flat, exp(-(spread / (FLATNESS scale))^2) of their gaps; shape (B,).

        Those that an impact stops together bear each other's load as if they did.
        """
        spread = (self.gap - self.gap.mean(1, keepdim=True)).square().mean(1) / (FLATNESS * self.scale) ** 2
        flat = torch.where(self.active.all(1), torch.exp(-spread), torch.zeros_like(spread))
        return flat if self.together is None else torch.maximum(flat, self.together)

    def warp(self) -> Tensor:
        """Compute how the four normal impulses would twist the face out of its plane, shape (B, 4).

        A rigid face on four coplanar contacts leaves one combination of their impulses undetermined: n with sum n_i
        = 0 and sum n_i x_i = 0, the signed areas of the triangles left by each point. Where friction acts the motion
        may depend on it, and then the problem has several solutions. The load is therefore shared as by a face that can
        warp along n with a small compliance, if it lies flat.
        """
        flat = torch.einsum("bki,bji->bkj", self.point - self.point.mean(1, keepdim=True), self.frame[:, 1:])
        x, y = (flat / self.scale[:, None, None]).unbind(-1)

        def area(i: int, j: int, k: int) -> Tensor:
            return (x[:, j] - x[:, i]) * (y[:, k] - y[:, i]) - (x[:, k] - x[:, i]) * (y[:, j] - y[:, i])

        areas = torch.stack([area(1, 2, 3), -area(0, 2, 3), area(0, 1, 3), -area(0, 1, 2)], -1)
        return areas * (self.flatness() / (areas.square().sum(1) + 1e-12).sqrt())[:, None]

    def lever(self, up: Tensor, exists: Tensor) -> Tensor:
        """Compute how the contacts between two bodies would tip them, heights above their mean, scaled to length 1.

        Two bodies that both stand flat on the ground cannot tip, so that their contacts leave it undetermined at which
        height they press on each other: another redundant combination, treated as `warp` is.

        Args:
            up: Unit normal of the ground, shape (3,).
            exists: Which contacts exist, shape (B, 4).

        Returns:
            Shape (B, 4).
        """
        height = torch.where(exists, self.point @ up, 0.0)
        mean = height.sum(1, keepdim=True) / exists.sum(1, keepdim=True).clamp_min(1)
        deviation = torch.where(exists, height - mean, 0.0) / self.scale[:, None]
        return deviation / (deviation.square().sum(1, keepdim=True) + 1e-6).sqrt()


class ContactRule(ABC):
    """Which normal velocity a contact demands, u_n >= -c.

    Attributes:
        correction: Fraction of an overlap removed per step.
        slop: Overlap that is left alone [m].
    """

    correction: float
    slop: float = 0.0

    @abstractmethod
    def offset(self, gap: Tensor, speed: Tensor, free_speed: Tensor, restitution: Tensor, step: Tensor) -> Tensor:
        """Compute c [m/s] of contacts, shape as `gap`.

        Args:
            gap: Distances, negative in overlap [m].
            speed: Normal velocities before the step [m/s].
            free_speed: Normal velocities after the step if there were no contact [m/s].
            restitution: Newton's coefficient k.
            step: h [s], to be broadcast.
        """

    def spring(self, gap: Tensor, speed: Tensor, restitution: Tensor, pace: Tensor) -> Tensor:
        """Compute c [m/s] of overlaps that yield, pace (gap + slop) + k min(u_n, 0), as Bullet's do.

        With the share pace * h of a compliance C in its row the contact is a spring of stiffness 1 / C, however deep,
        with a damper of (1 / pace - h) / C: nothing bounds its speed, and nothing but it takes the overlap back. A body
        rests deeper by C f than on a rigid ground.

        Args:
            gap: Distances, negative in overlap [m].
            speed: Normal velocities before the step [m/s].
            restitution: Newton's coefficient k.
            pace: 1 / (h / correction + t) with t of the damper [1/s], see `schemes.impact.damping_time`.
        """
        return pace * (gap + self.slop) + restitution * speed.clamp_max(0)

    def exists(self, gap: Tensor, reach: Tensor) -> Tensor:
        """Return which contacts enter the problem at all; `reach` [m] bounds the distance worth looking at."""
        return gap < reach

    def displacement(self, gap: Tensor) -> Tensor | None:
        """Compute how far [m] a step at least parts the bodies without giving them a velocity; None for no such rule.

        Negative where they may come closer: the contact problem, not a clamp, then decides, and stays smooth.
        """
        return None


@final
@dataclass(frozen=True)
class Speculative(ContactRule):
    """A body stops where it touches: c = gap / h when apart, correction * gap / h in overlap, k u_n at an impact.

    Attributes:
        correction: Fraction of an overlap removed per step.
        speed_limit: Fastest removal [m/s].
    """

    correction: float = 0.2
    speed_limit: float = 1.0

    def offset(self, gap: Tensor, speed: Tensor, free_speed: Tensor, restitution: Tensor, step: Tensor) -> Tensor:
        """Compute c (see `ContactRule.offset`)."""
        overlap = (self.correction * gap / step).clamp_min(-self.speed_limit)
        still = torch.where(gap > 0, gap / step, overlap)
        impact = (gap + step * free_speed < 0) & (speed < 0) & (restitution > 0)
        return torch.where(impact, torch.minimum(still, restitution * speed), still)


@final
@dataclass(frozen=True)
class Penetrating(ContactRule):
    """Bullet's rule for boxes: contact begins in overlap, which is then removed slowly; k u_n at an impact.

    Attributes:
        correction: Fraction of an overlap removed per step (measured on Bullet: 0.08).
        speed_limit: Fastest removal [m/s].
    """

    correction: float = 0.08
    speed_limit: float = 1.0

    def offset(self, gap: Tensor, speed: Tensor, free_speed: Tensor, restitution: Tensor, step: Tensor) -> Tensor:
        """Compute c (see `ContactRule.offset`)."""
        still = (self.correction * gap / step).clamp_min(-self.speed_limit)
        impact = (speed < 0) & (restitution > 0)
        return torch.where(impact, torch.minimum(still, restitution * speed), still)

    def exists(self, gap: Tensor, reach: Tensor) -> Tensor:
        """Only bodies that overlap touch."""
        return gap < 0


@final
@dataclass(frozen=True)
class Split(ContactRule):
    """Bullet's split impulse: contact begins in overlap; velocities and overlaps are corrected apart.

    The velocity obeys u_n >= 0 (or k u_n at an impact), so that an overlap adds no momentum and no friction. The poses
    are then moved out of the overlap by the smallest displacement, as measured on PyBullet with `splitImpulse`.

    Attributes:
        correction: Fraction of an overlap removed per step.
        slop: Overlap that is left alone [m].
    """

    correction: float = 0.2
    slop: float = 1e-5

    def offset(self, gap: Tensor, speed: Tensor, free_speed: Tensor, restitution: Tensor, step: Tensor) -> Tensor:
        """Compute c (see `ContactRule.offset`)."""
        impact = (speed < 0) & (restitution > 0)
        return torch.where(impact, restitution * speed, torch.zeros_like(speed))

    def exists(self, gap: Tensor, reach: Tensor) -> Tensor:
        """Only bodies that overlap touch."""
        return gap < 0

    def displacement(self, gap: Tensor) -> Tensor:
        """Remove a fraction of what exceeds the slop (see `ContactRule.displacement`); below it, ask for nothing."""
        return self.correction * (-gap - self.slop)
