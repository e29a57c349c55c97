"""push: a block on a plane, pushed at its centre of mass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from physid.scenes.camera import Camera
from physid.scenes.scene import Body, Ground, Scene
from physid.scenes.setup import Excitation, Setup
from physid.scenes.setups.forces import AXES, arms, pieces, pieces_along, redrawn
from physid.scenes.setups.placing import WORKSPACE, anywhere, heading, moving, on_ground, planar_twist, span, upstream

TOP_VIEW = Camera(
    width=128, height=128, position=(0.0, 0.0, 6.0), target=(0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), fov_y=25.0
)
WAY = 1.3  # [m] how far the paper's pushes take the block, a little more than on average

SCENE = Scene(
    name="push",
    time_step=1 / 240,
    ground=Ground(),
    bodies=(Body("block", size=(0.3, 0.25, 0.2), mass=2.0, friction=0.12),),
    camera=TOP_VIEW,
    source="pybullet",
)


def paper(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Start at rest anywhere; push along one of +-x, +-y with 1 to 10 N, redrawn at each step."""
    direction = AXES[generator.integers(4)]
    x, y = upstream(generator, direction[:2], WAY)
    yaw = generator.uniform(-np.pi, np.pi)
    wrench = np.zeros((steps, 1, 6))
    wrench[:, 0, 3:] = redrawn(generator, direction, steps)
    pose = on_ground(scene.ground, x, y, yaw, scene.bodies[0].size[2])
    return Excitation(pose[None], np.zeros((1, 6)), wrench)


def rich(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Start with a velocity and a spin; push, step, reverse and coast at oblique headings."""
    x, y = generator.uniform(-WORKSPACE, WORKSPACE, 2)
    yaw = generator.uniform(-np.pi, np.pi)
    wrench = np.zeros((steps, 1, 6))
    wrench[:, 0, 3:] = pieces(generator, span(scene.ground), steps)
    pose = on_ground(scene.ground, x, y, yaw, scene.bodies[0].size[2])
    twist = planar_twist(generator, scene.ground, speed=1.5, spin=1.0)
    return Excitation(pose[None], twist[None], wrench)


def off_centre(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Do as `rich`, with pushes beside the centre of mass, under which the block turns as it slides."""
    drawn = rich(scene, generator, steps)
    wrench = drawn.wrench.copy()
    wrench[:, 0, :3] = arms(generator, wrench[:, 0, 3:], np.array(scene.ground.normal))
    return replace(drawn, wrench=wrench)


def straight(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Start at any speed along a line of any heading; push, step, reverse and coast along it, without a spin."""
    along = heading(generator, scene.ground)
    pose = anywhere(generator, scene.ground, scene.bodies[0].size[2])
    wrench = np.zeros((steps, 1, 6))
    wrench[:, 0, 3:] = pieces_along(generator, along, steps)
    return Excitation(pose[None], moving(along, generator.uniform(-1.2, 1.2))[None], wrench)


PUSH = Setup(SCENE, {"paper": paper, "rich": rich, "off_centre": off_centre, "straight": straight})
