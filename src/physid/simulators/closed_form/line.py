"""Blocks that move along a line on a plane: slip, stick, bounce and meet, from event to event."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physid.simulators.closed_form.path import Path, time_of_meeting

Array = NDArray[np.float64]
SLOWEST_IMPACT = 1e-9  # [m/s] what bounces off slower stays: endless bounces in a finite time have an end
MOST_EVENTS = 10_000  # within one frame
SAME_PLACE = 1e-12  # [m] blocks so close touch
SAME_TIME = 1e-12  # [s] that is left of a frame by rounding only


@dataclass
class Line:
    """One or two blocks on a line; the second is ahead of the first.

    Attributes:
        mass: [kg], shape (N,).
        friction: Coulomb coefficient of each with the plane [-], shape (N,).
        restitution: Newton coefficient of each with the plane [-], shape (N,).
        pair_restitution: Newton coefficient between the two [-].
        apart: Distance of the two centres when they touch [m].
        drag: Coefficient of viscous drag on each [N s/m].
        gravity: Acceleration of gravity along the line and along the plane's normal [m/s^2], shape (2,).
        place: Along the line [m], shape (N,).
        speed: Along the line [m/s], shape (N,).
        height: Above the plane [m], of one block only.
        rise: Velocity along the normal [m/s], of one block only.
    """

    mass: Array
    friction: Array
    restitution: Array
    pair_restitution: float
    apart: float
    drag: float
    gravity: Array
    place: Array
    speed: Array
    height: float = 0.0
    rise: float = 0.0

    def advance(self, force: Array, time: float) -> None:
        """Advance by a time [s] under constant forces along line and normal [N], shape (N, 2).

        Raises:
            ValueError: If a block of two would be lifted off the plane.
        """
        left = time
        for _ in range(MOST_EVENTS):
            left -= self._until_event(force, left)
            if left <= SAME_TIME:
                return
        raise ValueError(f"more than {MOST_EVENTS} events within {time:g} s; check masses, forces and restitution")

    def _until_event(self, force: Array, longest: float) -> float:
        """Go on to the next event and return the time that it took [s]."""
        load = -(force[:, 1] + self.mass * self.gravity[1])
        if len(self.mass) == 1:
            return self._one(force[0], float(load[0]), longest)
        if (load <= 0).any():
            raise ValueError("a force lifts one of two blocks off the plane; the closed form knows none that fly")
        return self._two(force[:, 0], load, longest)

    def _one(self, force: Array, load: float, longest: float) -> float:
        """Go on with one block."""
        mass, rate = float(self.mass[0]), self.drag / float(self.mass[0])
        if self.height > 0 or self.rise > 0 or load < 0:
            along = Path(self.place[0], self.speed[0], force[0] / mass + self.gravity[0], rate)
            normal = Path(self.height, self.rise, -load / mass, rate)
            landing = time_of_meeting(Path(0.0, 0.0, 0.0), normal, 0.0, longest)
            time = min(landing, longest)
            self._follow([along], time)
            self.height, self.rise = normal.place_at(time), normal.speed_at(time)
            if landing <= longest:
                self._land()
            return time
        drive = force[0] + mass * self.gravity[0]
        path = self._slide(0, drive, self.friction[0] * load, mass, self.drag)
        time = min(path.time_of_speed(0.0) if path.speed != 0 else math.inf, longest)
        self._follow([path], time)
        if time < longest:
            self.speed[0] = 0.0
        return time

    def _land(self) -> None:
        """Hit the plane: Newton's law along the normal, Coulomb's for the impulse along the line."""
        change = (1 + self.restitution[0]) * -self.rise
        slip = max(0.0, abs(self.speed[0]) - self.friction[0] * change)
        self.speed[0] = math.copysign(slip, self.speed[0])
        bounce = -self.restitution[0] * self.rise
        self.height, self.rise = 0.0, bounce if bounce > SLOWEST_IMPACT else 0.0

    def _slide(self, body: int, drive: float, limit: float, mass: float, drag: float) -> Path:
        """Return the path of a block on the plane until it stops: m v' = drive - sign limit - drag v."""
        speed = float(self.speed[body])
        if speed == 0 and abs(drive) <= limit:
            return Path(float(self.place[body]), 0.0, 0.0)
        against = math.copysign(limit, speed if speed != 0 else drive)
        return Path(float(self.place[body]), speed, (drive - against) / mass, drag / mass)

    def _two(self, force: Array, load: Array, longest: float) -> float:
        """Go on with two blocks, apart or together."""
        drive, limit = force + self.mass * self.gravity[0], self.friction * load
        paths = [self._slide(k, drive[k], limit[k], self.mass[k], self.drag) for k in range(2)]
        gap = self.place[1] - self.place[0] - self.apart
        close = gap <= SAME_PLACE and self.speed[0] == self.speed[1]
        speeding = [path.pull - path.drag * path.speed for path in paths]
        parting = math.inf
        if close and speeding[0] > speeding[1]:
            whole = self._slide(0, drive.sum(), limit.sum(), self.mass.sum(), 2 * self.drag)
            parting = self._parting(paths, whole)
            paths = [Path(float(place), whole.speed, whole.pull, whole.drag) for place in self.place]
            meeting = math.inf
        else:
            meeting = time_of_meeting(paths[0], paths[1], self.apart, longest)
            if close and meeting <= SAME_TIME:  # by rounding: they part
                meeting = math.inf
        stops = [path.time_of_speed(0.0) if path.speed != 0 else math.inf for path in paths]
        time = min(longest, meeting, parting, *stops)
        self._follow(paths, time)
        for body, stop in enumerate(stops):
            if stop <= time:
                self.speed[body] = 0.0
        if meeting <= time:
            self._collide()
        return time

    def _parting(self, paths: list[Path], whole: Path) -> float:
        """Return when drag parts two blocks that go together: when both alone would go on alike [s].

        With (a_1 - k_1 v) = (a_2 - k_2 v) the speed is v = (a_1 - a_2) / (k_1 - k_2).
        """
        difference = paths[0].drag - paths[1].drag
        if difference == 0 or whole.speed == 0:
            return math.inf
        time = whole.time_of_speed((paths[0].pull - paths[1].pull) / difference)
        return time if time > SAME_TIME else math.inf

    def _collide(self) -> None:
        """Hit each other: Newton's law, momentum kept."""
        closing = float(self.speed[0] - self.speed[1])
        after = -self.pair_restitution * closing if self.pair_restitution * closing > SLOWEST_IMPACT else 0.0
        common = float(self.mass @ self.speed) / float(self.mass.sum())
        share = self.mass[::-1] / self.mass.sum()
        self.speed[:] = common + share * np.array([after, -after]) if after else common
        self.place[1] = self.place[0] + self.apart

    def _follow(self, paths: list[Path], time: float) -> None:
        """Follow the paths for a time [s]."""
        self.place[:] = [path.place_at(time) for path in paths]
        self.speed[:] = [path.speed_at(time) for path in paths]
