"""The face of one box and the opposite face of another, and the points where they may touch."""

from __future__ import annotations

from collections.abc import Sequence

from physid.compiler.graph import Value, least, most, size, where
from physid.compiler.section import Record
from physid.physics.fused.formulas.algebra import Vector, add, apply, dot, scale, subtract
from physid.physics.fused.formulas.contacts.axis import axes_of, half_of, pick
from physid.physics.shapes.shape import DISTINCT, FIRST

SIGNS = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
NEXT = SIGNS[1:] + SIGNS[:1]


class Face:
    """The face of a box across the chosen axis, as a rectangle in its own frame (height, x, y), and what faces it.

    Attributes:
        swap: Whether it is a face of the second box.
        centre: Of the box, world frame.
        frame: Rows height, x, y, world frame.
        reach: Half edges of the box along the frame.
        middle: Centre of the facing face, a parallelogram, in the frame.
        spans: Its half edges.
        widest: The largest of `reach`.
    """

    def __init__(self, first: Record, second: Record, index: Value) -> None:
        self.swap = (index >= 3.0) & (index < 6.0)
        one, two = ([body["pose"][:3], *axes_of(body), half_of(body)] for body in (first, second))
        own = [self._choose(a, b) for a, b in zip(one, two, strict=True)]
        other = [self._choose(b, a) for a, b in zip(one, two, strict=True)]
        self.centre = own[0]
        axis = where(self.swap, index - 3.0, index)
        masks = [axis.equals(0.0), axis.equals(1.0), axis.equals(2.0)]
        frame, self.reach = _turned(masks, own[1:4], own[4])
        between = subtract(other[0], self.centre)
        side = where(dot(frame[0], between) < 0.0, -1.0, 1.0)
        self.frame = [scale(side, frame[0]), *frame[1:]]
        relative = [apply(self.frame, a) for a in other[1:4]]
        along = [size(a[0]) for a in relative]
        zero = (along[0] >= along[1]) & (along[0] >= along[2])
        relative, extent = _turned([zero, ~zero & (along[1] >= along[2]), ~zero], relative, other[4])
        away = where(relative[0][0] > 0.0, -1.0, 1.0)
        self.middle = add(apply(self.frame, between), scale(away * extent[0], relative[0]))
        self.spans = [scale(e, r) for e, r in zip(extent[1:], relative[1:], strict=True)]
        self.widest = most(most(self.reach[0], self.reach[1]), self.reach[2])

    def _choose(self, a: Sequence[Value], b: Sequence[Value]) -> Vector:
        return [where(self.swap, y, x) for x, y in zip(a, b, strict=True)]

    def corner(self, signs: Sequence[Value | float]) -> Vector:
        """Return a corner of the facing face."""
        return add(self.middle, add(scale(signs[0], self.spans[0]), scale(signs[1], self.spans[1])))

    def lifted(self, signs: Sequence[Value | float]) -> tuple[Vector, Value, Value, Value]:
        """Return the point of the facing face over a corner of this, its coordinates u, v there, and if it is flat."""
        (_, ax, ay), (_, bx, by) = self.spans
        determinant = ax * by - bx * ay
        flat = size(determinant) < 1e-9 * (self.reach[1] * self.reach[2])
        safe = where(flat, 1.0, determinant)
        x, y = self.reach[1] * signs[0], self.reach[2] * signs[1]
        dx, dy = x - self.middle[1], y - self.middle[2]
        u, v = (dx * by - dy * bx) / safe, (dy * ax - dx * ay) / safe
        height = self.middle[0] + u * self.spans[0][0] + v * self.spans[1][0]
        return [height, x, y], u, v, flat

    def crossing(self, start: Vector, step: Vector, bound: Value, along: int) -> tuple[Vector, Value, Value]:
        """Return where an edge meets a side of this face (x or y = bound), its parameter t, and if it is level."""
        level = size(step[along]) < 1e-12
        t = (bound - start[along]) / where(level, 1.0, step[along])
        return add(start, scale(t, step)), t, level

    def candidate(self, code: Sequence[Value]) -> Vector:
        """Return the candidate that a code of `choose_points` names."""
        kind, signs, following, side = code[0], code[1:3], code[3:5], code[5]
        start = self.corner(signs)
        step = subtract(self.corner(following), start)
        by_x, crosses = kind.equals(2.0), kind >= 2.0
        along, reach = where(by_x, start[1], start[2]), where(by_x, self.reach[1], self.reach[2])
        t = (side * reach - along) / where(crosses, where(by_x, step[1], step[2]), 1.0)
        t = where(crosses, t, 0.0)
        lifted = self.lifted(signs)[0]
        return [where(kind.equals(1.0), up, x + t * dx) for up, x, dx in zip(lifted, start, step, strict=True)]


def _turned(masks: Sequence[Value], axes: Sequence[Vector], half: Sequence[Value]) -> tuple[list[Vector], Vector]:
    """Return axes and half edges in cyclic order from the one whose mask holds."""
    turns = [[(i + k) % 3 for i in range(3)] for k in range(3)]
    return [pick(masks, [axes[i] for i in turn]) for turn in turns], [
        pick(masks, [[half[i]] for i in turn])[0] for turn in turns
    ]


def choose_points(first: Record, second: Record, patch: Record) -> None:
    """Write four of the 24 candidates for a face contact, which span the touching area (see `box._spread`).

    A code is: kind (0 corner of the facing face, 1 over a corner of this, 2 crossing of a side in x, 3 in y), signs of
    the corner, signs of the next, sign of the side, and whether it is active.
    """
    face = Face(first, second, patch["choice"][0])
    codes: list[Value | float] = []
    points: list[Vector] = []
    candidates = _candidates(face)
    apart: list[Value] = []
    for signs in SIGNS:
        score = [_towards(face, point, signs) for point, _, _ in candidates]
        chosen, _ = _best(candidates, score)
        point, real, code = chosen
        if points:
            other, distance = _best(candidates, [value - FIRST * k for k, value in enumerate(apart)])
            repeated = None
            for before in points:
                near = [size(a - b) < 1e-6 * face.widest for a, b in zip(point, before, strict=True)]
                same = near[0] & near[1] & near[2]
                repeated = same if repeated is None else repeated | same
            assert repeated is not None
            point, real, code = _choose(repeated, other, chosen)
            real = real & (~repeated | (distance > DISTINCT))
        points.append(point)
        codes += [*code, where(real, 1.0, 0.0)]
        away = [_apart(face, candidate, point) for candidate, _, _ in candidates]
        apart = [least(a, b) for a, b in zip(apart, away, strict=True)] if apart else away
    patch["choice"] = [patch["choice"][0], *codes]


Candidate = tuple[Vector, Value, Vector]


def _candidates(face: Face) -> list[Candidate]:
    """Return all corners of the facing face clipped to this: point, whether it is real, and code."""
    bounds = [r + (1e-9 + 1e-6 * r) for r in face.reach[1:]]
    corners = [face.corner(signs) for signs in SIGNS]

    def code(*numbers: float) -> Vector:
        return [face.widest.like(number) for number in numbers]

    found: list[Candidate] = []
    for corner, signs, following in zip(corners, SIGNS, NEXT, strict=True):
        inside = (size(corner[1]) <= bounds[0]) & (size(corner[2]) <= bounds[1])
        found.append((corner, inside, code(0, *signs, *following, 0)))
    for signs, following in zip(SIGNS, NEXT, strict=True):
        point, u, v, flat = face.lifted(signs)
        covered = (size(u) <= 1 + 1e-6) & (size(v) <= 1 + 1e-6) & ~flat
        found.append((point, covered, code(1, *signs, *following, 0)))
    for along in (1, 2):
        for k, (signs, following) in enumerate(zip(SIGNS, NEXT, strict=True)):
            step = subtract(corners[(k + 1) % 4], corners[k])
            for side in (-1.0, 1.0):
                point, t, level = face.crossing(corners[k], step, side * face.reach[along], along)
                within = (size(point[3 - along]) <= bounds[2 - along]) & ~level & (t >= 0.0) & (t <= 1.0)
                found.append((point, within, code(1 + along, *signs, *following, side)))
    return found


def _towards(face: Face, point: Vector, signs: tuple[float, float]) -> Value:
    """Return how far a point lies towards a corner of the face, the lower the further."""
    score = point[1] * (signs[0] / face.reach[1]) + point[2] * (signs[1] / face.reach[2])
    return score - point[0] * (4.0 / face.widest)


def _apart(face: Face, point: Vector, other: Vector) -> Value:
    """Return how far a point lies from another, the lower the further."""
    away = subtract(point, other)
    return size(away[1]) / face.reach[1] + size(away[2]) / face.reach[2] - away[0] * (4.0 / face.widest)


def _choose(mask: Value, yes: Candidate, no: Candidate) -> Candidate:
    """Return one of two candidates."""
    return (
        [where(mask, a, b) for a, b in zip(yes[0], no[0], strict=True)],
        (mask & yes[1]) | (~mask & no[1]),
        [where(mask, a, b) for a, b in zip(yes[2], no[2], strict=True)],
    )


def _best(candidates: Sequence[Candidate], score: Sequence[Value]) -> tuple[Candidate, Value]:
    """Return the first of the real candidates with the highest score, and the score."""
    chosen, best = candidates[0], where(candidates[0][1], score[0], -1e6)
    for candidate, value in zip(candidates[1:], score[1:], strict=True):
        value = where(candidate[1], value, -1e6)
        better = best < value
        best, chosen = where(better, value, best), _choose(better, candidate, chosen)
    return chosen, best
