"""MuJoCo against closed forms: what it does with rigid contacts, at steps of a millisecond."""

import dataclasses
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from physid.scenes import Body, Excitation, Ground, Scene, find_setup
from physid.scenes.camera import corners
from physid.scenes.rotations import conjugate, rotate
from physid.scenes.setup import REST_DEPTH
from physid.scenes.setups.placing import on_ground
from physid.simulators import Motion, find_simulator
from physid.simulators.mujoco.world import simulate_all

H, G, STEPS, SUBSTEPS = 1 / 60, 9.81, 61, 17
SLIDING = 1e-6  # [m] of a slide of a metre
BOUNCING = 5e-4  # [m] within a second: five bounces, each begun 0.3 micrometres too deep
IMPACT = 5e-5  # [m/s] of an impact at 1 m/s
LANDING = 1e-6  # [m] that a touch-down is missed by
BLOCK = Body("block", (0.3, 0.25, 0.2), mass=2.0, friction=0.12)


def scene_of(*bodies: Body, ground: Ground | None = None, gravity: float = G) -> Scene:
    return Scene("test", H, ground or Ground(), bodies or (BLOCK,), gravity=(0.0, 0.0, -gravity))


def run(scene: Scene, pose: object, twist: object = None, force: object = None, substeps: int = SUBSTEPS) -> Motion:
    poses = np.atleast_2d(np.asarray(pose, dtype=float))
    wrench = np.zeros((STEPS, len(poses), 6))
    if force is not None:
        wrench[:, 0, 3:] = force
    start = np.zeros((len(poses), 6)) if twist is None else np.atleast_2d(np.asarray(twist, dtype=float))
    return simulate_all(scene, [Excitation(poses, start, wrench)], substeps=substeps)[0]


def test_a_free_body_falls_on_a_parabola() -> None:
    motion = run(scene_of(), [0, 0, 20, 0, 0, 0, 1], [0, 0, 0, 3.0, -1.0, 2.0])
    time = H * np.arange(STEPS)[:, None]
    expected = [0, 0, 20] + time * [3.0, -1.0, 2.0] - [0, 0, 0.5 * G] * time**2
    assert np.abs(motion.pose[:, 0, :3] - expected).max() < 1e-9


def test_a_tumbling_free_body_keeps_energy_and_angular_momentum() -> None:
    motion = run(scene_of(gravity=0.0), [0, 0, 5, 0, 0, 0, 1], [30.0, 10.0, 40.0, 0, 0, 0])
    quaternion, spin = motion.pose[:, 0, 3:], motion.twist[:, 0, :3]
    in_body = rotate(conjugate(quaternion), spin)
    momentum = rotate(quaternion, BLOCK.moments() * in_body)
    energy = (BLOCK.moments() * in_body**2).sum(1)
    assert np.abs(momentum - momentum[0]).max() < 1e-5 * np.abs(momentum[0]).max()
    assert energy == pytest.approx(np.full(STEPS, energy[0]), rel=1e-5)
    assert np.abs(in_body - in_body[0]).max() > 5.0  # it does tumble


@pytest.mark.parametrize("friction", [0.0, 0.12, 0.8])
@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_a_sliding_block_stops_where_coulomb_says(friction: float, yaw: float) -> None:
    block = dataclasses.replace(BLOCK, friction=friction)
    motion = run(scene_of(block), on_ground(Ground(), 0, 0, yaw, 0.2), [0, 0, 0, 0.9, 1.2, 0])
    time = H * np.arange(STEPS)
    stop = np.minimum(time, 1.5 / (friction * G)) if friction else time
    way = 1.5 * stop - 0.5 * friction * G * stop**2
    assert np.abs(motion.pose[:, 0, :2] - way[:, None] * [0.6, 0.8]).max() < SLIDING
    assert np.abs(motion.pose[1:, 0, 2] - 0.1).max() < 2 * REST_DEPTH


def test_a_block_pushed_with_less_than_friction_stays_and_one_pushed_with_more_goes() -> None:
    place = on_ground(Ground(), 0, 0, 0.3, 0.2)
    limit = BLOCK.friction * BLOCK.mass * G
    stays = run(scene_of(), place, force=[0.99 * limit, 0, 0])
    goes = run(scene_of(), place, force=[1.5 * limit, 0, 0])
    assert np.abs(stays.pose[:, 0, :2]).max() < SLIDING
    expected = 0.5 * (0.5 * limit / BLOCK.mass) * (H * (STEPS - 1)) ** 2
    assert goes.pose[-1, 0, 0] == pytest.approx(expected, abs=SLIDING)


@pytest.mark.parametrize(("degrees", "friction"), [(20.0, 0.15), (30.0, 0.0), (10.0, 0.3)])
def test_a_block_slides_down_an_incline_or_sticks(degrees: float, friction: float) -> None:
    angle = math.radians(degrees)
    ground = Ground((math.sin(angle), 0.0, math.cos(angle)), offset=0.3)
    block = dataclasses.replace(BLOCK, friction=friction)
    motion = run(scene_of(block, ground=ground), on_ground(ground, -1.0, 0.2, 0.6, 0.2))
    way = np.linalg.norm(motion.pose[:, 0, :3] - motion.pose[0, 0, :3], axis=-1)
    acceleration = max(0.0, G * (math.sin(angle) - friction * math.cos(angle)))
    assert np.abs(way - 0.5 * acceleration * (H * np.arange(STEPS)) ** 2).max() < 2 * REST_DEPTH


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.9])
def test_a_block_that_falls_flat_bounces_by_newtons_law(restitution: float) -> None:
    block = dataclasses.replace(BLOCK, restitution=restitution)
    motion = run(scene_of(block), [0, 0, 0.25, 0, 0, 0, 1])
    begin, speed, height = math.sqrt(2 * 0.15 / G), restitution * math.sqrt(2 * G * 0.15), []
    starts, speeds = [0.0, begin], [0.0, speed]
    while speeds[-1] > 1e-6:
        starts, speeds = [*starts, starts[-1] + 2 * speeds[-1] / G], [*speeds, restitution * speeds[-1]]
    for time in H * np.arange(STEPS):
        last = np.searchsorted(starts, time, side="right") - 1
        since = time - starts[last]
        height.append(max(0.0, (0.15 if last == 0 else 0.0) + speeds[last] * since - 0.5 * G * since**2))
    assert np.abs(motion.pose[:, 0, 2] - 0.1 - height).max() < BOUNCING


def test_a_block_without_restitution_lands_and_stays_at_its_height() -> None:
    motion = run(scene_of(), [0, 0, 0.15, 0, 0, 0, 1])
    assert np.abs(motion.twist[-1]).max() < LANDING
    assert motion.pose[-1, 0, 2] == pytest.approx(0.1 - REST_DEPTH, abs=LANDING)


@pytest.mark.parametrize(("restitution", "after"), [(1.0, (0.0, 1.0)), (0.5, (0.25, 0.75)), (0.0, (0.5, 0.5))])
def test_equal_boxes_that_meet_head_on_exchange_momentum(restitution: float, after: tuple[float, float]) -> None:
    size = (0.24, 0.24, 0.2)
    bodies = Body("one", size, 1.0, 0.2, restitution), Body("two", size, 1.0, 0.2, 1.0)
    poses = [[0, 0, 5, 0, 0, 0, 1], [0.3, 0, 5, 0, 0, 0, 1]]
    motion = run(scene_of(*bodies, gravity=0.0), poses, [[0, 0, 0, 1.0, 0, 0], [0] * 6])
    assert motion.twist[-1, :, 3] == pytest.approx(after, abs=IMPACT)
    # They meet after 0.06 s.
    assert motion.pose[-1, :, 0] == pytest.approx([0.06 + 0.94 * after[0], 0.3 + 0.94 * after[1]], abs=1e-4)


@pytest.mark.parametrize(("name", "tolerance"), [("push", 2e-4), ("slide", 2e-4), ("toss", 1e-3), ("collide", 1e-3)])
@pytest.mark.slow
def test_half_the_step_changes_little(name: str, tolerance: float) -> None:
    setup = find_setup(name)
    drawn = [setup.draw(setup.scene, "paper", np.random.default_rng([5, k]), 150) for k in range(2)]
    coarse, fine = (simulate_all(setup.scene, drawn, substeps=count) for count in (5, 10))
    for one, other in zip(coarse, fine, strict=True):
        assert np.abs(one.pose[..., :3] - other.pose[..., :3]).max() < tolerance


def test_an_excitation_for_another_number_of_bodies_is_refused() -> None:
    with pytest.raises(ValueError, match="for the 1 bodies of test, got 2"):
        run(scene_of(), np.zeros((2, 7)))


def test_a_simulation_does_not_depend_on_those_before_it() -> None:
    setup = find_setup("toss")
    drawn = [setup.draw(setup.scene, "rich", np.random.default_rng([5, k]), 60) for k in range(3)]
    together = simulate_all(setup.scene, drawn, substeps=5)
    (alone,) = simulate_all(setup.scene, drawn[2:], substeps=5)
    assert np.array_equal(together[2].pose, alone.pose)
    assert np.array_equal(together[2].twist, alone.twist)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.slow
def test_tumbling_boxes_gain_no_energy_and_do_not_sink_in(seed: int) -> None:
    source = np.random.default_rng(seed)
    count = 1 + seed % 3
    bodies = [
        Body(f"box {k}", tuple(source.uniform(0.1, 0.4, 3)), source.uniform(0.5, 5), source.uniform(0, 1), 0.0)  # type: ignore[arg-type]
        for k in range(count)
    ]
    scene = scene_of(*bodies)
    turn = source.normal(size=(count, 4))
    place = np.stack([0.35 * np.arange(count), np.zeros(count), 0.5 + 0.3 * np.arange(count)], 1)
    pose = np.concatenate([place, turn / np.linalg.norm(turn, axis=1)[:, None]], 1)
    motion = run(scene, pose, np.concatenate([source.uniform(-5, 5, (count, 3)), source.uniform(-1, 1, (count, 3))], 1))
    in_body = rotate(conjugate(motion.pose[..., 3:]), motion.twist[..., :3])
    mass, moments = np.array([body.mass for body in bodies]), np.stack([body.moments() for body in bodies])
    energy = 0.5 * (mass * (motion.twist[..., 3:] ** 2).sum(-1)).sum(1) + 0.5 * (moments * in_body**2).sum((1, 2))
    energy += G * (mass * motion.pose[..., 2]).sum(1)
    assert np.diff(energy).max() < 1e-3 * np.ptp(energy)
    assert corners(motion.pose, scene.sizes)[..., 2].min() > -1e-4


@pytest.mark.slow
def test_a_motion_that_leaves_the_finite_numbers_is_refused_and_nothing_is_left_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="MuJoCo left the finite numbers in scene test; check masses, sizes and"):
        run(scene_of(), on_ground(Ground(), 0, 0, 0, 0.2), force=[1e200, 0, 0])
    assert not list(tmp_path.iterdir())


def test_without_mujoco_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for name in [name for name in sys.modules if name.startswith("physid.simulators.mujoco")]:
        monkeypatch.delitem(sys.modules, name)
    setup = find_setup("push")
    drawn = setup.draw(setup.scene, "paper", np.random.default_rng(0), 3)
    with pytest.raises(ValueError, match="needs the package mujoco-core, which is not installed; pip install"):
        find_simulator("mujoco").simulate(setup.scene, [drawn])
