"""Contact under `Midpoint`: bodies that rest or slide on each other, and impacts where in the step they fall.

At the midpoint of a step a contact has the gap y, and the velocities u before the step and f after it if there were no
contact, so that it begins with the gap x = y - h u / 2 and would end with y + h f / 2.

* Without an impact the velocity after obeys u+ >= -y / h. The gap at the midpoint then follows y+ = y + h u+ as in a
  semi-implicit step: it closes once and stays closed, while the mean velocity makes sliding and rest exact.
* A contact that is reached within the step and fast enough is an impact at the fraction a of the step at which its gap
  closes, with the velocity u_c there. It leaves with -e u_c, to which the rest of the step adds (1 - a)(f - u). If this
  is no longer positive it stays: gap and velocity end at zero.
* The impulse of an impact acts from its time on, so that it moves the bodies by the share W of h times the velocity
  that it gives them, and not by half of it: W = 1 - a of one that leaves, and W = (end gap) / (h f) of one that stays.
  The four contacts of a patch share a smooth maximum of W, with which none of them ends in overlap to speak of.
* A point of a body that turns moves on a curve: with the acceleration b of that (of which w x (w x r) is known), all of
  this holds of y - h^2 b / 8, u - h b / 2 and f + h b / 2, those at the ends of the step; sticking too ends at rest.
* Friction opposes the mean slip where it is fast, and the slip at the end where it may stop. Under a body that lies on
  the ground alone friction turns with the slip within the step (`slip_after`).
* A compliant contact takes an impact where it is reached; in overlap it is a spring, and never hit.
* Contacts of a face that all are reached in the step stop together, and share the load as those that lie flat do.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.physics.contact import FLATNESS, Patch

STANDARD_GRAVITY = 9.81
FINE = 1e-3
"""Steps shorter than this do not make the unit of velocities smaller: an impact would become too large a number [s]."""

SLOWEST = 0.25
"""An approach slower than this, in units of g h, is that of bodies at rest, and no impact [-]."""

SLIDING = 2.0
"""Slip from which on it may count as sliding through the step, in units of g h; at sqrt(2) times that it does [-]."""

FAINT = 1e-3
"""A bounce slower than this, in units of g h, is none: at e = 0 its sign is that of rounding [-]."""

STEADY = 8.0
"""Slip up to which friction turns with it within the step, in units of g h; beyond, it hardly turns [-]."""

TURNED = (0.99, 0.98)
"""Share of the largest impulse of friction from which on down it has turned in the step, and has in full [-]."""

SPINNING = 1.0
"""Slip by a turn about the normal up to which a face slides as a whole, in units of g h; beyond sqrt(2) times that it
does not [-]."""

TURNS = 4
"""Parts of a step in each of which friction opposes one slip."""

TINY = 1e-30
"""Square of a slip that has no direction [m^2/s^2]."""

LARGEST = 2.0
"""Bound on W [-], which exceeds 1 where something pulls a body away while it lands."""

PUSH = 0.5
"""Overlaps open at most this fast, in units of g h [-]: a body so pushed rises by less than g h^2 / 8."""

LOADS = 20.0
"""Overlap up to so many times that which the mean weight causes in a compliant contact is the contact's own [-]."""


SHARPNESS = 32
"""Exponent p of the smooth maximum of shares, sum w^(p + 1) / sum w^p [-]: a mean where they are equal, as in a face
that lands flat, so that no corner of four is preferred by rounding."""


def velocity_unit(step: float, *, midpoint: bool) -> float:
    """Return the unit of velocities in the contact problem, g h [m/s], for a step h [s]; see also `FINE`."""
    return STANDARD_GRAVITY * (max(step, FINE) if midpoint else step)


@dataclass(frozen=True)
class Impact:
    """What the contacts of a patch demand.

    Attributes:
        offset: c of u+ >= -c [m/s], shape (B, 4).
        slip: What is added to the tangential velocity that friction opposes [m/s], shape (B, 4, 2).
        share: W, which share of the step the impulses of the patch act [-]; 1/2 without an impact; shape (B,).
        together: Whether an impact stops all four, a weight from 0 to 1, shape (B,).
    """

    offset: Tensor
    slip: Tensor
    share: Tensor
    together: Tensor


def bending(patch: Patch, centres: Tensor, twist: Tensor) -> Tensor:
    """Return the acceleration w x (w x r) of the points of a body on the ground, in the patch's frame, shape (B, 4, 3).

    Between two bodies, of which the normal turns too, it is left out, and a point that a body rolls over has none: it
    stays where it is below the centre.

    Args:
        patch: Where they touch.
        centres: Centres of mass [m], shape (B, N, 3).
        twist: Of the centres of mass, shape (B, N, 6).
    """
    if patch.first is not None or patch.rolling:
        return torch.zeros_like(patch.point)
    spin = twist[:, None, patch.second, :3].expand_as(patch.point)
    arm = patch.point - centres[:, None, patch.second]
    bend: Tensor = torch.linalg.cross(spin, torch.linalg.cross(spin, arm))
    return bend @ patch.frame.mT


def slip_after(slip: Tensor, change: Tensor, most: Tensor) -> Tensor:
    """Return the slip after a step, s' = F - C s / |s|, with friction that turns with it.

    The step is cut into `TURNS` parts. In each, friction opposes the slip at the midpoint of the time in which the slip
    falls (by an implicit step, s + F t / 2 = (1 + ...) s / |s|, for a slip that is all but zero turns at once); what
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
        known: Weight of all of this, shape (B,): 0 where the body is at rest, fast, spins or may touch another one.
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
        lies: Which contacts would be in the ground, shape (B, 4); all four of a body that lies there.
    """
    if patch.first is not None or patch.rolling or twist.shape[1] > 1:
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


def demand(
    patch: Patch,
    velocities: tuple[Tensor, Tensor],
    bend: Tensor,
    material: tuple[Tensor, Tensor],
    step: Tensor,
    exists: Tensor,
    turns: Turning,
) -> Impact:
    """Return what the contacts of a patch demand (see the module).

    Args:
        patch: Where they touch; its gap is y.
        velocities: In the patch's frame that before the step, shape (B, 4, 3), and f, shape (B, 4) [m/s].
        bend: See `bending` [m/s^2].
        material: e, and the static deflection under the mean weight [m], shapes (B,).
        step: h [s], shape (B or 1, 1).
        exists: Which contacts there are, shape (B, 4).
        turns: How friction turns within the step.
    """
    restitution, give = material[0][:, None], material[1][:, None]
    gap = patch.gap - step**2 * bend[..., 0] / 8
    u, f = velocities[0][..., 0] - step * bend[..., 0] / 2, velocities[1] + step * bend[..., 0] / 2
    change = f - u
    begin = gap - step * u / 2
    apart = begin > 0
    start = torch.where(apart, begin, 0.0)
    end = start + step * (u + f) / 2
    reached = exists & (gap + step * f / 2 < 0)
    falling = reached & apart
    square = torch.where(falling, u**2 - 2 * start * change / step, 1.0)
    touch = torch.where(falling, -square.clamp_min(1e-300).sqrt(), u.clamp_max(0))
    rigid = apart | (give <= 0)
    impact = reached & rigid & (touch < -SLOWEST * STANDARD_GRAVITY * step)
    late = torch.where(impact & apart, 2 * start / (step * torch.where(impact & apart, -touch - u, 1.0)), 0.0)
    leaving = (1 - late) * change - restitution * touch
    leaves = impact & (leaving > FAINT * STANDARD_GRAVITY * step)
    stays = reached & (f < 0) & ~leaves
    share = torch.where(stays, (end / (step * torch.where(stays, f, 1.0))).clamp(0, LARGEST), 1 - late)
    share = torch.where(reached, share, 0.0)
    top = share.detach().amax(1, keepdim=True).clamp_min(1e-30)
    weight = (share / top) ** SHARPNESS
    largest = (weight * share).sum(1, keepdim=True) / weight.sum(1, keepdim=True).clamp_min(1e-30)
    hit = impact.any(1, keepdim=True)
    free_end = (gap + step * f / 2).amax(1) / (FLATNESS * patch.scale)
    together = torch.where(hit[:, 0] & reached.all(1), 1 - torch.exp(-free_end.square()), 0.0)
    still = f - end / (step * torch.where(hit & (largest > 0), largest, 1.0))
    still = torch.where(reached, still, still.clamp_max(0))
    still = torch.where(leaves, torch.maximum(still, leaving), still)
    slow = torch.where(
        gap > 0,
        torch.where(reached, 1.0, 2.0) * gap / step,
        torch.maximum(gap / step, -PUSH * STANDARD_GRAVITY * step - LOADS * give / step),
    )
    offset = torch.where(hit, -still, slow) + step * bend[..., 0] / 2
    slip = _slip(velocities[0], bend, hit, step, turns)
    return Impact(offset, slip, torch.where(hit, largest, 0.5)[:, 0], together)


def late(mass: Tensor, jacobian: Tensor, impulse: Tensor, share: Tensor, bodies: int) -> Tensor:
    """Return how far impacts move bodies beyond the mean velocity, (W - 1/2) M^-1 J^T lambda in units of g h^2.

    Where impulses balance, as on a body between two others, those of different W must not part it from them: it moves
    at most by the largest |W - 1/2| that there is times the change of its velocity, in the metric of its inertia.

    Args:
        mass: M, shape (B, n, n).
        jacobian: J, shape (B, C, 3, n).
        impulse: lambda, shape (B, C, 3).
        share: W of every contact, shape (B, C).
        bodies: N, whose 6 N velocities come first.

    Returns:
        Shape (B, N, 6).
    """
    n = 6 * bodies
    forces = [torch.einsum("bckn,bck->bn", jacobian[..., :n], w * impulse) for w in ((share - 0.5)[..., None], 1.0)]
    motions = torch.linalg.solve(mass[:, :n, :n], torch.stack(forces, -1)).unbind(-1)
    moved, change = ((f * v).unflatten(1, (bodies, 6)).sum(-1) for f, v in zip(forces, motions, strict=True))
    far = moved > (LARGEST - 0.5) ** 2 * change
    shorter = (LARGEST - 0.5) * (torch.where(far, change, 1.0) / torch.where(far, moved, 1.0)).clamp_min(0).sqrt()
    motion: Tensor = motions[0].unflatten(1, (bodies, 6)) * torch.where(far, shorter, 1.0)[..., None]
    return motion


def _slip(velocity: Tensor, bend: Tensor, hit: Tensor, step: Tensor, turns: Turning) -> Tensor:
    """Return what is added to the slip after the step: that before where friction opposes the mean.

    Elsewhere it is how far a stuck point turns, less the slip at the end where friction has turned with it.
    """
    before, sliding = velocity[..., 1:], SLIDING * STANDARD_GRAVITY * step
    fast = (before.square().sum(-1) / sliding**2 - 1).clamp(0, 1)
    share = torch.where(hit, 0.0, fast)[..., None]
    stuck = step[..., None] * bend[..., 1:] / 2
    usual = share * before + (1 - share) * stuck
    turned = turns.turns[:, None, None]
    slip = turned * (stuck - turns.end[:, None]) + (1 - turned) * turns.before[:, None]
    return usual + torch.where(hit, 0.0, turns.known[:, None])[..., None] * (slip - usual)
