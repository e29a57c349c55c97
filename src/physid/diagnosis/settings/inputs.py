"""Settings of what a diagnosis starts from: roles, phases of motion, events."""

from __future__ import annotations

from physid.diagnosis.settings.origins import FLIGHTS
from physid.setting import Section, setting


class RoleSettings(Section):
    """Which part a trajectory plays."""

    probes_from: int = setting(
        4, "trajectories", "of another protocol, from which on every second one joins the fit as a probe", ge=2
    )
    select_every: int = setting(
        3, "trajectories", "of so many fitted ones the last selects, where no split says which", ge=2
    )


class PhaseSettings(Section):
    """What a body is doing at each frame."""

    still_speed: float = setting(0.01, "m/s", "speed below which a body is at rest or sticks", gt=0)
    still_spin: float = setting(0.05, "rad/s", "spin below which it is", gt=0)
    slow: float = setting(0.3, "m/s", "speed that parts slow from fast sliding", gt=0)
    light: float = setting(0.02, "weights", "contact force below which a body flies", gt=0)
    hard: float = setting(
        2 * 9.81 / 240,
        "m/s",
        "that a contact changes a velocity by, beyond the weight, from which on it is an impact",
        gt=0,
    )
    impact_time: float = setting(2 / 240, "s", "that an impact or a contact between bodies lasts", ge=0)
    impact_frames: int = setting(
        2, "frames", "that poses show it at least: in the evidence, and where trajectories are cut", ge=0
    )
    switch: float = setting(0.3, "share", "of a trajectory's largest command; a larger change of it is a switch", gt=0)
    switch_time: float = setting(0.02, "s", "that a switch lasts in the map", gt=0)
    rare: float = setting(
        0.2, "share", "of a trajectory's frames; if more are switches, its command is noise and none is", gt=0, le=1
    )


class EventSettings(Section):
    """Frames at which small errors grow fast."""

    tilted: float = setting(0.05, "rad", "lean of a body that touches the ground with an edge", FLIGHTS, gt=0)
    reach: float = setting(0.025, "s", "before and after a frame, in which velocities are compared", gt=0)
    fewest: int = setting(3, "frames", "before and after a frame at least, however slow the camera", ge=2)
    jolt: float = setting(6.0, "standard deviations", "by which a velocity changes that was jolted", gt=0)
    jolt_spin: float = setting(1.5, "rad/s", "least change that is a jolt", gt=0)
    jolt_speed: float = setting(0.5, "m/s", "least change that is a jolt", gt=0)
