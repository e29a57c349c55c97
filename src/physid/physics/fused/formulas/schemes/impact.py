"""Contact under `Midpoint`, in scalars: what `physid.physics.schemes.impact` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import and_, or_

from physid.compiler.graph import Value, least, most, root, stop, total, where
from physid.compiler.section import Record
from physid.physics.fused.formulas.algebra import Vector, decay, dot
from physid.physics.schemes.impact import FAINT, LARGEST, LOADS, PUSH, SHARPNESS, SLIDING, SLOWEST
from physid.physics.schemes.units import STANDARD_GRAVITY

DOUBLINGS = SHARPNESS.bit_length() - 1


@dataclass(frozen=True)
class Contact:
    """What is known of a contact before it is solved.

    Attributes:
        gap: y [m].
        velocity: In the patch's frame, before the step [m/s].
        free: f [m/s].
        bend: Acceleration by which its point leaves a straight line, in the patch's frame [m/s^2].
        exists: Whether there is one.
    """

    gap: Value
    velocity: Vector
    free: Value
    bend: Vector
    exists: Value


def slip(contact: Contact, hit: Value, constants: Record) -> Vector:
    """Return what is added to the tangential velocity that friction opposes [m/s]."""
    before, sliding = contact.velocity[1:], SLIDING * STANDARD_GRAVITY * constants.one("step")
    fast = least(most(dot(before, before) / (sliding * sliding) - 1.0, 0.0), 1.0)
    share = where(hit > 0.5, 0.0, fast)
    return [share * u + (1.0 - share) * b for u, b in zip(before, stuck(contact, constants), strict=True)]


def stuck(contact: Contact, constants: Record) -> Vector:
    """Return how far a point that sticks turns within half a step [m/s]."""
    half = 0.5 * constants.one("step")
    return [half * b for b in contact.bend[1:]]


def demand(
    touches: Sequence[Contact], restitution: Value, yielding: tuple[Value, Value], constants: Record, width: Value
) -> tuple[Vector, Value, Value, Value]:
    """Return c of every contact [m/s], the share W of the step, whether there is an impact, and whether of all at once.

    Args:
        touches: The contacts.
        restitution: e.
        yielding: The compliance in units of the solver, and h / (h + t).
        constants: Of the world.
        width: See `physid.physics.schemes.impact.demand`.
    """
    compliance, correction = yielding
    h, fall = constants.one("step"), STANDARD_GRAVITY * constants.one("step")
    found, shares, impacts, ends = [], [], [], []
    for one in touches:
        turned = 0.5 * h * one.bend[0]
        gap, u, f, exists = one.gap - 0.25 * h * turned, one.velocity[0] - turned, one.free + turned, one.exists
        change, begin = f - u, gap - 0.5 * h * u
        apart = begin > 0.0
        start = where(apart, begin, 0.0)
        end = start + 0.5 * h * (u + f)
        reached = exists & (gap + 0.5 * h * f < 0.0)
        falling = reached & apart
        square = most(where(falling, u * u - 2.0 * start * change / h, 1.0), 1e-300)
        touch = where(falling, -root(square), least(u, 0.0))
        fast = reached & (touch < -SLOWEST * fall)
        timed = fast & apart
        late = where(timed, 2.0 * start / (h * where(timed, -touch - u, 1.0)), 0.0)
        leaving = (1.0 - late) * change - restitution * touch
        leaves = fast & (leaving > FAINT * fall)
        impact = (leaves & apart) | (fast & (compliance <= 0.0))
        leaves = leaves & impact
        late = where(impact, late, 0.0)
        stays = reached & (f < 0.0) & ~leaves
        resting = least(most(end / (h * where(stays, f, 1.0)), 0.0), LARGEST)
        shares.append(where(reached, where(stays, resting, 1.0 - late), 0.0))
        impacts.append(impact)
        ends.append(gap + 0.5 * h * f)
        found.append((gap, f, end, reached, leaves, leaving))
    hit, largest = reduce(or_, impacts), _smooth_maximum(shares)
    divisor = h * where(hit & (largest > 0.0), largest, 1.0)
    passed = reduce(most, ends) / width
    together = where(hit & reduce(and_, [each[3] for each in found]), 1.0 - decay(passed * passed), 0.0)
    offsets = []
    for one, (gap, f, end, reached, leaves, leaving) in zip(touches, found, strict=True):
        still = f - end / divisor
        still = where(reached, still, least(still, 0.0))
        still = where(leaves, most(still, leaving), still)
        pushed = most(correction * gap / h, -(PUSH * fall) - LOADS * fall * compliance)
        slow = where(gap > 0.0, where(reached, 1.0, 2.0) * (gap / h), pushed)
        offsets.append(where(hit, -still, slow) + 0.5 * h * one.bend[0])
    return offsets, where(hit, largest, 0.5), where(hit, 1.0, 0.0), together


def _smooth_maximum(shares: Sequence[Value]) -> Value:
    """Return sum w^(p + 1) / sum w^p."""
    top = most(stop(reduce(most, shares)), 1e-30)
    weights = []
    for share in shares:
        weight = share / top
        for _ in range(DOUBLINGS):
            weight = weight * weight
        weights.append(weight)
    return dot(weights, shares) / most(total(weights), 1e-30)
