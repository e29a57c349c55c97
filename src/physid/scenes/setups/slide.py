"""slide: a block falls freely onto an incline and slides down."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from physid.scenes.scene import Body, Ground, Scene
from physid.scenes.setup import Excitation, Setup
from physid.scenes.setups.forces import arms, pieces, pieces_along
from physid.scenes.setups.placing import WORKSPACE, anywhere, moving, on_ground, planar_twist, span, upstream
from physid.scenes.setups.push import TOP_VIEW

ANGLE = math.radians(20.0)
DOWNHILL = np.array([1.0, 0.0])
WAY = 1.5  # [m] how far the block slides, seen from above
FALL = (15, 37)  # [steps] shortest and longest free fall: 2 to 12 cm

SCENE = Scene(
    name="slide",
    time_step=1 / 240,
    ground=Ground(normal=(math.sin(ANGLE), 0.0, math.cos(ANGLE))),
    bodies=(Body("block", size=(0.3, 0.25, 0.2), mass=2.0, friction=0.15),),
    camera=TOP_VIEW,
    source="pybullet",
)


def paper(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Fall from rest, parallel to the incline at any heading, and slide; no force but gravity.

    The fall takes n whole steps, g dt^2 n (n + 1) / 2 deep: PyBullet looks for contacts between steps only, and a block
    that came down within one would sink in by up to a step's way.
    """
    x, y = upstream(generator, DOWNHILL, WAY)
    pose = on_ground(scene.ground, x, y, generator.uniform(-np.pi, np.pi), scene.bodies[0].size[2])
    count = int(generator.integers(FALL[0], FALL[1] + 1))
    pose[2] += 0.5 * abs(scene.gravity[2]) * scene.time_step**2 * count * (count + 1)
    return Excitation(pose[None], np.zeros((1, 6)), np.zeros((steps, 1, 6)))


def rich(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Start on the incline, mostly uphill, with a spin; push, step, reverse and coast at oblique headings."""
    x, y = generator.uniform(-WORKSPACE, WORKSPACE, 2)
    pose = on_ground(scene.ground, x, y, generator.uniform(-np.pi, np.pi), scene.bodies[0].size[2])
    across = span(scene.ground)
    twist = planar_twist(generator, scene.ground, speed=0.8, spin=1.0)
    twist[3:] -= generator.uniform(0.4, 1.6) * across[0]
    wrench = np.zeros((steps, 1, 6))
    wrench[:, 0, 3:] = 0.6 * pieces(generator, across, steps)
    return Excitation(pose[None], twist[None], wrench)


def off_centre(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Do as `rich`, with pushes beside the centre of mass, under which the block turns as it slides."""
    drawn = rich(scene, generator, steps)
    wrench = drawn.wrench.copy()
    wrench[:, 0, :3] = arms(generator, wrench[:, 0, 3:], np.array(scene.ground.normal))
    return replace(drawn, wrench=wrench)


def straight(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Start up or down the slope; push, step, reverse and coast along it, without a spin."""
    down = span(scene.ground)[0]
    pose = anywhere(generator, scene.ground, scene.bodies[0].size[2])
    wrench = np.zeros((steps, 1, 6))
    wrench[:, 0, 3:] = 0.6 * pieces_along(generator, down, steps)
    return Excitation(pose[None], moving(down, generator.uniform(-1.6, 0.4))[None], wrench)


SLIDE = Setup(SCENE, {"paper": paper, "rich": rich, "off_centre": off_centre, "straight": straight})
