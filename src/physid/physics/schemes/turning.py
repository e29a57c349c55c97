"""Friction under `Midpoint` that turns with the slip within a step, of a body that lies on the ground alone."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.physics.contact import Patch
from physid.physics.schemes.impact import FAINT
from physid.physics.schemes.units import STANDARD_GRAVITY

STEADY = 8.0
"""Slip up to which friction turns with it within the step, in units of g h; beyond, it hardly turns [-]."""

TURNED = (0.99, 0.98)
"""Share of the largest impulse of friction from which on down it has turned in the step, and has in full [-]."""

SPINNING = 1.0
"""Slip by a turn about the normal up to which a face slides as a whole, in units of g h; beyond sqrt(2) times that it
does not [-]."""

TURNS = 4
"""Parts of a step in each of which friction opposes one slip."""

NO_IMPACT = 2.0
"""Share of the step that is over when a body is struck that is not [-]."""

TINY = 1e-30
"""Square of a slip that has no direction [m^2/s^2]."""


def slip_after(slip: Tensor, change: Tensor, most: Tensor) -> Tensor:
    """Return the slip after a step, s' = F - C s / |s|, with friction that turns with it.

    The step is cut into `TURNS` parts. In each, friction opposes the slip at the midpoint of the time in which the slip
    falls (after an implicit half step, so along s + F t / 2: a slip that is all but zero turns at once); what
    then is left of the part, where it stops, begins at rest but for what is across it. Along a line all of this is
    exact: a body that stops at the fraction a of a step and is driven on feels the impulse -(2 a - 1) C.

    Args:
        slip: Before, s (B, 2) [m/s].
        change: That forces make of it in the step, F (B, 2) [m/s].
        most: The largest change that friction can make, C (B,) [m/s].
    """
    change, most = change / TURNS, most[:, None] / TURNS
    for _ in range(TURNS):
        heading = _heading(slip)
        speed = (slip * heading).sum(1, keepdim=True)
        slowing = most - (change * heading).sum(1, keepdim=True)
        stops = speed < slowing
        falls = torch.where(stops, speed / torch.where(stops, slowing, 1.0), 1.0)
        slip = slip + falls * (change - most * _heading(slip + falls / 2 * change))
        slip, left = slip + (1 - falls) * change, (1 - falls) * most
        size = (slip * _heading(slip)).sum(1, keepdim=True)
        goes = size > left
        slip = torch.where(goes, slip * (1 - left / torch.where(goes, size, 1.0)), 0.0)
    return slip


def _heading(slip: Tensor) -> Tensor:
    """Return the unit vector along a slip (B, 2), 0 where there is none."""
    square = slip.square().sum(1, keepdim=True)
    some = square > TINY
    return torch.where(some, slip, 0.0) / torch.where(some, square, 1.0).sqrt()


@dataclass(frozen=True)
class Turning:
    """How friction turns within the step.

    Attributes:
        before: Slip before the step [m/s], shape (B, 2).
        end: Slip at its end [m/s], shape (B, 2).
        turns: Weight of what friction loses by turning, shape (B,).
        known: Weight of all of this, shape (B,): 0 where the body is at rest, fast, spins or meets another one.
    """

    before: Tensor
    end: Tensor
    turns: Tensor
    known: Tensor

    @classmethod
    def none(cls, batch: Tensor) -> Turning:
        """Say nothing of worlds of a batch, any tensor (B, ...)."""
        zero = batch.new_zeros(len(batch), 2)
        return cls(zero, zero, zero[:, 0], zero[:, 0])


def turning(patch: Patch, twist: Tensor, free: Tensor, friction: Tensor, step: Tensor, lies: Tensor) -> Turning:
    """Return how friction turns under a face that slides on the ground.

    A contact that sticks to the slip at the end, u+ = s, gets the impulse of friction that has turned with the slip
    within the step. Opposed to the slip at the end, friction is wrong by up to twice its impulse where a body turns
    around, always in the direction of a larger coefficient, and in proportion to the step. The load is that of a body
    on which nothing presses but its weight and the known forces.

    Args:
        patch: Where body and ground touch.
        twist: Before the step, of the centres of mass, shape (B, N, 6).
        free: The same after the step if there were no contact.
        friction: Coefficient, shape (B,).
        step: h [s], shape (B or 1, 1).
        lies: Which contacts would be in the ground, shape (B, 4); all four of a body that lies there and that no other
            one reaches in the step.
    """
    if patch.first is not None or patch.rolling:
        return Turning.none(twist)
    unit = STANDARD_GRAVITY * step[:, 0]
    before, after = (torch.einsum("bki,bi->bk", patch.frame, each[:, patch.second, 3:]) for each in (twist, free))
    slip, change, most = before[:, 1:], (after - before)[:, 1:], friction * (-after[:, 0]).clamp_min(0)
    end, square = slip_after(slip, change, most), slip.square().sum(1)
    rubs = most > FAINT * FAINT * unit
    impulse = (end - slip - change).square().sum(1) / torch.where(rubs, most, 1.0).square()
    turns = ((TURNED[0] ** 2 - impulse) / (TURNED[0] ** 2 - TURNED[1] ** 2)).clamp(0, 1)
    spin = (twist[:, patch.second, :3] * patch.frame[:, 0]).sum(1) * patch.scale
    known = (2 - (spin / (SPINNING * unit)).square()).clamp(0, 1) * (2 - square / (STEADY * unit) ** 2).clamp(0, 1)
    return Turning(slip, end, turns, torch.where(lies.all(1) & rubs & (square > (FAINT * unit) ** 2), known, 0.0))


def friction_before_impact(
    patch: Patch, slip: Tensor, twists: tuple[Tensor, Tensor], friction: Tensor, before: Tensor
) -> Tensor:
    """Return the velocity that friction gives a body before another one strikes it, by each contact, (B, 4, 2) [m/s].

    A quarter of the load rubs in each, against the slip w = s + a F that there would be without friction when the share
    a of the step is over: -b (v + (1 - 2 b / 3) d) / 4 with b = min(a C / |w|, 1), the mean slip v and the deviation
    d = w - v from it. Where friction is small beside the slip, b << 1, that opposes w; with b = 1 it stops the body
    and no more, a spin of which has a third of the inertia there, I = m r^2 / 3. So a body that rests stays at rest
    until it is struck.

    Args:
        patch: Where body and ground touch.
        slip: s of each contact before the step, shape (B, 4, 2) [m/s].
        twists: Before and after the step if there were no contact, of the centres of mass, shape (B, N, 6).
        friction: Coefficient, shape (B,).
        before: a, shape (B,); 0 where nothing strikes.
    """
    start, free = (torch.einsum("bki,bi->bk", patch.frame, each[:, patch.second, 3:]) for each in twists)
    most = before * friction * (-free[:, 0]).clamp_min(0)
    wanted = slip + (before[:, None] * (free - start)[:, 1:])[:, None]
    size = torch.where(before[:, None] > 0, wanted.square().sum(-1), 1.0).clamp_min(TINY).sqrt()
    mean = wanted.mean(1, keepdim=True)
    share = (torch.where(before > 0, most, 0.0)[:, None] / size).clamp_max(1)[..., None]
    return -share * (mean + (1 - 2 * share / 3) * (wanted - mean)) / 4


def turned(usual: Tensor, stuck: Tensor, turns: Turning, hit: Tensor) -> Tensor:
    """Return what is added to the slip after the step, shape (B, 4, 2) [m/s].

    Args:
        usual: What is added where friction does not turn.
        stuck: What is added where a point sticks.
        turns: How friction turns; not where there is an impact.
        hit: Where there is one, shape (B,).
    """
    share = turns.turns[:, None, None]
    slip = share * (stuck - turns.end[:, None]) + (1 - share) * turns.before[:, None]
    return usual + torch.where(hit, 0.0, turns.known)[:, None, None] * (slip - usual)
