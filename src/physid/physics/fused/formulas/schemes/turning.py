"""Friction that turns with the slip within a step, in scalars: what `physid.physics.schemes.turning` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from physid.compiler.graph import Value, least, most, root, total, where
from physid.compiler.section import Record
from physid.physics.fused.formulas.algebra import Vector, dot
from physid.physics.schemes.impact import FAINT
from physid.physics.schemes.turning import NO_IMPACT, SPINNING, STEADY, TINY, TURNED, TURNS
from physid.physics.schemes.units import STANDARD_GRAVITY


def slip_after(slip: Vector, change: Vector, most_: Value) -> Vector:
    """Return the slip after a step, with friction that turns with it."""
    change, most_ = [f / TURNS for f in change], most_ / TURNS
    for _ in range(TURNS):
        heading = _heading(slip)
        speed, slowing = dot(slip, heading), most_ - dot(change, heading)
        stops = speed < slowing
        falls = where(stops, speed / where(stops, slowing, 1.0), 1.0)
        between = _heading([s + 0.5 * falls * f for s, f in zip(slip, change, strict=True)])
        rest = 1.0 - falls
        slip = [s + falls * (f - most_ * n) + rest * f for s, f, n in zip(slip, change, between, strict=True)]
        length, left = dot(slip, _heading(slip)), rest * most_
        goes = length > left
        slip = [where(goes, s * (1.0 - left / where(goes, length, 1.0)), 0.0) for s in slip]
    return slip


def _heading(slip: Vector) -> Vector:
    """Return the unit vector along a slip, 0 where there is none."""
    square = dot(slip, slip)
    some = square > TINY
    length = root(where(some, square, 1.0))
    return [where(some, s, 0.0) / length for s in slip]


@dataclass(frozen=True)
class Turning:
    """How friction turns within the step: slips before and at the end [m/s], and the weights of both."""

    before: Vector
    end: Vector
    turns: Value
    known: Value


def turning(velocities: tuple[Vector, Vector], spin: Value, friction: Value, lies: Value, constants: Record) -> Turning:
    """Return how friction turns under a face that slides on the ground.

    Args:
        velocities: Of the centre of mass in the patch's frame, before the step and without contact after it [m/s].
        spin: Slip of a corner by the turn about the normal [m/s].
        friction: Coefficient.
        lies: Whether all four contacts would be in the ground.
        constants: Of the world.
    """
    (_, *slip), (fall, *after) = velocities
    unit, square = STANDARD_GRAVITY * constants.one("step"), dot(slip, slip)
    change, most_ = [f - u for f, u in zip(after, slip, strict=True)], friction * most(-fall, 0.0)
    end = slip_after(slip, change, most_)
    rubs, made = most_ > FAINT * FAINT * unit, [e - u - f for e, u, f in zip(end, slip, change, strict=True)]
    largest = where(rubs, most_, 1.0)
    impulse = dot(made, made) / (largest * largest)
    turns = _share((TURNED[0] ** 2 - impulse) / (TURNED[0] ** 2 - TURNED[1] ** 2))
    spinning, steady = spin / (SPINNING * unit), STEADY * unit
    known = _share(2.0 - spinning * spinning) * _share(2.0 - square / (steady * steady))
    moves = square > FAINT * unit * (FAINT * unit)
    return Turning(slip, end, turns, where(lies & rubs & moves, known, 0.0))


def _share(x: Value) -> Value:
    return least(most(x, 0.0), 1.0)


def share_before_impact(beside: Sequence[Record]) -> Value:
    """Return which share of the step is over when another body strikes first, `NO_IMPACT` if none does.

    Args:
        beside: The patches between the body and others.
    """
    before = beside[0].one("share").like(NO_IMPACT)
    for patch in beside:
        share = least(most(1.0 - patch.one("share"), 0.0), 1.0)
        before = where(patch.one("hit") > 0.5, least(before, share), before)
    return before


def friction_before_impact(
    slips: Sequence[Vector], velocities: tuple[Vector, Vector], friction: Value, before: Value
) -> list[Vector]:
    """Return the velocity that friction gives a body before another one strikes it, by each of four contacts [m/s].

    Args:
        slips: Of the contacts before the step [m/s].
        velocities: Of the centre of mass in the patch's frame, before the step and without contact after it [m/s].
        friction: Coefficient.
        before: Which share of the step is over by then.
    """
    (_, *start), (fall, *free) = velocities
    largest = before * friction * most(-fall, 0.0)
    given = [before * (f - u) for u, f in zip(start, free, strict=True)]
    wanted = [[s + g for s, g in zip(slip, given, strict=True)] for slip in slips]
    mean = [0.25 * total(list(each)) for each in zip(*wanted, strict=True)]
    pushes = []
    for w in wanted:
        length = root(most(where(before > 0.0, dot(w, w), 1.0), TINY))
        share = least(where(before > 0.0, largest, 0.0) / length, 1.0)
        off = 1.0 - (2.0 / 3.0) * share
        pushes.append([-0.25 * share * (m + off * (x - m)) for x, m in zip(w, mean, strict=True)])
    return pushes


def turned(usual: Vector, stuck: Vector, turns: Turning, hit: Value) -> Vector:
    """Return what is added to the tangential velocity that friction opposes [m/s] (see the reference)."""
    known = where(hit > 0.5, 0.0, turns.known)
    slips = [
        turns.turns * (b - e) + (1.0 - turns.turns) * u for b, e, u in zip(stuck, turns.end, turns.before, strict=True)
    ]
    return [u + known * (s - u) for u, s in zip(usual, slips, strict=True)]
