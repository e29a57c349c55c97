"""Noise, outliers and jolts are told from motion, whatever moves."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from physid.estimation.measurement.outliers import frame_weights, outlier_poses
from physid.estimation.measurement.sensor_noise import Noise, NoiseSettings, estimate_noise, noise_of_poses
from physid.estimation.prediction import Segmentation
from physid.estimation.segmented_fit import EventSettings
from physid.estimation.segmented_fit.events import find_events, find_jolts, smooth_path
from physid.estimation.segmented_fit.motion_phases import PHASES
from physid.physics.rotations import exponential
from physid.scenes import SETUPS

FRAMES, STEP, MANY = 120, 1 / 240, 40
NOISE = Noise(rotation=0.002, position=0.001)
TIME = STEP * torch.arange(FRAMES, dtype=torch.float64)[None]
SHARE = 0.05  # of an estimate from 8 x 118 frames


def moving(speed: float, acceleration: float = 3.0, trajectories: int = 8) -> Tensor:
    """Return poses (R, T, 1, 7) of a body that speeds along x."""
    time = torch.arange(FRAMES, dtype=torch.float64) * STEP
    pose = torch.zeros(trajectories, FRAMES, 1, 7, dtype=torch.float64)
    pose[..., 0, 0] = speed * time + acceleration * time**2 / 2
    pose[..., 6] = 1
    return pose


def noise(*shape: int) -> Tensor:
    white = torch.randn(*shape, 6, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return white * NOISE.spread()


@pytest.mark.parametrize("speed", [0.0, 2.0, 20.0])
def test_no_pose_of_a_smooth_motion_is_an_outlier_not_even_at_its_ends(speed: float) -> None:
    pose = moving(speed)
    assert not outlier_poses(pose, torch.ones(pose.shape[:-1])).any()


def test_exactly_the_poses_that_were_moved_are_outliers() -> None:
    pose = moving(1.0)
    pose[..., :3] += noise(8, FRAMES, 1)[..., 3:]
    moved = torch.zeros(8, FRAMES, 1, dtype=torch.bool)
    moved[0, 0], moved[2, 50], moved[5, FRAMES - 1], moved[6, 1] = True, True, True, True
    pose[..., 1] += 0.2 * moved
    assert torch.equal(outlier_poses(pose, torch.ones(pose.shape[:-1])), moved)


def test_a_bounce_at_a_slow_rate_makes_no_outlier_and_a_pose_that_was_moved_is_one() -> None:
    pose = moving(1.0, trajectories=16)
    time = torch.arange(FRAMES, dtype=torch.float64) / 30
    period = 0.4 + 0.02 * torch.arange(16, dtype=torch.float64)[:, None]  # elastic bounces, mostly between frames
    flight = torch.remainder(time, period)
    pose[..., 0, 2] = 9.81 / 2 * flight * (period - flight)
    turn = torch.zeros(16, FRAMES, 3, dtype=torch.float64)
    turn[..., 1] = 3.0 * (flight - period / 2).abs()  # the spin turns round at each of them, and half way
    pose[..., 0, 3:] = exponential(turn)
    pose[..., :3] += noise(16, FRAMES, 1)[..., 3:]
    there = torch.ones(pose.shape[:-1])
    assert not outlier_poses(pose, there)[:, 2:-2].any()  # at an end there is one side alone
    moved = torch.zeros(16, FRAMES, 1, dtype=torch.bool)
    moved[1, 20], moved[3, 60], moved[9, 90] = True, True, True
    pose[..., 1] += 0.5 * moved
    assert torch.equal(outlier_poses(pose, there) & moved, moved)


def test_the_noise_is_estimated_whatever_smooth_error_the_model_makes() -> None:
    time = torch.linspace(0, 1, FRAMES, dtype=torch.float64)[None, :, None, None]
    residual = noise(8, FRAMES, 1) + 0.05 * time**2
    found = estimate_noise(residual, torch.ones(8, FRAMES, 1))
    assert found.position == pytest.approx(NOISE.position, rel=SHARE)
    assert found.rotation == pytest.approx(NOISE.rotation, rel=SHARE)


def test_recordings_without_noise_are_given_what_integrators_differ_by() -> None:
    found = estimate_noise(torch.zeros(2, FRAMES, 1, 6, dtype=torch.float64), torch.ones(2, FRAMES, 1))
    assert (found.rotation, found.position) == NoiseSettings().least


@pytest.mark.parametrize("jitter", [0.0, 0.4])
def test_poses_alone_show_the_noise_at_any_times_and_though_an_axis_stands_still(jitter: float) -> None:
    drawn = torch.rand(MANY, FRAMES, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    time, white = STEP * (torch.arange(FRAMES) + jitter * drawn), noise(MANY, FRAMES, 1)
    pose = torch.zeros(MANY, FRAMES, 1, 7, dtype=torch.float64)
    pose[..., 0, 0] = 1.0 * time + 1.5 * time**2
    pose[..., :2] += white[..., 3:5]
    pose[..., 3:] = exponential(white[..., :3])
    found = noise_of_poses(pose, torch.ones(MANY, FRAMES, dtype=torch.bool), time if jitter else None)
    assert found.position == pytest.approx(NOISE.position, rel=SHARE)
    assert found.rotation == pytest.approx(NOISE.rotation, rel=SHARE)


def test_four_frames_of_a_throw_tell_its_noise_and_three_do_not() -> None:
    throw, white = moving(1.0, -9.81, trajectories=2000)[:, :4], noise(2000, 4, 1)
    seen = throw.clone()
    seen[..., :3] += white[..., 3:]
    seen[..., 3:] = exponential(white[..., :3])
    found = noise_of_poses(seen, torch.ones(2000, 4, dtype=torch.bool))
    assert found.position == pytest.approx(NOISE.position, rel=SHARE)
    assert found.rotation == pytest.approx(NOISE.rotation, rel=SHARE)
    exact = noise_of_poses(throw, torch.ones(2000, 4, dtype=torch.bool))
    assert (exact.rotation, exact.position) == NoiseSettings().least
    few = noise_of_poses(seen[:, :3], torch.ones(2000, 3, dtype=torch.bool))
    assert (few.rotation, few.position) == NoiseSettings().unseen


def test_an_outlying_frame_loses_its_weight_and_a_wrong_stretch_keeps_it() -> None:
    residual = torch.zeros(1, FRAMES, 1, 6, dtype=torch.float64)
    residual[0, 30, 0, 3] = 20 * NOISE.position
    residual[0, 60:, 0, 3] = 20 * NOISE.position
    weight = frame_weights(residual, torch.ones(1, FRAMES, 1), TIME, NOISE)[0, :, 0]
    assert weight[30] == 0
    assert (weight[63:] == 1).all()


def test_frames_that_leave_a_model_faster_and_faster_count_and_one_that_was_moved_among_them_does_not() -> None:
    count, end = 8, 8 / 30
    time = torch.linspace(0, end, count, dtype=torch.float64)[None]
    residual = noise(1, count, 1)
    residual[..., 5] += (
        3.5 / 2 * (time[..., None] - end / 2) ** 2
    )  # gravity that is 3.5 m/s^2 off, at 30 frames per second
    there = torch.ones(1, count, 1)
    assert (frame_weights(residual, there, time, NOISE) > 0).all()
    residual[0, 4, 0, 5] += 40 * NOISE.position
    weight = frame_weights(residual, there, time, NOISE)[0, :, 0]
    assert weight[4] == 0
    assert (weight > 0).sum() >= count - 2  # near an end one more frame may have no other to go on from


def test_a_fall_across_lost_frames_and_uneven_stamps_makes_no_outlier() -> None:
    drawn = torch.rand(16, FRAMES, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    time = (torch.arange(FRAMES) + 0.4 * drawn) / 30
    time[:, 40:] += 2 / 30  # two frames are lost
    pose = torch.zeros(16, FRAMES, 1, 7, dtype=torch.float64)
    fall = (time - 1.2).clamp(0, 0.4)  # rest, a fall with a drift, rest
    pose[..., 0, 2] = -9.81 / 2 * fall**2
    pose[..., 0, 0] = 3.0 * fall
    pose[..., 6] = 1
    there = torch.ones(pose.shape[:-1])
    assert not outlier_poses(pose, there, time).any()
    pose[4, 42, 0, 0] += 0.3
    assert outlier_poses(pose, there, time).nonzero().tolist() == [[4, 42, 0]]


def jolts(pose: Tensor, time: Tensor, noise: Noise = NOISE, smooth: Tensor | None = None) -> Tensor:
    """Return the jolted frames of one body, where every frame is there."""
    step = float(time.diff(dim=1).median())
    path = torch.zeros_like(pose[..., :6]) if smooth is None else smooth
    return find_jolts(pose, torch.ones(pose.shape[:-1]), time, path, noise, step, EventSettings())[:, :, 0]


def even(frames: int, step: float, trajectories: int = 1) -> Tensor:
    return (step * torch.arange(frames, dtype=torch.float64)).expand(trajectories, -1)


def test_a_jolt_is_found_where_it_is_and_only_there() -> None:
    still = moving(1.0)
    time = even(FRAMES, STEP, len(still))
    assert not jolts(still, time).any()
    hit = still.clone()
    late = (torch.arange(FRAMES, dtype=torch.float64) - 60).clamp_min(0) * STEP
    hit[..., 0, 0] -= 2.0 * late
    found = jolts(hit, time)
    assert found[:, 60].all()
    assert not found[:, :50].any()
    assert not found[:, 70:].any()


def falling(time: Tensor, speed: float = 3.0, bounce: float | None = None) -> tuple[Tensor, Tensor]:
    """Return poses and twists of a body that falls and drifts, and bounces at half of the time."""
    pose, twist = (torch.zeros(*time.shape, 1, size, dtype=torch.float64) for size in (7, 6))
    pose[..., 6] = 1
    pose[..., 0, 0], twist[..., 0, 3] = speed * time, speed
    pose[..., 0, 2], twist[..., 0, 5] = -9.81 / 2 * time**2, -9.81 * time
    if bounce is not None:
        after = (time - time[:, -1:] / 2).clamp_min(0)
        pose[..., 0, 2] += bounce * after
        twist[..., 0, 5] += bounce * (after > 0)
    return pose, twist


@pytest.mark.parametrize("rate", [30, 60, 120, 240])
@pytest.mark.parametrize("bounce", [None, 2.0])
def test_gravity_is_no_jolt_however_slow_the_camera_and_a_bounce_is(rate: int, bounce: float | None) -> None:
    """Between lines of 0.1 s, as of six frames at 60 per second, gravity changes a velocity by 1 m/s."""
    drawn = torch.rand(4, 40, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    kept = torch.rand(40, generator=torch.Generator().manual_seed(4)) > 0.1  # frames are lost, stamps uneven
    time = ((torch.arange(40) + 0.4 * drawn) / rate)[:, kept]
    pose, _ = falling(time, bounce=bounce)
    segments = Segmentation.equal(4, time.shape[1], 9)
    phases = torch.full(pose.shape[:-1], PHASES.index("free_fall"))
    # The model falls, but does not bounce, and starts anew in each segment.
    smooth = smooth_path(falling(time)[1] + 5.0 * segments.start[0], phases, time, segments)
    found = jolts(pose, time, smooth=smooth)
    assert bool(found.any(1).all()) == (bounce is not None)
    if bounce is not None:
        off = (time - time[:, -1:] / 2).abs() * rate
        assert float(off[found].max()) < max(3, 0.025 * rate) + 2


def test_what_a_model_moves_smoothly_is_neither_its_impacts_nor_where_it_starts_anew() -> None:
    time = even(41, 1 / 60, 2)
    _, twist = falling(time)
    segments = Segmentation.equal(2, 41, 10)
    jumping = twist + segments.position.eq(0).cumsum(1)[..., None, None] * torch.tensor([0, 0, 0, 0.7, 0, 0]).double()
    phases = torch.full(twist.shape[:-1], PHASES.index("free_fall"))
    phases[:, 20:23], jumping[:, 21:, 0, 5] = PHASES.index("impact"), jumping[:, 21:, 0, 5] + 4.0
    smooth = smooth_path(jumping, phases, time, segments)
    expected = torch.zeros_like(smooth)
    expected[..., 0, 5] = -9.81 / 2 * time**2
    assert torch.allclose(smooth, expected, atol=1e-9)
    assert not smooth_path(jumping, torch.full_like(phases, PHASES.index("impact")), time, segments).any()


def test_frames_that_are_not_there_make_no_jolt_and_hide_none() -> None:
    time = even(60, 1 / 60)
    pose, _ = falling(time, speed=4.0)
    pose[..., 0, 2] = 0.0
    present = torch.ones(pose.shape[:-1])
    for lost in (0, 17, 18, 40):
        present[0, lost], pose[0, lost] = 0, torch.tensor([9.0, 9.0, 9.0, 0.0, 0.0, 0.0, 1.0], dtype=torch.float64)
    there = torch.zeros_like(pose[..., :6])
    arguments = (time, there, NOISE, 1 / 60, EventSettings())
    assert not find_jolts(pose, present, *arguments).any()
    pose[0, 30:, 0, 1] += 2.0 * (time[0, 30:] - time[0, 30])
    found = find_jolts(pose, present, *arguments).nonzero()[:, 1]
    assert 30 in found
    assert int((found - 30).abs().max()) <= 2


@pytest.mark.parametrize(
    ("phase", "tilt", "event"),
    [
        ("slide_fast", 0.0, False),
        ("slide_fast", 0.3, True),  # tumbles on an edge
        ("free_fall", 0.3, False),
        ("impact", 0.0, True),
        ("contact_between_objects", 0.0, True),
    ],
)
def test_small_errors_grow_where_a_body_hits_or_stands_on_an_edge(phase: str, tilt: float, event: bool) -> None:
    pose = moving(1.0, trajectories=1)
    pose[..., 3:] = exponential(torch.tensor([tilt, 0.0, 0.0], dtype=torch.float64))
    phases, present = torch.full(pose.shape[:-1], PHASES.index(phase)), torch.ones(pose.shape[:-1])
    time, smooth = even(FRAMES, STEP), torch.zeros_like(pose[..., :6])
    found = find_events(phases, pose, present, time, smooth, NOISE, SETUPS[0].scene, EventSettings())
    assert found.shape == pose.shape[:2]
    assert found.all() if event else not found.any()


@pytest.mark.parametrize(("change", "jolted"), [(0.9, False), (1.15, True)])
@pytest.mark.parametrize(("spread", "step"), [(1e-9, 1 / 240), (1e-9, 1 / 30), (1e-3, 1 / 240), (1e-2, 1 / 240)])
def test_a_change_of_velocity_is_a_jolt_from_the_least_one_or_from_six_deviations_on(
    change: float, jolted: bool, spread: float, step: float
) -> None:
    settings = EventSettings()
    reach = max(settings.fewest, round(settings.reach / step))
    chance = spread * (24 / (reach**3 - reach)) ** 0.5 / step
    limit = max(settings.jolt_speed, settings.jolt * chance)
    pose = torch.zeros(1, FRAMES, 1, 7, dtype=torch.float64)
    pose[..., 6] = 1.0
    # Lines through the frames on either side of an edge between two frames differ by all of the change.
    after = (torch.arange(FRAMES, dtype=torch.float64) - 59.5).clamp_min(0) * step
    pose[0, :, 0, 1] = change * limit * after
    found = jolts(pose, even(FRAMES, step), Noise(1e-9, spread))
    assert bool(found.any()) is jolted
