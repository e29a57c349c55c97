"""One contact of the circular cone: its equations eliminated by hand.

With z = (ln, g, b, lt), w = (sn, s, x, yt) as in `physid.physics.contact_problem.friction.Cone`, right-hand sides e of
the complementarity and r of the slack equations, and x = g, a Newton step changes them with the relative velocity u by

    dln = (e_n + ln r_n - ln du_n) / (sn + k ln)
    a11 db + a12 dg = e_0 - yt.et / g + q.(du_t - r_t),  a11 = g - yt.yt / g,  a12 = b - yt.lt / g,  q = b yt / g - lt
      -g db +  h dg = e_s + g r_s - g mu dln,            h = s + g SLACK_COMPLIANCE
    dlt = (et - b (du_t - r_t) - yt db - lt dg) / g
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from physid.compiler.graph import Value, most, root, size
from physid.physics.contact_problem.friction import SLACK_COMPLIANCE
from physid.physics.fused.formulas.algebra import Matrix, Vector, dot, scale, subtract

SLIP_SPEED = 1e-2
"""Slower contacts count as sticking, in units of g h."""


@dataclass(frozen=True)
class Contact:
    """One contact: unknowns z, slacks w, friction coefficient, and compliance with that of the solver."""

    z: Vector
    w: Vector
    friction: Value
    compliance: Value

    def response(self) -> tuple[Matrix, Vector]:
        """Return W = -d impulse / d u (3, 3) and d impulse / d mu (3)."""
        ln, g, b, *lt = self.z
        sn, _, _, *yt = self.w
        zero, inverse = ln.like(0.0), 1.0 / g
        kn = ln / (sn + self.compliance * ln)
        a11, a12, q, h, determinant = self._terms(inverse)
        f = [(x * a11 - y * a12) * determinant for x, y in zip(lt, yt, strict=True)]
        t = [(y * (h * inverse) + x) * determinant for x, y in zip(lt, yt, strict=True)]
        stick = b * inverse
        slip = [[t[i] * q[j] + (stick if i == j else 0.0) for j in range(2)] for i in range(2)]
        pressed = self.friction * kn
        w = [[kn, zero, zero], [pressed * f[0], *slip[0]], [pressed * f[1], *slip[1]]]
        return w, [zero, ln * f[0], ln * f[1]]

    def direction(self, slack: Sequence[Value], target: Value, du: Sequence[Value]) -> tuple[Vector, Vector]:
        """Return dz and dw for a target of z o w and a change of the relative velocity."""
        ln, g, b, *lt = self.z
        sn, s, _, *yt = self.w
        inverse = 1.0 / g
        moved = subtract(du[1:], slack[3:])
        wanted = [-(b * y + g * x) for x, y in zip(lt, yt, strict=True)]
        dln = (target - ln * sn + ln * (slack[0] - du[0])) / (sn + self.compliance * ln)
        a11, a12, q, h, determinant = self._terms(inverse)
        first = target - (b * g + dot(yt, lt)) - dot(yt, wanted) * inverse + dot(q, moved)
        second = target - g * s + g * (slack[1] - self.friction * dln)
        db, dg = (h * first - a12 * second) * determinant, (a11 * second + g * first) * determinant
        dlt = [(e - b * m - y * db - x * dg) * inverse for e, m, x, y in zip(wanted, moved, lt, yt, strict=True)]
        dsn = du[0] + self.compliance * dln - slack[0]
        ds = self.friction * dln + SLACK_COMPLIANCE * dg - db - slack[1]
        return [dln, dg, db, *dlt], [dsn, ds, dg, *moved]

    def slack_error(self, u: Sequence[Value], offset: Value) -> Vector:
        """Return w less what it should be."""
        ln, g, b, *_ = self.z
        sn, s, x, *yt = self.w
        normal = sn - (u[0] + self.compliance * ln + offset)
        return [normal, s - (self.friction * ln - b + SLACK_COMPLIANCE * g), x - g, *subtract(yt, u[1:])]

    def products(self) -> tuple[Vector, Vector]:
        """Return z o w: the three numbers that should be tau, and the two that should be 0."""
        ln, g, b, *lt = self.z
        sn, s, x, *yt = self.w
        return [ln * sn, g * s, b * x + dot(lt, yt)], [b * y + x * t for y, t in zip(yt, lt, strict=True)]

    def _terms(self, inverse: Value) -> tuple[Value, Value, Vector, Value, Value]:
        """Return a11, a12, q, h and 1 / (a11 h + a12 g), given 1 / g."""
        _, g, b, *lt = self.z
        s, yt = self.w[1], self.w[3:]
        a11, a12 = g - dot(yt, yt) * inverse, b - dot(yt, lt) * inverse
        q = [b * inverse * y - x for x, y in zip(lt, yt, strict=True)]
        h = s + SLACK_COMPLIANCE * g
        return a11, a12, q, h, 1.0 / (a11 * h + a12 * g)


def begin(u: Sequence[Value], offset: Value, friction: Value) -> tuple[Vector, Vector]:
    """Return z and w to start from: friction opposes the free slip, half as large as it may be (see `Cone.start`)."""
    separation = u[0] + offset
    impulse, slack = 1.0 + most(-separation, 0.0), 1.0 + size(separation)
    slip = 1.0 + 1.5 * root(dot(u[1:], u[1:]))
    bound = 0.5 * friction * impulse + 0.1
    return [impulse, slip, bound, *scale(-(bound / slip), u[1:])], [slack, bound, slip, *u[1:]]


def slide(contact: Contact, u: Sequence[Value], tau: Value) -> tuple[Vector, Vector, Value]:
    """Solve the friction equations of a sliding contact for given ln and u_t; return z, w and whether that is sound.

    They are s = mu ln - b + SLACK_COMPLIANCE g, g s = tau, b g + lt.u_t = tau and b u_t + g lt = 0, so that
    g^2 = u_t^2 + tau g / b: a hair above |u_t|. Eliminating friction so, and not by its tangent, lets a start from the
    previous solution turn with the direction of slip: the boundary of the cone is too curved for straight steps.
    """
    square = dot(u[1:], u[1:])
    speed = root(square)
    inverse = 1.0 / speed
    pressed = contact.friction * contact.z[0]
    bound = pressed + SLACK_COMPLIANCE * speed - tau * inverse
    share = tau * inverse / bound  # (g^2 - u_t^2) / u_t^2 to first order
    sound = (square > SLIP_SPEED**2) & (bound > 0.0) & (share < 1e-4)
    share = share + 0.5 * share * share
    g = speed * (1.0 + share * (0.5 - share * (0.125 - 0.0625 * share)))
    reciprocal = inverse * (1.0 - share * (0.5 - share * (0.375 - 0.3125 * share)))
    s = tau * reciprocal
    b = pressed + SLACK_COMPLIANCE * g - s
    return [contact.z[0], g, b, *scale(-(b * reciprocal), u[1:])], [contact.w[0], s, g, *u[1:]], sound


def impulse_of(z: Sequence[Value]) -> Vector:
    """Return (ln, lt)."""
    return [z[0], z[3], z[4]]
