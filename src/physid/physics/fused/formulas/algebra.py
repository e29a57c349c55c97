"""Vectors, matrices and rotations as lists of `Value`s."""

from __future__ import annotations

from collections.abc import Sequence

from physid.compiler.graph import Value, least, root, total

Vector = list[Value]
Matrix = list[list[Value]]
DOUBLINGS = 6


def add(a: Sequence[Value], b: Sequence[Value]) -> Vector:
    """Add vectors."""
    return [x + y for x, y in zip(a, b, strict=True)]


def subtract(a: Sequence[Value], b: Sequence[Value]) -> Vector:
    """Subtract vectors."""
    return [x - y for x, y in zip(a, b, strict=True)]


def scale(factor: Value | float, a: Sequence[Value]) -> Vector:
    """Multiply a vector by a number."""
    return [x * factor for x in a]


def dot(a: Sequence[Value], b: Sequence[Value]) -> Value:
    """Compute a scalar product."""
    return total([x * y for x, y in zip(a, b, strict=True)])


def cross(a: Sequence[Value], b: Sequence[Value]) -> Vector:
    """Compute a vector product."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def apply(matrix: Sequence[Sequence[Value]], a: Sequence[Value]) -> Vector:
    """Compute A x."""
    return [dot(row, a) for row in matrix]


def transpose(matrix: Sequence[Sequence[Value]]) -> Matrix:
    """Return the transpose."""
    return [list(column) for column in zip(*matrix, strict=True)]


def multiply_matrices(a: Sequence[Sequence[Value]], b: Sequence[Sequence[Value]]) -> Matrix:
    """Compute A B."""
    return [[dot(row, column) for column in transpose(b)] for row in a]


def invert(a: Matrix) -> Matrix:
    """Invert a matrix of one to three rows."""
    if len(a) == 1:
        return [[1.0 / a[0][0]]]
    if len(a) == 3:
        columns = [cross(a[1], a[2]), cross(a[2], a[0]), cross(a[0], a[1])]
        return transpose([scale(1.0 / dot(a[0], columns[0]), column) for column in columns])
    inverse = 1.0 / (a[0][0] * a[1][1] - a[0][1] * a[1][0])
    return [[a[1][1] * inverse, -(a[0][1] * inverse)], [-(a[1][0] * inverse), a[0][0] * inverse]]


def rows(values: Sequence[Value], width: int = 3) -> Matrix:
    """Cut a list of numbers into the rows of a matrix."""
    return [list(values[k : k + width]) for k in range(0, len(values), width)]


def unit(a: Sequence[Value]) -> Vector:
    """Scale a vector to length 1."""
    return scale(1.0 / root(dot(a, a)), a)


def to_matrix(quaternion: Sequence[Value]) -> Matrix:
    """Turn a unit quaternion x y z w into the matrix that maps body to world axes."""
    x, y, z, w = quaternion
    return [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]


def multiply(left: Sequence[Value], right: Sequence[Value]) -> Vector:
    """Compose rotations: the Hamilton product."""
    lx, ly, lz, lw = left
    rx, ry, rz, rw = right
    return [
        lw * rx + lx * rw + ly * rz - lz * ry,
        lw * ry - lx * rz + ly * rw + lz * rx,
        lw * rz + lx * ry - ly * rx + lz * rw,
        lw * rw - lx * rx - ly * ry - lz * rz,
    ]


def conjugate(quaternion: Sequence[Value]) -> Vector:
    """Invert a rotation."""
    x, y, z, w = quaternion
    return [-x, -y, -z, w]


def rotate(quaternion: Sequence[Value], vector: Sequence[Value]) -> Vector:
    """Rotate a vector, v' = v + 2 w (u x v) + 2 u x (u x v)."""
    axis, scalar = quaternion[:3], quaternion[3]
    twice = scale(2.0, cross(axis, vector))
    return add(vector, add(scale(scalar, twice), cross(axis, twice)))


def exponential(rotation: Sequence[Value], doublings: int = DOUBLINGS) -> Vector:
    """Map a rotation vector to its quaternion, (sin(a) / a r / 2, cos(a)) with a = |r| / 2.

    Sums the series of a / 2^k, then doubles the angle k times: to rounding for turns below 2^k rad.
    """
    x = dot(rotation, rotation) * (0.25 / 4**doublings)
    ratio = _series(x, (6, 20, 42, 72, 110, 156, 210, 272, 342))
    versine = 0.5 * x * _series(x, (12, 30, 56, 90, 132, 182, 240, 306))
    for _ in range(doublings):
        ratio, versine = ratio - ratio * versine, 2.0 * versine * (2.0 - versine)
    return [*scale(0.5 * ratio, rotation), 1.0 - versine]


def decay(x: Value) -> Value:
    """Compute exp(-x) for x >= 0; from x = 64 on, exp(-64)."""
    x = least(x, 64.0) * (1.0 / 64.0)
    value = _series(x, range(1, 18))
    for _ in range(6):
        value = value * value
    return value


def _series(x: Value, divisors: Sequence[int]) -> Value:
    """Sum 1 - x / d1 (1 - x / d2 (1 - ...))."""
    value = x.graph.constant(1.0)
    for divisor in reversed(divisors):
        value = 1.0 - x * (1.0 / divisor) * value
    return value
