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
  the ground and meets no other one friction turns with the slip within the step (`schemes.turning`).
* A body on the ground that another one strikes gets the friction of the time before as a push, and rubs for the rest of
  the step alone, against the slip at its end (`schemes.turning.friction_before_impact`).
* What bounces off a compliant contact does so as off a rigid one, where it is reached: its row has no compliance then.
  All else, and all overlap, is that of a spring of stiffness 1 / C with a damper of t / C, C f = -(y + h u+) - t u+.
  With t = sqrt(C m) and m the mass of the body, one that stands on four corners is damped critically.
* Contacts of a face that all are reached in the step stop together, and share the load as those that lie flat do.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.physics.contact import FLATNESS, Patch
from physid.physics.schemes.units import STANDARD_GRAVITY

SLOWEST = 0.25
"""An approach slower than this, in units of g h, is that of bodies at rest, and no impact [-]."""

SLIDING = 2.0
"""Slip from which on it may count as sliding through the step, in units of g h; at sqrt(2) times that it does [-]."""

FAINT = 1e-3
"""A bounce slower than this, in units of g h, is none: at e = 0 its sign is that of rounding [-]."""

LARGEST = 2.0
"""Bound on W [-], which exceeds 1 where something pulls a body away while it lands."""

PUSH = 0.5
"""Overlaps open at most this fast, in units of g h [-]: a body so pushed rises by less than g h^2 / 8."""

LOADS = 20.0
"""Overlap up to so many times that which the mean weight causes in a compliant contact is the contact's own [-]."""


BRIEF = 1e-4
"""Times t of a damper below this are shorter still, so that t(C) = sqrt(C m) has a slope at C = 0 [s]."""

SHARPNESS = 32
"""Exponent p of the smooth maximum of shares, sum w^(p + 1) / sum w^p [-]: a mean where they are equal, as in a face
that lands flat, so that no corner of four is preferred by rounding."""


@dataclass(frozen=True)
class Impact:
    """What the contacts of a patch demand.

    Attributes:
        offset: c of u+ >= -c [m/s], shape (B, 4).
        slip: What is added to the tangential velocity that friction opposes [m/s], shape (B, 4, 2).
        share: W, which share of the step the impulses of the patch act [-]; 1/2 without an impact; shape (B,).
        together: Whether an impact stops all four, a weight from 0 to 1, shape (B,).
        hit: Whether there is an impact, shape (B,).
    """

    offset: Tensor
    slip: Tensor
    share: Tensor
    together: Tensor
    hit: Tensor


def damping_time(compliance: Tensor, mass: Tensor) -> Tensor:
    """Return t of a compliant contact [s], sqrt(C m + t0^2) - t0 with t0 = `BRIEF`; shape (B,).

    Args:
        compliance: C [m/N], shape (B,).
        mass: m of the body on the ground [kg], shape (B,).
    """
    return (compliance * mass + BRIEF**2).sqrt() - BRIEF


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


def demand(
    patch: Patch,
    velocities: tuple[Tensor, Tensor],
    bend: Tensor,
    material: tuple[Tensor, Tensor, Tensor],
    step: Tensor,
    exists: Tensor,
    struck: Tensor,
) -> Impact:
    """Return what the contacts of a patch demand (see the module).

    Args:
        patch: Where they touch; its gap is y.
        velocities: In the patch's frame that before the step, shape (B, 4, 3), and f, shape (B, 4) [m/s].
        bend: See `bending` [m/s^2].
        material: e, the static deflection under the mean weight [m], and t [s], shapes (B,).
        step: h [s], shape (B or 1, 1).
        exists: Which contacts there are, shape (B, 4).
        struck: Whether another body strikes, after which alone friction acts, shape (B,).
    """
    restitution, give, time = (value[:, None] for value in material)
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
    fast = reached & (touch < -SLOWEST * STANDARD_GRAVITY * step)
    late = torch.where(fast & apart, 2 * start / (step * torch.where(fast & apart, -touch - u, 1.0)), 0.0)
    leaving = (1 - late) * change - restitution * touch
    leaves = fast & (leaving > FAINT * STANDARD_GRAVITY * step)
    impact = torch.where(give > 0, leaves & apart, fast)
    leaves = leaves & impact
    late = torch.where(impact, late, 0.0)
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
        torch.maximum(gap / (step + time), -PUSH * STANDARD_GRAVITY * step - LOADS * give / (step + time)),
    )
    offset = torch.where(hit, -still, slow) + step * bend[..., 0] / 2
    slip = _slip(velocities[0], bend, hit | struck[:, None], step)
    return Impact(offset, slip, torch.where(hit, largest, 0.5)[:, 0], together, hit[:, 0])


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


def _slip(velocity: Tensor, bend: Tensor, hit: Tensor, step: Tensor) -> Tensor:
    """Return the slip before the step where friction opposes the mean, and else how far a stuck point turns."""
    before, sliding = velocity[..., 1:], SLIDING * STANDARD_GRAVITY * step
    fast = (before.square().sum(-1) / sliding**2 - 1).clamp(0, 1)
    share = torch.where(hit, 0.0, fast)[..., None]
    return share * before + (1 - share) * stuck(bend, step)


def stuck(bend: Tensor, step: Tensor) -> Tensor:
    """Return how far a point that sticks turns within half a step, its slip (B, 4, 2) [m/s]."""
    return step[..., None] * bend[..., 1:] / 2
