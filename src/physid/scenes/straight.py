"""Motions along one line, that have a closed form: no block turns, and no force acts aside of the line."""

from __future__ import annotations

import numpy as np

from physid.scenes.forces import pieces
from physid.scenes.placing import WORKSPACE, on_ground, span
from physid.scenes.scene import Scene
from physid.scenes.setup import Excitation

Array = np.ndarray
GAP = (0.03, 0.20)  # [m] free way before two blocks meet
DROP = (0.05, 0.25)  # [m] height that a block falls from
SPEED = 1.2  # [m/s] fastest start


def push(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Start at any speed along a line of any heading; push, step, reverse and coast along it."""
    along = _heading(scene, generator)
    return _single(scene, generator, along, generator.uniform(-SPEED, SPEED), _forces(generator, along, steps))


def slide(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Start up or down the slope; push, step, reverse and coast along it."""
    along = span(scene.ground)[0]
    force = 0.6 * _forces(generator, along, steps)
    return _single(scene, generator, along, generator.uniform(-1.6, 0.4), force)


def collide(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Drive the first block square at the second; push, step, reverse and coast."""
    along, normal = _heading(scene, generator), np.array(scene.ground.normal)
    yaw = float(np.arctan2(along @ span(scene.ground)[1], along @ span(scene.ground)[0]))
    apart = 0.5 * (scene.bodies[0].size[0] + scene.bodies[1].size[0]) + generator.uniform(*GAP)
    # The first block starts somewhat behind the middle.
    behind = generator.uniform(0.4, 0.9)
    pose = np.stack([_at(scene, k, (k * apart - behind) * along, yaw) for k in range(2)])
    twist = np.zeros((2, 6))
    twist[0, 3:] = generator.uniform(0.3, 1.5) * along
    force = np.zeros((steps, 2, 6))
    force[:, 0, 3:] = _forces(generator, along, steps)
    assert abs(along @ normal) < 1e-12
    return Excitation(pose, twist, force)


def toss(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Fall flat, bounce and slide on along a line of any heading; no force but gravity."""
    along = _heading(scene, generator)
    found = _single(scene, generator, along, generator.uniform(-SPEED, SPEED), np.zeros((steps, 3)))
    found.pose[0, :3] += generator.uniform(*DROP) * np.array(scene.ground.normal)
    return found


def flight(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Throw up so high that it does not come down before the end, with any spin; no force but gravity."""
    time = (steps - 1) * scene.time_step
    gravity = float(np.linalg.norm(scene.gravity))
    attitude = generator.normal(size=4)
    heading, speed = generator.uniform(0, 2 * np.pi), generator.uniform(0.0, 0.5)
    velocity = [speed * np.cos(heading), speed * np.sin(heading), 0.5 * gravity * time + generator.uniform(0.0, 0.5)]
    place = [*generator.uniform(-0.5, 0.5, 2), generator.uniform(0.5, 0.8)]
    pose = np.concatenate([place, attitude / np.linalg.norm(attitude)])
    twist = np.concatenate([generator.uniform(-5.0, 5.0, 3), velocity])
    return Excitation(pose[None], twist[None], np.zeros((steps, 1, 6)))


def _heading(scene: Scene, generator: np.random.Generator) -> Array:
    """Draw a direction (3,) in the ground's plane."""
    angle = generator.uniform(0, 2 * np.pi)
    return np.asarray(np.array([np.cos(angle), np.sin(angle)]) @ span(scene.ground))


def _forces(generator: np.random.Generator, along: Array, steps: int) -> Array:
    """Draw forces (T, 3) along a line: those of the rich protocol, seen from it."""
    return pieces(generator, np.stack([along, 0 * along]), steps)


def _single(scene: Scene, generator: np.random.Generator, along: Array, speed: float, force: Array) -> Excitation:
    """Put one block on the ground, at any heading, that moves along a line."""
    place = generator.uniform(-WORKSPACE, WORKSPACE, 2) @ span(scene.ground)
    pose = _at(scene, 0, place, generator.uniform(-np.pi, np.pi))
    wrench = np.zeros((len(force), 1, 6))
    wrench[:, 0, 3:] = force
    return Excitation(pose[None], np.concatenate([np.zeros(3), speed * along])[None], wrench)


def _at(scene: Scene, body: int, place: Array, yaw: float) -> Array:
    """Return the pose (7,) of a body that lies flat."""
    return on_ground(scene.ground, float(place[0]), float(place[1]), yaw, scene.bodies[body].size[2])
