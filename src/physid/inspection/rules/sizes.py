"""Sizes, masses and runs of another unit than the rest, and forces that were not tared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physid.inspection.evidence import Evidence
from physid.inspection.finding import Finding
from physid.inspection.kinematics import lowest_corner
from physid.inspection.rules.falls import FALL, SCALES

Array = NDArray[np.float64]
LARGE = 10.0  # [m]
SMALL = {"millimetres": 1e-3, "centimetres": 1e-2}  # units of sizes [m]
DENSEST = 25_000.0  # [kg/m^3]; osmium has 22 600
FAR = 30.0  # factor between the heights of runs from which on no motion of one box explains it, but a unit
HIGH = 0.25  # smallest edges: median height from which on ratios of heights mean something
CONSTANT = 0.1  # share of a mean vertical force by which it may vary, and count as constant
HEAVY = 0.1  # share of the weight from which on such a force matters
ALIKE = 0.2  # share by which it may differ from the weight and still be named so


def sizes(seen: Evidence) -> Finding | None:
    """Sizes that are not in metres."""
    k, edge = seen.kinematics, float(seen.scene.sizes.max())
    speed = np.linalg.norm(k.velocity, axis=1)
    if len(speed) and edge > LARGE and float(speed.max()) < edge:
        return Finding(
            f"a body of {edge:g} m moves at {np.median(speed):.3g} m/s: sizes seem to be in {_unit_of_sizes(seen)}",
            "write the full edges in metres into recording.yaml",
        )
    return None


def _unit_of_sizes(seen: Evidence) -> str:
    """Return the unit in which lowest corners are nearest to the ground, as they are on average."""

    def away(unit: float) -> float:
        edges = [(unit * x, unit * y, unit * z) for x, y, z in seen.scene.sizes.tolist()]
        scene = seen.scene.with_bodies(
            [replace(body, size=size) for body, size in zip(seen.scene.bodies, edges, strict=True)]
        )
        lowest = [np.median(np.abs(lowest_corner(pose, scene, body))) for _, body, _, pose in seen.tracks()]
        return float(np.median(lowest))

    return min(SMALL, key=lambda name: away(SMALL[name]))


def masses(seen: Evidence) -> Finding | None:
    """Masses that no matter has in so small a box."""
    for body in seen.scene.bodies:
        volume = float(np.prod(body.size))
        if body.mass > DENSEST * volume and max(body.size) < LARGE:
            guess = f"{body.name}.mass" in seen.scene.unknown
            return Finding(
                f"{body.name} of {1000 * volume:.3g} l weighs {body.mass:g} kg, {body.mass / volume:.3g} kg/m^3, more "
                "than any matter does: its mass seems to be in grams",
                "import with units.mass=g, or correct mass (and size) in recording.yaml",
                wrong=not guess,
            )
    return None


def runs(seen: Evidence) -> Finding | None:
    """Trajectories whose heights are those of the others in another unit."""
    normal = np.array(seen.scene.ground.normal)
    height = np.array(
        [abs(float(np.median(one.pose[..., :3][one.seen] @ normal))) for one in seen.recordings if one.pose is not None]
    )
    middle = float(np.median(height))
    if len(height) < 3 or middle < HIGH * float(seen.scene.sizes.min()):
        return None  # near the origin heights are noise, and their ratios any
    for scale, unit in SCALES.items():
        for factor, here, there in ((scale, unit, "metres"), (1 / scale, "metres", unit)):
            other = np.flatnonzero(np.abs(height / (factor * middle) - 1) < FALL)
            if scale < FAR or not len(other) or 2 * len(other) >= len(height):
                continue
            return Finding(
                f"in {len(other)} of {len(height)} trajectories (the first is {seen.indices[int(other[0])]}) bodies "
                f"are {height[other[0]] / middle:.3g} times as high as in the others: their log seems to be in {here}, "
                f"where those of the others are in {there}",
                "import this log by itself, with its own units.position, or bring all of them to one unit",
            )
    return None


def tare(seen: Evidence) -> Finding | None:
    """A vertical force that is always the same: the weight of the tool, or of the body, is in it."""
    gravity, g = seen.weight, float(np.linalg.norm(seen.weight))
    given = [one.wrench[..., 3:] for one in seen.recordings if one.wrench is not None and len(one.wrench)]
    if not g or len(given) < len(seen.recordings) or len(seen.scene.bodies) > 1:
        return None
    down = np.concatenate([one[:, 0] for one in given]) @ gravity / g
    mean, weight = float(down.mean()), seen.scene.bodies[0].mass * g
    if abs(mean) < HEAVY * weight or down.std() > CONSTANT * abs(mean):
        return None
    like = ", as much as the body weighs" if abs(abs(mean) / weight - 1) < ALIKE else ""
    return Finding(
        f"a force of {abs(mean):.3g} N {'along' if mean > 0 else 'against'} gravity acts in all frames{like}: was the "
        "sensor tared, and is the weight no part of the force?",
        "subtract what the sensor shows without contact; physid adds the weight by itself",
        wrong=False,
    )
