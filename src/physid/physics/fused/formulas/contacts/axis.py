"""Two boxes: across which axis they are furthest apart."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

from physid.compiler.graph import Value, least, most, root, size, total, where
from physid.compiler.section import Record
from physid.physics.fused.formulas.algebra import Matrix, Vector, cross, dot, rows, scale, subtract, transpose

FAR_APART = 1e6


def axes_of(body: Record) -> Matrix:
    """Return the axes of a box as rows."""
    return transpose(rows(body["axes"]))


def half_of(body: Record) -> Vector:
    """Return half the edge lengths of a box."""
    return scale(0.5, body["size"])


def pick(masks: Sequence[Value], vectors: Sequence[Sequence[Value]]) -> Vector:
    """Return the vector whose mask holds; the last if no other does."""
    chosen = list(vectors[-1])
    for mask, vector in list(zip(masks, vectors, strict=True))[-2::-1]:
        chosen = [where(mask, value, old) for value, old in zip(vector, chosen, strict=True)]
    return chosen


def choose_axis(first: Record, second: Record, patch: Record) -> None:
    """Write which of the 15 axes has the largest separation: 0-2 first box, 3-5 second box, 6-14 edge pairs."""
    axes, half = (axes_of(first), axes_of(second)), (half_of(first), half_of(second))
    between = subtract(second["pose"][:3], first["pose"][:3])
    margin = 1e-2 * reduce(least, [*half[0], *half[1]])
    biases = [margin * 0.0] * 3 + [margin * 1e-3] * 3 + [margin] * 9
    crosses = [cross(a, b) for a in axes[0] for b in axes[1]]
    lengths = [root(dot(a, a)) for a in crosses]
    units = [scale(1.0 / most(length, 1e-12), a) for a, length in zip(crosses, lengths, strict=True)]
    scores = []
    for direction, bias in zip([*axes[0], *axes[1], *units], biases, strict=True):
        reach = [size(dot(direction, a)) * h for own in zip(axes, half, strict=True) for a, h in zip(*own, strict=True)]
        scores.append(size(dot(direction, between)) - total(reach) - bias)
    for k, length in enumerate(lengths, 6):
        scores[k] = where(length < 1e-3, -FAR_APART, scores[k])
    best, index = scores[0], margin * 0.0
    for k, score in enumerate(scores[1:], 1):
        better = best < score
        best, index = where(better, score, best), where(better, float(k), index)
    patch["choice"] = [index, *[0.0] * 28]
    patch["label"] = [8.0 * index + k for k in range(4)]
