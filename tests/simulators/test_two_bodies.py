"""Two blocks that push each other: PyBullet against the PhysicsLayer, and against Coulomb's law."""

import itertools

import numpy as np
import pybullet
import pytest
import torch

from physid.physics import Parameters, PhysicsLayer, State, World
from physid.scenes import Excitation, find_setup
from physid.scenes.setups.placing import on_ground
from physid.simulators.bullet.engine import Engine
from physid.simulators.bullet.world import simulate

AGREEMENT = 0.03  # accepted difference of the turn between the engines, relative
STEPS = 40
SCENE = find_setup("collide").scene


def off_centre() -> Excitation:
    """Two blocks side by side that slide, the first pushed past the middle of the second."""
    pose = np.stack([on_ground(SCENE.ground, 0, 0, 0, 0.2), on_ground(SCENE.ground, 0.275, 0.06, 0, 0.2)])
    twist = np.zeros((2, 6))
    twist[:, 3] = 0.5
    wrench = np.zeros((STEPS, 2, 6))
    wrench[:, 0, 3] = 6.0
    return Excitation(pose, twist, wrench)


def test_blocks_pushed_past_each_others_middle_turn_as_in_the_layer() -> None:
    start = off_centre()

    def batch(values: object) -> torch.Tensor:
        return torch.as_tensor(np.array(values, dtype=float))[None]

    bodies = SCENE.bodies
    parameters = Parameters.of_boxes(
        batch(SCENE.sizes), batch([b.mass for b in bodies]), batch([b.friction for b in bodies])
    )
    layer = PhysicsLayer(World(time_step=SCENE.time_step))
    rollout = layer.rollout(State(batch(start.pose), batch(start.twist)), batch(start.wrench[:-1]), parameters)
    ours, theirs = rollout.pose[0].numpy(), simulate(SCENE, start).pose
    turn = 2 * theirs[-1, :, 5]
    assert np.abs(turn).min() > 0.01
    assert 2 * ours[-1, :, 5] == pytest.approx(turn, rel=AGREEMENT)


def test_no_contact_transmits_more_friction_than_coulomb_allows() -> None:
    start = off_centre()
    with Engine(SCENE, SCENE.time_step) as engine:
        engine.set_state(start.pose, start.twist)
        largest = 0.0
        for load in start.wrench.tolist():
            pose, _ = engine.read()
            engine.push(pose, load)
            engine.step()
            for one, other in itertools.combinations([engine._ground, *engine._bodies], 2):
                coefficient = 0.1 if one == engine._ground else 0.01
                for point in pybullet.getContactPoints(one, other, physicsClientId=engine._client):
                    tangential, normal = float(np.hypot(point[10], point[12])), point[9]
                    largest = max(largest, tangential - coefficient * normal)
    assert largest < 1e-6  # [N]


def test_overlaps_of_an_impact_are_taken_back_without_velocity() -> None:
    pose = np.stack([on_ground(SCENE.ground, 0, 0, 0, 0.2), on_ground(SCENE.ground, 0.30, 0, 0, 0.2)])
    twist = np.zeros((2, 6))
    twist[0, 3] = 1.5
    motion = simulate(SCENE, Excitation(pose, twist, np.zeros((120, 2, 6))))
    gap = motion.pose[:, 1, 0] - motion.pose[:, 0, 0] - 0.275
    meeting = int(np.argmax(gap < 0))
    together = motion.twist[meeting + 2 :, :, 3]
    assert gap[meeting] < -1e-4
    assert gap[-1] == pytest.approx(0.0, abs=3e-5)
    assert np.abs(together[:, 0] - together[:, 1]).max() < 1e-4
