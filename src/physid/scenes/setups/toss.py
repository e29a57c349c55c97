"""toss: a block is thrown onto the ground."""

from __future__ import annotations

import numpy as np

from physid.scenes.scene import Body, Ground, Scene
from physid.scenes.setup import Excitation, Setup
from physid.scenes.setups.forces import pieces
from physid.scenes.setups.placing import anywhere, heading, moving
from physid.scenes.setups.push import TOP_VIEW

SCENE = Scene(
    name="toss",
    time_step=1 / 240,
    ground=Ground(),
    bodies=(Body("block", size=(0.3, 0.25, 0.25), mass=1.0, friction=0.2, restitution=0.3),),
    camera=TOP_VIEW,
    source="pybullet",
)


def paper(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Throw at any heading and any attitude, tumbling; no force but gravity."""
    pose, twist = _throw(generator)
    return Excitation(pose[None], twist[None], np.zeros((steps, 1, 6)))


def rich(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Throw as before, and push the flying, bouncing, sliding block: steps, reversals and coasting, level with it."""
    pose, twist = _throw(generator)
    wrench = np.zeros((steps, 1, 6))
    wrench[:, 0, 3:] = 0.5 * pieces(generator, np.eye(3)[:2], steps)
    return Excitation(pose[None], twist[None], wrench)


def straight(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Fall flat, bounce and slide on along a line of any heading, without a spin; no force but gravity."""
    pose = anywhere(generator, scene.ground, scene.bodies[0].size[2])
    pose[:3] += generator.uniform(0.05, 0.25) * np.array(scene.ground.normal)
    twist = moving(heading(generator, scene.ground), generator.uniform(-1.2, 1.2))
    return Excitation(pose[None], twist[None], np.zeros((steps, 1, 6)))


def flight(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Throw up so high that the block does not come down before the end, with any spin; no force but gravity."""
    pose, twist = _throw(generator)
    pose[:3] += 0.2 * np.array(scene.ground.normal)
    twist[5] = 0.5 * abs(scene.gravity[2]) * (steps - 1) * scene.time_step + generator.uniform(0.0, 0.5)
    return Excitation(pose[None], twist[None], np.zeros((steps, 1, 6)))


def _throw(generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw a pose (7,) above the workspace and a twist (6,)."""
    position = np.append(generator.uniform(-0.9, 0.9, 2), generator.uniform(0.3, 0.7))
    attitude = generator.normal(size=4)
    heading, speed = generator.uniform(0, 2 * np.pi), generator.uniform(0.2, 1.2)
    velocity = np.array([speed * np.cos(heading), speed * np.sin(heading), generator.uniform(-0.5, 1.0)])
    pose = np.concatenate([position, attitude / np.linalg.norm(attitude)])
    return pose, np.concatenate([generator.uniform(-5.0, 5.0, 3), velocity])


PROTOCOLS = {"paper": paper, "rich": rich, "straight": straight, "flight": flight}
TOSS = Setup(SCENE, PROTOCOLS, leaves_ground=True, impacts=True)
