"""Motion along one axis under a constant force and viscous drag, and when it reaches a place or a speed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from scipy.optimize import brentq, minimize_scalar

SERIES = 1e-3  # below this argument the power series has less rounding than the formula
EXACT: Any = {"xatol": 1e-12}  # [s] to which the widest gap is found
SAMPLES = 64  # places at which a root is looked for, where there is no formula


@dataclass(frozen=True)
class Path:
    """v' = a - k v from a place and a speed: x = x0 + v0 t f(k t) + a t^2 g(k t).

    f(z) = (1 - exp(-z)) / z and g(z) = (1 - f(z)) / z; without drag they are 1 and 1/2.

    Attributes:
        place: x0 [m].
        speed: v0 [m/s].
        pull: a, the constant force per mass [m/s^2].
        drag: k, the coefficient of drag per mass [1/s].
    """

    place: float
    speed: float
    pull: float
    drag: float = 0.0

    def place_at(self, time: float) -> float:
        """Return x [m]."""
        once, twice = _weights(self.drag * time)
        return self.place + self.speed * time * once + self.pull * time**2 * twice

    def speed_at(self, time: float) -> float:
        """Return v = v0 exp(-k t) + a t f(k t) [m/s]."""
        return self.speed * math.exp(-self.drag * time) + self.pull * time * _weights(self.drag * time)[0]

    def time_of_speed(self, speed: float) -> float:
        """Return when v is reached [s], infinity if it never is: t = log(1 + k (v - v0) / (a - k v)) / k."""
        change, force = speed - self.speed, self.pull - self.drag * speed
        if change == 0.0:
            return 0.0
        if force * change <= 0:
            return math.inf
        ratio = change / force
        return ratio if self.drag == 0 else math.log1p(self.drag * ratio) / self.drag


def time_of_meeting(one: Path, other: Path, apart: float, longest: float) -> float:
    """Return when two paths first come within a distance of each other while they close [s].

    Args:
        one: The path that is behind.
        other: The path that is ahead, by more than `apart`.
        apart: The distance [m].
        longest: Where to give up [s].

    Returns:
        The time, or infinity if it is not within `longest`.
    """

    def gap(time: float) -> float:
        return other.place_at(time) - one.place_at(time) - apart

    if one.drag == 0 and other.drag == 0:
        return _quadratic(gap(0.0), other.speed - one.speed, 0.5 * (other.pull - one.pull), longest)
    return _first_crossing(gap, longest)


def _quadratic(start: float, slope: float, curve: float, longest: float) -> float:
    """Return the first time > 0 at which start + slope t + curve t^2 falls below 0."""
    start = max(start, 0.0)
    if start == 0.0 and (slope > 0 or (slope == 0 and curve >= 0)):
        # It parts first; with a negative curve it comes back.
        time = -slope / curve if curve < 0 else math.inf
    else:
        root = slope**2 - 4 * curve * start
        # The form without cancellation: 2 c / (-b + sqrt(b^2 - 4 a c)) for a gap that closes.
        time = math.inf if root < 0 or (slope >= 0 and curve >= 0) else _smallest(start, slope, curve, math.sqrt(root))
    return time if time <= longest else math.inf


def _smallest(start: float, slope: float, curve: float, root: float) -> float:
    """Return the smallest root > 0 of start + slope t + curve t^2, from the root of its discriminant."""
    if slope < 0:
        return 2 * start / (-slope + root)
    return (-slope - root) / (2 * curve)


def _first_crossing(gap: Callable[[float], float], longest: float) -> float:
    """Return the first time at which a smooth gap falls below zero."""
    before, was = 0.0, max(gap(0.0), 0.0)
    for index in range(1, SAMPLES + 1):
        time = longest * index / SAMPLES
        now = gap(time)
        if now < 0:
            if was <= 0:  # it may open first, and close again before this sample
                widest = minimize_scalar(lambda t: -gap(t), bounds=(before, time), method="bounded", options=EXACT)
                before, was = float(widest.x), gap(float(widest.x))
            return before if was <= 0 else float(brentq(gap, before, time, xtol=1e-15, rtol=1e-15))
        before, was = time, now
    return math.inf


def _weights(z: float) -> tuple[float, float]:
    """Return f(z) and g(z)."""
    if abs(z) < SERIES:
        return 1 - z / 2 + z**2 / 6 - z**3 / 24, 0.5 - z / 6 + z**2 / 24 - z**3 / 120
    once = -math.expm1(-z) / z
    return once, (1 - once) / z
