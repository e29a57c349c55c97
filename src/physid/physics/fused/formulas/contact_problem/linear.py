"""The Newton matrix of all bodies: filled, factorised, and solved with, also transposed."""

from __future__ import annotations

from collections.abc import Callable

from physid.compiler.graph import Value
from physid.compiler.section import Formula, Record
from physid.physics.fused.formulas.algebra import Matrix, Vector


def fill(body: Record, block: Record) -> None:
    """Write M of a body."""
    xx, xy, xz, yy, yz, zz = body["world_inertia"]
    zero, share = xx.graph.constant(0.0), body.one("share")
    inertia = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    top = [[*row, zero, zero, zero] for row in inertia]
    bottom = [[zero] * 3 + [share if i == j else zero for j in range(3)] for i in range(3)]
    block["entries"] = [value for row in top + bottom for value in row]


def _read(matrix: Record, bodies: int) -> Matrix:
    entries = matrix["entries"]

    def entry(i: int, j: int) -> Value:
        return entries[36 * (i // 6 * bodies + j // 6) + 6 * (i % 6) + j % 6]

    return [[entry(i, j) for j in range(6 * bodies)] for i in range(6 * bodies)]


def factor(bodies: int) -> Formula:
    """Return the formula of A = L U, with 1 / u_ii on the diagonal.

    Without pivoting: A = M + J^T W J has a positive definite symmetric part but for small terms of friction.
    """

    def formula(matrix: Record) -> None:
        a = _read(matrix, bodies)
        n = len(a)
        for i in range(n):
            a[i][i] = 1.0 / a[i][i]
            for k in range(i + 1, n):
                a[k][i] = a[k][i] * a[i][i]
                for j in range(i + 1, n):
                    a[k][j] = a[k][j] - a[k][i] * a[i][j]
        matrix["entries"] = [
            a[6 * p + i][6 * q + j] for p in range(bodies) for q in range(bodies) for i in range(6) for j in range(6)
        ]

    return formula


def _solver(bodies: int, substitute: Callable[[Matrix, Vector], None]) -> Formula:
    def formula(matrix: Record, *motions: Record) -> None:
        x = [value for motion in motions for value in motion["dv"]]
        substitute(_read(matrix, bodies), x)
        for n, motion in enumerate(motions):
            motion["dv"] = x[6 * n : 6 * n + 6]

    return formula


def solve(bodies: int) -> Formula:
    """Return the formula of x = A^-1 x, from the factors."""

    def substitute(a: Matrix, x: Vector) -> None:
        n = len(x)
        for i in range(n):
            for k in range(i + 1, n):
                x[k] = x[k] - a[k][i] * x[i]
        for i in range(n - 1, -1, -1):
            x[i] = x[i] * a[i][i]
            for k in range(i):
                x[k] = x[k] - a[k][i] * x[i]

    return _solver(bodies, substitute)


def solve_transposed(bodies: int) -> Formula:
    """Return the formula of x = A^-T x, from the factors."""

    def substitute(a: Matrix, x: Vector) -> None:
        n = len(x)
        for i in range(n):
            x[i] = x[i] * a[i][i]
            for k in range(i + 1, n):
                x[k] = x[k] - a[i][k] * x[i]
        for i in range(n - 1, -1, -1):
            for k in range(i):
                x[k] = x[k] - a[i][k] * x[i]

    return _solver(bodies, substitute)


def average_mass(shared: Record, *bodies: Record) -> None:
    """Write the mean mass, the unit of masses in the solver."""
    mass = bodies[0].one("mass")
    for body in bodies[1:]:
        mass = mass + body.one("mass")
    shared["mean_mass"] = [mass * (1.0 / len(bodies))]
