"""collide: a block is pushed into a second one of known mass, made of the same material."""

from __future__ import annotations

import numpy as np

from physid.scenes.scene import Body, Ground, Scene
from physid.scenes.setup import Excitation, Setup
from physid.scenes.setups.forces import AXES, pieces, pieces_along, redrawn
from physid.scenes.setups.placing import heading, moving, on_ground, planar_twist, span, upstream
from physid.scenes.setups.push import TOP_VIEW

GAP = (0.03, 0.20)  # [m] free way before the blocks meet
SIDE = 0.06  # [m] how far the second block may stand aside of the line of the push
WAY = 1.5  # [m] how far ahead of the first block's start the second one ends, on average
TURN = 0.25  # [rad] how far a block may be turned out of the direction of the push

SCENE = Scene(
    name="collide",
    time_step=1 / 240,
    ground=Ground(),
    bodies=(
        Body("block", size=(0.3, 0.25, 0.2), mass=1.5, friction=0.1, material="wood"),
        Body("other", size=(0.25, 0.25, 0.2), mass=1.0, friction=0.1, material="wood"),
    ),
    camera=TOP_VIEW,
    source="pybullet",
)


def paper(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Start at rest, the second block ahead; push the first along one of +-x, +-y with 1 to 10 N, redrawn each step."""
    heading = int(generator.integers(4))
    pose = _pair(scene, generator, heading)
    wrench = np.zeros((steps, 2, 6))
    wrench[:, 0, 3:] = redrawn(generator, AXES[heading], steps)
    return Excitation(pose, np.zeros((2, 6)), wrench)


def rich(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Drive the first block at the second, which may move too; push, step, reverse and coast at oblique headings."""
    heading = int(generator.integers(4))
    pose = _pair(scene, generator, heading)
    twist = np.stack([planar_twist(generator, scene.ground, speed=0.4, spin=0.5) for _ in range(2)])
    twist[0, 3:] += generator.uniform(0.3, 1.5) * AXES[heading]
    wrench = np.zeros((steps, 2, 6))
    wrench[:, 0, 3:] = pieces(generator, span(scene.ground), steps)
    return Excitation(pose, twist, wrench)


def straight(scene: Scene, generator: np.random.Generator, steps: int) -> Excitation:
    """Drive the first block square at the second, which rests; push, step, reverse and coast along their line."""
    along = heading(generator, scene.ground)
    turn = float(np.arctan2(*(span(scene.ground) @ along)[::-1]))
    apart = 0.5 * (scene.bodies[0].size[0] + scene.bodies[1].size[0]) + generator.uniform(*GAP)
    behind = generator.uniform(0.4, 0.9)
    places = [(place * along, body) for place, body in zip((-behind, apart - behind), scene.bodies, strict=True)]
    pose = np.stack([on_ground(scene.ground, x, y, turn, body.size[2]) for (x, y, _), body in places])
    twist = np.stack([moving(along, generator.uniform(0.3, 1.5)), np.zeros(6)])
    wrench = np.zeros((steps, 2, 6))
    wrench[:, 0, 3:] = pieces_along(generator, along, steps)
    return Excitation(pose, twist, wrench)


def _pair(scene: Scene, generator: np.random.Generator, heading: int) -> np.ndarray:
    """Draw poses (2, 7): the first block anywhere, the second ahead of it, both roughly square to the push."""
    ahead, aside = AXES[heading, :2], AXES[(heading + 2) % 4, :2]
    length = 0.5 * (scene.bodies[0].size[0] + scene.bodies[1].size[0])
    turn = generator.uniform(-TURN, TURN, 2)
    # A turned block reaches further ahead by its half diagonal's share, so that the blocks never start overlapping.
    reach = length + sum(0.5 * body.size[1] * abs(np.sin(t)) for body, t in zip(scene.bodies, turn, strict=True))
    apart = reach + generator.uniform(*GAP)
    first = upstream(generator, ahead, WAY)
    second = first + apart * ahead + generator.uniform(-SIDE, SIDE) * aside
    yaw = np.arctan2(ahead[1], ahead[0]) + turn
    places = zip((first, second), yaw, scene.bodies, strict=True)
    return np.stack([on_ground(scene.ground, x, y, angle, body.size[2]) for (x, y), angle, body in places])


COLLIDE = Setup(SCENE, {"paper": paper, "rich": rich, "straight": straight}, impacts=True)
