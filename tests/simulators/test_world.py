"""PyBullet against closed forms of its own time stepping (semi-implicit Euler)."""

import dataclasses
import math

import numpy as np
import pytest

from physid.scenes import Body, Excitation, Ground, Scene
from physid.scenes.rotations import rotate
from physid.scenes.setup import REST_DEPTH
from physid.scenes.setups.placing import on_ground
from physid.simulators import Motion
from physid.simulators.bullet.world import simulate

TOLERANCE = 1e-8  # [m], [m/s]
H, G, STEPS = 1 / 240, 9.81, 300
BLOCK = Body("block", (0.3, 0.25, 0.2), mass=2.0, friction=0.12)


def scene_of(*bodies: Body, ground: Ground | None = None, gravity: float = G) -> Scene:
    return Scene("test", H, ground or Ground(), bodies or (BLOCK,), gravity=(0.0, 0.0, -gravity))


def run(scene: Scene, pose: object, twist: object = None, force: object = None, steps: int = STEPS) -> Motion:
    poses = np.atleast_2d(np.asarray(pose, dtype=float))
    wrench = np.zeros((steps, len(poses), 6))
    if force is not None:
        wrench[:, 0, 3:] = force
    start = np.zeros((len(poses), 6)) if twist is None else np.atleast_2d(np.asarray(twist, dtype=float))
    return simulate(scene, Excitation(poses, start, wrench))


def coulomb(force: np.ndarray, mass: float, friction: float) -> np.ndarray:
    """u = v + h f / m; v+ = u max(0, 1 - mu g h / |u|); p+ = p + h v+ (eq. (8) of the paper, in the plane)."""
    place, velocity, path = np.zeros(2), np.zeros(2), []
    for each in force:
        path.append(place)
        free = velocity + H * each / mass
        speed = np.linalg.norm(free)
        velocity = free * max(0.0, 1 - friction * G * H / speed) if speed else free
        place = place + H * velocity
    return np.array(path)


def test_a_free_body_falls_on_a_parabola_without_any_damping() -> None:
    motion = run(scene_of(), [0, 0, 20, 0, 0, 0, 1], [0, 0, 0, 3.0, -1.0, 2.0])
    step = np.arange(STEPS)[:, None]
    expected = [0, 0, 20] + H * step * [3.0, -1.0, 2.0] - [0, 0, G] * (H**2 * step * (step + 1) / 2)
    assert np.abs(motion.pose[:, 0, :3] - expected).max() < TOLERANCE


def test_a_tumbling_free_body_keeps_its_angular_momentum_up_to_the_order_of_the_step() -> None:
    motion = run(scene_of(gravity=0.0), [0, 0, 5, 0, 0, 0, 1], [3.0, 1.0, 5.0, 0, 0, 0])
    quaternion = motion.pose[:, 0, 3:]
    in_body = rotate(quaternion * [-1, -1, -1, 1], motion.twist[:, 0, :3])
    momentum = rotate(quaternion, BLOCK.moments() * in_body)
    assert np.abs(momentum - momentum[0]).max() < 0.01 * np.abs(momentum[0]).max()
    assert np.abs(in_body - in_body[0]).max() > 0.5  # it does tumble: the gyroscopic torque is there


@pytest.mark.parametrize("heading", [0.0, 20.0, 45.0, 90.0])
@pytest.mark.parametrize("yaw", [0.0, 0.3, 0.785])
def test_a_pushed_block_follows_the_friction_cone_at_any_heading(heading: float, yaw: float) -> None:
    generator = np.random.default_rng(0)
    along = np.array([math.cos(math.radians(heading)), math.sin(math.radians(heading)), 0.0])
    force = generator.uniform(1, 10, STEPS)[:, None] * along
    motion = run(scene_of(), on_ground(Ground(), 0, 0, yaw, 0.2), force=force)
    path = coulomb(force[:, :2], 2.0, 0.12)
    assert np.linalg.norm(path[-1]) > 1.0
    assert np.abs(motion.pose[:, 0, :2] - path).max() < TOLERANCE
    assert np.abs(motion.pose[:, 0, 2] - 0.1).max() < 2 * REST_DEPTH


def test_a_block_that_is_pushed_around_a_corner_and_back_follows_the_friction_cone() -> None:
    force = np.repeat([[8.0, 0, 0], [0, 6.0, 0], [-9.0, -5.0, 0]], 100, axis=0)
    motion = run(scene_of(), on_ground(Ground(), 0, 0, 0.4, 0.2), force=force)
    assert np.abs(motion.pose[:, 0, :2] - coulomb(force[:, :2], 2.0, 0.12)).max() < TOLERANCE


def test_a_block_pushed_with_less_than_friction_stays() -> None:
    motion = run(scene_of(), on_ground(Ground(), 0, 0, 0.3, 0.2), force=[1.5, 1.5, 0])
    assert np.abs(motion.twist).max() < TOLERANCE


@pytest.mark.parametrize(("degrees", "friction"), [(20.0, 0.15), (30.0, 0.0), (10.0, 0.3)])
def test_a_block_slides_down_an_incline_as_eq_9_says_or_sticks(degrees: float, friction: float) -> None:
    angle = math.radians(degrees)
    ground = Ground((math.sin(angle), 0.0, math.cos(angle)))
    block = dataclasses.replace(BLOCK, friction=friction)
    motion = run(scene_of(block, ground=ground), on_ground(ground, -1.0, 0.2, 0.6, 0.2))
    acceleration = max(0.0, G * (math.sin(angle) - friction * math.cos(angle)))
    step = np.arange(STEPS)
    way = np.linalg.norm(motion.pose[:, 0, :3] - motion.pose[0, 0, :3], axis=-1)
    assert np.abs(way - acceleration * H**2 * step * (step + 1) / 2).max() < TOLERANCE


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.8, 1.0])
def test_a_dropped_block_leaves_the_ground_with_the_restitution_times_its_speed(restitution: float) -> None:
    motion = run(scene_of(dataclasses.replace(BLOCK, restitution=restitution)), [0, 0, 0.2, 0, 0, 0, 1])
    speed = motion.twist[:, 0, 5]
    impact = int(np.argmax(np.diff(speed) > 1e-3))
    assert speed[impact] < -1.0
    assert speed[impact + 1] == pytest.approx(-restitution * speed[impact], abs=1e-6)


def test_a_block_without_restitution_comes_to_rest_on_the_ground() -> None:
    motion = run(scene_of(), [0, 0, 0.15, 0, 0, 0, 1])
    assert np.abs(motion.twist[-1]).max() < 1e-6
    assert motion.pose[-1, 0, 2] == pytest.approx(0.1, abs=2 * REST_DEPTH)


@pytest.mark.parametrize(("restitution", "after"), [(1.0, (0.0, 1.0)), (0.5, (0.25, 0.75)), (0.0, (0.5, 0.5))])
def test_equal_boxes_that_meet_head_on_exchange_momentum_by_newtons_law(
    restitution: float, after: tuple[float, float]
) -> None:
    bodies = (
        Body("one", (0.24, 0.24, 0.2), 1.0, 0.2, restitution),
        Body("two", (0.24, 0.24, 0.2), 1.0, 0.2, 1.0),
    )
    poses = [[0, 0, 5, 0, 0, 0, 1], [0.3, 0, 5, 0, 0, 0, 1]]
    motion = run(scene_of(*bodies, gravity=0.0), poses, [[0, 0, 0, 1.0, 0, 0], [0] * 6])
    assert motion.twist[-1, :, 3] == pytest.approx(after, abs=1e-6)


def test_a_simulation_does_not_depend_on_those_before_it() -> None:
    pose = on_ground(Ground(), 0, 0, 0.3, 0.2)
    first = run(scene_of(), pose, force=[8.0, 3.0, 0])
    run(scene_of(dataclasses.replace(BLOCK, restitution=0.9)), [0, 0, 1, 0.5, 0.5, 0.5, 0.5])
    again = run(scene_of(), pose, force=[8.0, 3.0, 0])
    assert np.array_equal(first.pose, again.pose)


def test_an_excitation_for_another_number_of_bodies_is_refused() -> None:
    with pytest.raises(ValueError, match="for the 1 bodies of test, got 2"):
        run(scene_of(), np.zeros((2, 7)))
