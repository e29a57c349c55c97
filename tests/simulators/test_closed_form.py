"""Closed forms against laws that any motion obeys, and against the simulators that step."""

import dataclasses
import math

import numpy as np
import pytest
import torch

from physid.effects.actuation.force_gain import ForceGain
from physid.effects.contact.friction_drift import FrictionDrift
from physid.effects.dynamics.viscous_drag import ViscousDrag
from physid.scenes import Body, Excitation, Ground, Scene, find_setup
from physid.scenes.rotations import conjugate, rotate
from physid.scenes.setups.placing import on_ground
from physid.simulators import Motion, find_simulator
from physid.simulators.closed_form.flight import spin
from physid.simulators.closed_form.path import Path, time_of_meeting
from physid.simulators.closed_form.world import simulate_all

EXACT = 1e-12
FINE = 2e-5  # [m] between the closed form and MuJoCo: MuJoCo's bodies rest 1e-5 m deep
BOUNCED = 2e-4  # [m] after several bounces
FINE_BULLET = 5e-4  # [m] between the closed form and PyBullet, 16 steps per frame ...
FLYING_BULLET = 3e-3  # [m] ... and of a block that flies or bounces: a step of 0.26 ms at 5 m/s
H, G, STEPS = 1 / 60, 9.81, 91
BLOCK = Body("block", (0.3, 0.25, 0.2), mass=2.0, friction=0.2, restitution=0.5)


def run(scene: Scene, pose: object, twist: object = None, force: object = None, *effects: object) -> Motion:
    poses = np.atleast_2d(np.asarray(pose, dtype=float))
    wrench = np.zeros((STEPS, len(poses), 6))
    if force is not None:
        wrench[:, 0, 3:] = force
    start = np.zeros((len(poses), 6)) if twist is None else np.atleast_2d(np.asarray(twist, dtype=float))
    return simulate_all(scene, [Excitation(poses, start, wrench)], effects)[0]  # type: ignore[arg-type]


def scene_of(*bodies: Body, ground: Ground | None = None) -> Scene:
    return Scene("test", H, ground or Ground(), bodies or (BLOCK,))


@pytest.mark.parametrize("drag", [0.0, 1e-5, 1e-3, 0.7, 40.0])
def test_a_path_obeys_its_differential_equation(drag: float) -> None:
    path, time, step = Path(0.3, 1.2, -2.0, drag), 0.4, 1e-4
    slope = (path.place_at(time + step) - path.place_at(time - step)) / (2 * step)
    second = (path.speed_at(time + step) - path.speed_at(time - step)) / (2 * step)
    assert slope == pytest.approx(path.speed_at(time), abs=1e-5)
    assert second == pytest.approx(-2.0 - drag * path.speed_at(time), abs=1e-4)
    assert path.speed_at(path.time_of_speed(0.0)) == pytest.approx(0.0, abs=EXACT)


@pytest.mark.parametrize("drag", [0.0, 0.4])
@pytest.mark.parametrize(("speed", "pull"), [(2.0, 0.0), (0.5, 3.0), (3.0, -2.0), (0.0, 1.0)])
def test_two_paths_meet_at_the_first_time_at_which_they_touch(drag: float, speed: float, pull: float) -> None:
    one, other = Path(0.0, speed, pull, drag), Path(1.0, 0.1, 0.0, 0.5 * drag)
    time = time_of_meeting(one, other, 0.25, 5.0)
    gaps = [other.place_at(t) - one.place_at(t) - 0.25 for t in np.linspace(0, min(time, 5.0), 1000)[:-1]]
    assert min(gaps) > 0
    assert other.place_at(time) - one.place_at(time) == pytest.approx(0.25, abs=1e-11)


@pytest.mark.parametrize("rise", [2e-3, 0.5])
def test_a_short_bounce_ends_where_it_does_without_a_drag(rise: float) -> None:
    """A gap of zero that opens first is no meeting: it closes again after 2 v / g."""
    for drag in (0.0, 1e-6, 1e-3):
        time = time_of_meeting(Path(0.0, 0.0, 0.0), Path(0.0, rise, -9.81, drag), 0.0, 1.0)
        assert time == pytest.approx(2 * rise / 9.81, rel=0.1 * drag + 1e-7)
    closing = time_of_meeting(Path(0.0, 0.0, 0.0), Path(0.0, -rise, -9.81, 0.1), 0.0, 1.0)
    assert closing == pytest.approx(0.0, abs=1e-9)


def test_a_block_slides_stops_turns_back_and_stops_again_when_coulomb_says() -> None:
    force = np.repeat([[0.0, 0, 0], [-7.0, 0, 0], [0.0, 0, 0]], [40, 25, STEPS - 65], axis=0)
    motion = run(scene_of(), on_ground(Ground(), 0, 0, 0.4, 0.2), [0, 0, 0, 1.0, 0, 0], force)
    brake, pushed = 0.2 * G, 7.0 / 2.0 - 0.2 * G
    stops = 1.0 / brake
    assert stops < 40 * H
    back = pushed * 25 * H
    assert motion.twist[65, 0, 3] == pytest.approx(-back, abs=EXACT)
    expected = 1.0**2 / (2 * brake) - back**2 / (2 * pushed) - back**2 / (2 * brake)
    assert motion.pose[-1, 0, 0] == pytest.approx(expected, abs=EXACT)
    assert motion.twist[-1].any() == 0


def test_friction_and_drag_take_the_energy_that_is_lost() -> None:
    drag, speed = 0.8, 1.5
    motion = run(
        scene_of(),
        on_ground(Ground(), 0, 0, 0, 0.2),
        [0, 0, 0, speed, 0, 0],
        None,
        ViscousDrag(torch.tensor([drag], dtype=torch.float64)),
    )
    velocity, place = motion.twist[:, 0, 3], motion.pose[:, 0, 0]
    # m v' = -mu m g - c v, so that 1/2 m v^2 changes by -mu m g x - c int v^2, and m v by -mu m g t - c x.
    stop = math.log1p(drag * speed / (0.2 * 2.0 * G)) * 2.0 / drag
    assert np.argmax(velocity == 0) * H == pytest.approx(stop, abs=H)
    moving = velocity > 0
    time = H * np.arange(STEPS)[moving]
    lost = 2.0 * (speed - velocity[moving])
    assert lost == pytest.approx(0.2 * 2.0 * G * time + drag * place[moving], abs=1e-9)


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.9])
def test_a_flat_block_bounces_to_the_square_of_its_restitution_and_slides_by_the_impulses(restitution: float) -> None:
    block = dataclasses.replace(BLOCK, restitution=restitution)
    drop, speed = 0.15, 1.0
    motion = run(scene_of(block), [0, 0, 0.1 + drop, 0, 0, 0, 1], [0, 0, 0, speed, 0, 0])
    fall = math.sqrt(2 * drop / G)
    frame = int(fall / H) + 1
    since = frame * H - fall
    rubbed = 0.0 if restitution else 0.2 * G * since  # what does not bounce slides on
    assert motion.twist[frame, 0, 3] == pytest.approx(speed - 0.2 * (1 + restitution) * G * fall - rubbed, abs=EXACT)
    height = max(0.0, restitution * G * fall * since - 0.5 * G * since**2)
    assert motion.pose[frame, 0, 2] - 0.1 == pytest.approx(height, abs=1e-9)
    assert motion.pose[:, 0, 2].min() > 0.1 - 1e-12


@pytest.mark.parametrize("restitution", [0.0, 0.4, 1.0])
def test_a_collision_keeps_momentum_and_newtons_law(restitution: float) -> None:
    one = Body("one", (0.3, 0.25, 0.2), 1.5, 0.0, restitution)
    two = Body("two", (0.2, 0.25, 0.2), 1.0, 0.0, 1.0)
    pose = [on_ground(Ground(), x, 0, 0, 0.2) for x in (0.0, 0.35)]
    motion = run(scene_of(one, two), pose, [[0, 0, 0, 1.0, 0, 0], [0, 0, 0, 0.0, 0, 0]])
    before, after = motion.twist[0, :, 3], motion.twist[-1, :, 3]
    mass = np.array([1.5, 1.0])
    assert mass @ before == pytest.approx(mass @ after, abs=EXACT)
    assert after[1] - after[0] == pytest.approx(restitution, abs=EXACT)
    met, end = 0.1, H * (STEPS - 1)
    assert motion.pose[-1, :, 0] == pytest.approx([0.1, 0.35] + after * (end - met), abs=1e-10)


def test_two_blocks_are_pushed_on_together_and_part_where_the_second_glides_on() -> None:
    one = Body("one", (0.3, 0.25, 0.2), 1.0, 0.5, 0.0)
    two = Body("two", (0.3, 0.25, 0.2), 1.0, 0.1, 0.0)
    pose = [on_ground(Ground(), x, 0, 0, 0.2) for x in (0.0, 0.3)]
    force = np.repeat([[10.0, 0, 0], [0.0, 0, 0]], [30, STEPS - 30], axis=0)
    motion = run(scene_of(one, two), pose, None, force)
    together = (10.0 - 0.6 * G) / 2.0
    assert motion.twist[30, :, 3] == pytest.approx([together * 30 * H] * 2, abs=EXACT)
    speed = together * 30 * H
    way = motion.pose[-1, :, 0] - motion.pose[30, :, 0]
    assert way[0] == pytest.approx(speed**2 / (2 * 0.5 * G), abs=1e-9)
    glide = min(H * (STEPS - 31), speed / (0.1 * G))
    assert way[1] == pytest.approx(speed * glide - 0.5 * 0.1 * G * glide**2, abs=1e-9)


@pytest.mark.slow
def test_a_free_rotation_keeps_energy_and_angular_momentum_for_twenty_seconds() -> None:
    moments, times = np.array([0.01, 0.02, 0.025]), np.linspace(0, 20, 201)
    turned, angular = spin(np.array([0.0, 0, 0, 1]), np.array([1.0, 49.0, 2.0]), moments, times)
    in_body = rotate(conjugate(turned), angular)
    momentum, energy = rotate(turned, moments * in_body), (moments * in_body**2).sum(1)
    assert np.abs(momentum - momentum[0]).max() < 1e-7 * np.linalg.norm(momentum[0])
    assert np.abs(energy / energy[0] - 1).max() < 1e-7
    assert in_body[:, 1].min() < 0  # it tumbles about its middle axis


CASES = [("push", "paper"), ("push", "straight"), ("slide", "paper"), ("slide", "straight"), ("collide", "straight"),
         ("toss", "straight"), ("toss", "flight")]  # fmt: skip


@pytest.mark.parametrize(("name", "protocol"), CASES)
@pytest.mark.slow
def test_simulators_that_step_agree_with_the_closed_form(name: str, protocol: str) -> None:
    setup = find_setup(name)
    drawn = [setup.draw(setup.scene, protocol, np.random.default_rng([7, k]), 120) for k in range(2)]
    exact = find_simulator("closed_form").simulate(setup.scene, drawn)
    stepped = find_simulator("mujoco").simulate(setup.scene, drawn)
    bullet = find_simulator("pybullet").simulate(setup.scene, drawn, substeps=16)
    for one, other, third in zip(exact, stepped, bullet, strict=True):
        bounces = protocol == "straight" and name == "toss"
        assert np.abs(one.pose[..., :3] - other.pose[..., :3]).max() < (BOUNCED if bounces else FINE)
        if name != "collide":  # PyBullet's friction between blocks turns with the footprint (ADR 2)
            apart = FINE_BULLET if name != "toss" else FLYING_BULLET
            assert np.abs(one.pose[..., :3] - third.pose[..., :3]).max() < apart


def test_actuation_acts_before_the_motion_is_computed() -> None:
    place = on_ground(Ground(), 0, 0, 0.3, 0.2)
    gained = run(scene_of(), place, None, [8.0, 0, 0], ForceGain(torch.tensor([0.25], dtype=torch.float64)))
    assert np.array_equal(gained.pose, run(scene_of(), place, None, [10.0, 0, 0]).pose)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0, 0, 0.1, 0, 0, 0, 1], [0, 0, 0, 1, 0, 0], [0.0, 1.0, 0]), "different headings; use a protocol such as"),
        (([0, 0, 1.0, 0.1, 0, 0, 0.995], None, None), "comes to the ground at"),
        (([0, 0, 0.1, 0, 0, 0, 1], [0, 0, 1.0, 1, 0, 0], None), "comes to the ground at 0 s"),
        (([0, 0, 0.1, 0, 0, 0, 1], None, None, FrictionDrift()), "not friction_drift"),
    ],
)
def test_what_has_no_closed_form_is_refused_and_the_message_says_why(arguments: tuple, message: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(ValueError, match=message):
        run(scene_of(), *arguments)
