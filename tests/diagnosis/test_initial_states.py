"""Initial states guessed from poses: good enough to begin with, whatever happens soon after."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch

from physid.estimation.least_squares.initial_states import guess_initial_states
from physid.estimation.least_squares.jacobian import Directions
from physid.estimation.least_squares.settings import GuessSettings
from physid.estimation.prediction.segments import Segmentation
from physid.physics.rotations import exponential, multiply
from physid.scenes.setups.push import SCENE

SPEED = 0.8  # [m/s]
NEAR = 0.1  # of the speed
EVEN = SCENE.time_step * torch.arange(60, dtype=torch.float64)[None]


@pytest.mark.parametrize("brake", [0.0, 1.2, 12.0, 30.0])
def test_the_speed_of_a_body_that_may_stop_soon_is_among_the_guesses(brake: float) -> None:
    time = torch.arange(60, dtype=torch.float64) * SCENE.time_step
    until = time.clamp_max(SPEED / brake) if brake else time
    pose = torch.zeros(1, 60, 1, 7, dtype=torch.float64)
    pose[0, :, 0, 0] = SPEED * until - brake * until**2 / 2
    pose[..., 2], pose[..., 6] = SCENE.bodies[0].size[2] / 2, 1.0
    initial = guess_initial_states(pose, torch.ones(1, 60, 1), EVEN, Segmentation.equal(1, 60, 60), SCENE)
    assert bool(initial.resting.all())
    speeds = initial.twist[:, 0, 0, 3]
    assert float((speeds - SPEED).abs().min()) < NEAR * SPEED
    assert float(speeds.abs().min()) == 0, "rest is a guess, too: no slope leads back to it"


def test_a_falling_body_has_the_speed_of_its_fall_however_long_one_looks() -> None:
    time = torch.arange(60, dtype=torch.float64) * SCENE.time_step
    pose = torch.zeros(1, 60, 1, 7, dtype=torch.float64)
    pose[0, :, 0, 2] = 2 - 9.81 * time**2 / 2
    pose[..., 6] = 1.0
    scene = dataclasses.replace(SCENE, gravity=(0.0, 0.0, -9.81))
    initial = guess_initial_states(pose, torch.ones(1, 60, 1), EVEN, Segmentation.equal(1, 60, 60), scene)
    assert not bool(initial.resting.any())
    assert torch.allclose(initial.twist, torch.zeros_like(initial.twist), atol=1e-6)
    assert len(initial.pose) > len(GuessSettings().spans)


@pytest.mark.parametrize(
    ("gap", "lean", "lies"),
    [
        *((0.0, 0.0, True), (0.2, 0.0, True), (0.0, 0.02, True)),
        *((0.3, 0.0, False), (1.0, 0.0, False), (0.0, 0.04, False), (0.0, 0.4, False)),
    ],
)
def test_a_still_body_lies_on_the_ground_if_it_is_near_to_it_and_flat(gap: float, lean: float, lies: bool) -> None:
    _, width, height = SCENE.bodies[0].size
    turned = exponential(torch.tensor([lean, 0.0, 0.0], dtype=torch.float64))
    pose = torch.zeros(1, 60, 1, 7, dtype=torch.float64)
    pose[..., 2] = (
        height * math.cos(lean) + width * math.sin(lean)
    ) / 2 + gap * height  # over an edge, or another body
    pose[..., 3:] = turned
    initial = guess_initial_states(pose, torch.ones(1, 60, 1), EVEN, Segmentation.equal(1, 60, 60), SCENE)
    assert bool(initial.resting.all()) is lies


@pytest.mark.parametrize("falls", [False, True])
@pytest.mark.parametrize(
    ("share", "lies"), [(0.0, True), (0.4, True), (-0.4, True), (0.6, False), (-0.6, False), (3.0, False)]
)
def test_a_body_that_moves_up_or_down_by_half_a_free_fall_does_not_lie(share: float, lies: bool, falls: bool) -> None:
    frames = round(GuessSettings().spans[0] / SCENE.time_step)
    time, pose = EVEN[:, :frames], torch.zeros(1, frames, 1, 7, dtype=torch.float64)
    hop = (1.0 if falls else 0.0) * time * (time[0, -1] - time)  # thrown up, it is back after that time
    pose[0, :, 0, 2] = SCENE.bodies[0].size[2] / 2 + 9.81 / 2 * (share * time * time[0, -1] + hop)
    pose[..., 6] = 1.0
    segments = Segmentation.equal(1, frames, frames)
    initial = guess_initial_states(pose, torch.ones(1, frames, 1), time, segments, SCENE)
    assert bool(initial.resting.all()) is lies


def test_lost_frames_do_not_make_a_body_faster() -> None:
    kept = torch.randperm(240, generator=torch.Generator().manual_seed(0))[:60].sort().values
    time = (SCENE.time_step * kept.double())[None]
    pose = torch.zeros(1, 60, 1, 7, dtype=torch.float64)
    pose[0, :, 0, 0] = SPEED * time[0]
    pose[..., 2], pose[..., 6] = SCENE.bodies[0].size[2] / 2, 1.0
    initial = guess_initial_states(pose, torch.ones(1, 60, 1), time, Segmentation.equal(1, 60, 60), SCENE)
    assert torch.allclose(
        initial.twist[:-1, 0, 0, 3], torch.full((len(GuessSettings().spans),), SPEED, dtype=torch.float64), atol=1e-6
    )


@pytest.mark.parametrize(("late", "wild"), [(0, False), (5, False), (5, True)])
def test_a_body_that_soon_falls_does_not_lie_there_although_a_late_camera_shows_it_still(late: int, wild: bool) -> None:
    time = ((torch.arange(60) - late).clamp_min(0)).double() * SCENE.time_step
    height, half = 0.035, SCENE.bodies[0].size[2] / 2
    pose = torch.zeros(1, 60, 1, 7, dtype=torch.float64)
    pose[0, :, 0, 2] = half + (height - 9.81 * time**2 / 2).clamp_min(0)
    pose[..., 6] = 1.0
    lying = pose.clone()
    lying[..., 2] = half + height  # a camera that sees it too high, all the time
    if wild:
        lying[0, 20, 0, 2] -= 0.03
    for seen, rests in ((pose, False), (lying, True)):
        initial = guess_initial_states(seen, torch.ones(1, 60, 1), EVEN, Segmentation.equal(1, 60, 60), SCENE)
        assert bool(initial.resting.all()) is rests


@pytest.mark.parametrize(("lean", "level"), [(0.0, True), (0.002, True), (0.006, False), (0.3, False)])
def test_a_flying_body_is_level_while_it_leans_no_further_than_by_noise(lean: float, level: bool) -> None:
    noise, normal = 0.002, torch.tensor(SCENE.ground.normal, dtype=torch.float64)
    generator = torch.Generator().manual_seed(0)
    pose = torch.zeros(1, 60, 1, 7, dtype=torch.float64)
    pose[0, :, 0, 2] = 1 - 9.81 * EVEN[0] ** 2 / 2
    turn = noise * torch.randn(1, 60, 1, 3, generator=generator, dtype=torch.float64)
    turn[..., 0] += lean
    heading = exponential(torch.tensor([0.0, 0.0, 0.7], dtype=torch.float64))
    pose[..., 3:] = multiply(exponential(turn), heading.expand(1, 60, 1, 4))
    initial = guess_initial_states(pose, torch.ones(1, 60, 1), EVEN, Segmentation.equal(1, 60, 60), SCENE, noise)
    assert bool(initial.level.all()) is level
    free = Directions.of(normal, initial.resting, initial.level)
    assert not bool(free.lying.any()), "it flies"
    flat, twist = free.level(initial.pose, initial.twist)
    moved = not torch.equal(flat, initial.pose)
    assert moved is level
    assert torch.equal(twist[..., 3:], initial.twist[..., 3:])
    if level:
        assert torch.allclose(twist[..., :2], torch.zeros_like(twist[..., :2]), atol=1e-12)
        assert torch.allclose(flat[..., 3:5], torch.zeros_like(flat[..., 3:5]), atol=1e-9), "turned about z alone"


@pytest.mark.parametrize("height", [0.0, 0.022, 0.09])
def test_a_slow_camera_sees_that_a_body_is_dropped_from_however_high(height: float) -> None:
    scene = dataclasses.replace(SCENE, time_step=1 / 30)
    time, half = torch.arange(30, dtype=torch.float64) / 30, scene.bodies[0].size[2] / 2
    pose = torch.zeros(1, 30, 1, 7, dtype=torch.float64)
    pose[0, :, 0, 2] = half + (height - 9.81 * time**2 / 2).clamp_min(0)
    pose[..., 6] = 1.0
    initial = guess_initial_states(pose, torch.ones(1, 30, 1), time[None], Segmentation.equal(1, 30, 30), scene)
    assert bool(initial.resting.all()) is (height == 0)
    assert bool(initial.level.all())
