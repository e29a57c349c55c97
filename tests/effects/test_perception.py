"""Effects of perception against closed forms."""

import math

import pytest
import torch
from torch import Tensor

from physid.effects import from_values
from physid.effects.probe import TIME_STEP, draw_probe
from physid.effects.resampling import at_times
from physid.physics.rotations import angle_between, exponential

TOLERANCE, G = 1e-12, 9.81
PROBE = draw_probe()


def seen(name: str, values: dict[str, float], pose: Tensor = PROBE.pose) -> Tensor:
    """Return what the camera reports."""
    return from_values(name, values).observe(pose, TIME_STEP * torch.arange(pose.shape[1]).double()[None])


def steady(frames: Tensor) -> Tensor:
    """Return the poses of a body that moves and turns at constant rates, at fractions of frames; (1, T, 1, 7)."""
    position = frames[:, None] * torch.tensor([0.01, -0.02, 0.005]).double()
    turn = exponential(frames[:, None] * torch.tensor([0.02, 0.01, -0.03]).double())
    return torch.cat([position, turn], -1)[None, :, None]


FRAMES = torch.arange(12.0).double()


def test_a_length_scale_moves_all_away_from_the_origin() -> None:
    assert torch.allclose(seen("length_scale", {"change": 0.1})[..., :3], 1.1 * PROBE.pose[..., :3])


def test_a_turned_camera_turns_positions_and_attitudes() -> None:
    pose = seen("camera_yaw", {"angle": 0.3})
    x, y, z = PROBE.pose[..., :3].unbind(-1)
    c, s = math.cos(0.3), math.sin(0.3)
    assert torch.allclose(pose[..., :3], torch.stack([c * x - s * y, s * x + c * y, z], -1))
    assert torch.allclose(angle_between(pose[..., 3:], PROBE.pose[..., 3:]), torch.tensor(0.3).double())


def test_a_displaced_camera_shifts_positions() -> None:
    shift = seen("camera_offset", {"x": 0.1, "z": -0.2}) - PROBE.pose
    assert torch.allclose(shift, torch.tensor([0.1, 0, -0.2, 0, 0, 0, 0]).double().expand_as(shift))


@pytest.mark.parametrize("frames", [0.3, 1.0, 2.7])
def test_latency_reports_the_pose_of_an_earlier_time(frames: float) -> None:
    late = seen("observation_latency", {"latency": frames * TIME_STEP}, steady(FRAMES))
    assert torch.allclose(late, steady(FRAMES - frames), atol=TOLERANCE)


@pytest.mark.parametrize("change", [-0.15, 0.08])
def test_a_wrong_clock_stretches_time(change: float) -> None:
    wanted = steady(FRAMES * (1 + change))
    assert torch.allclose(seen("clock_rate", {"change": change}, steady(FRAMES)), wanted)
    later = from_values("clock_rate", {"change": change}).observe(steady(FRAMES), 7.0 + TIME_STEP * FRAMES[None])
    assert torch.allclose(later, wanted, atol=1e-9), "it goes wrong from the first frame on"


def test_poses_between_frames_lie_on_the_shortest_way_and_meet_at_the_frames() -> None:
    pose = PROBE.pose[:1]
    whole = torch.arange(pose.shape[1]).double()
    assert torch.equal(at_times(pose, FRAMES[None, : pose.shape[1]], whole[None]), pose)
    before, after = (at_times(pose, FRAMES[None, : pose.shape[1]], (whole + shift)[None]) for shift in (-1e-9, 1e-9))
    assert torch.allclose(before, after, atol=1e-8)


def test_poses_at_uneven_times_are_those_of_a_steady_motion() -> None:
    uneven = (FRAMES + 0.3 * torch.rand(12, generator=torch.Generator().manual_seed(0), dtype=torch.float64))[None]
    between = at_times(steady(uneven[0]), uneven, FRAMES[None] + 0.5)
    wanted = steady(FRAMES + 0.5)
    assert torch.allclose(between[..., :3], wanted[..., :3], atol=TOLERANCE)
    assert angle_between(between[..., 3:], wanted[..., 3:]).max() < 1e-7


def falling(time: Tensor, bounce: float = torch.inf) -> Tensor:
    """Return a body that falls, turns faster and faster about one axis, and bounces at a time; shape (1, T, 1, 7)."""
    late = (time - bounce).clamp_min(0)
    place = torch.stack([0.3 * time, 0 * time, 2.0 - 0.5 * G * time**2 + late * 2.0 * G * min(bounce, 1e3)], -1)
    turn = torch.stack([0 * time, 0.2 * time + 0.01 * time**2 - 0.4 * late, 0 * time], -1)
    return torch.cat([place, exponential(turn)], -1)[None, :, None]


def test_a_free_fall_with_a_changing_spin_is_exact_between_uneven_frames() -> None:
    uneven = FRAMES + 0.3 * torch.rand(12, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    wanted = torch.linspace(float(uneven[0]), float(uneven[-1]), 60, dtype=torch.float64)
    between, true = at_times(falling(uneven), uneven[None], wanted[None]), falling(wanted)
    assert torch.allclose(between[..., :3], true[..., :3], atol=TOLERANCE)
    assert angle_between(between[..., 3:], true[..., 3:]).max() < 1e-7


@pytest.mark.parametrize("beyond", [0.3, 1.7])
def test_beyond_both_ends_a_body_keeps_the_mean_velocity_of_the_outermost_frames(beyond: float) -> None:
    pose = falling(FRAMES)[..., :3]
    wanted = torch.tensor([[-beyond, 11 + beyond]], dtype=torch.float64)
    ends = at_times(falling(FRAMES), FRAMES[None], wanted)[..., :3]
    assert torch.allclose(ends[:, 0], pose[:, 0] - beyond * (pose[:, 1] - pose[:, 0]), atol=TOLERANCE)
    assert torch.allclose(ends[:, 1], pose[:, -1] + beyond * (pose[:, -1] - pose[:, -2]), atol=TOLERANCE)


def test_the_gradient_in_time_is_the_velocity_also_at_the_frames() -> None:
    time = torch.linspace(0.5, 10.5, 21, dtype=torch.float64).requires_grad_()
    at_times(falling(FRAMES), FRAMES[None], time[None])[..., 2].sum().backward()
    assert time.grad is not None
    assert torch.allclose(time.grad, -G * time.detach(), atol=1e-9)


def test_a_bounce_bends_no_frame_but_those_that_it_lies_between() -> None:
    bounce = 5.3
    wanted = torch.linspace(0.0, 11.0, 111, dtype=torch.float64)
    between, true = at_times(falling(FRAMES, bounce), FRAMES[None], wanted[None]), falling(wanted, bounce)
    elsewhere = (wanted <= 5) | (wanted >= 6)
    off = (between - true)[0, :, 0, :3].norm(dim=-1)
    assert float(off[elsewhere].max()) < TOLERANCE
    assert angle_between(between[:, elsewhere, :, 3:], true[:, elsewhere, :, 3:]).max() < 1e-7
    assert float(off.max()) > 0.1


def test_frames_that_fill_up_a_shorter_trajectory_make_nothing_of_nothing() -> None:
    time = FRAMES.clamp_max(7.0)[None]
    between = at_times(steady(FRAMES), time, time - 0.4)
    assert bool(between.isfinite().all())
    filled = steady(time[0])  # with the last pose
    for beyond in (0.4, 30.0):
        assert torch.allclose(at_times(filled, time, 7.0 + torch.tensor([[beyond]]).double()), filled[:, -1:])
    for short in (torch.tensor([0.0, 1.0, 1.0]).double(), torch.tensor([0.0, 0.0, 1.0]).double()):
        wanted = torch.tensor([0.3, 0.6]).double()
        assert torch.allclose(at_times(steady(short), short[None], wanted[None]), steady(wanted), atol=TOLERANCE)


def test_a_quaternion_and_its_negative_are_resampled_alike() -> None:
    pose = steady(FRAMES)
    flipped = pose.clone()
    flipped[:, ::2, :, 3:] *= -1
    a, b = (at_times(each, FRAMES[None], (FRAMES + 0.4)[None]) for each in (pose, flipped))
    assert angle_between(a[..., 3:], b[..., 3:]).max() < 1e-7


def test_a_lens_moves_points_by_the_cube_of_their_radius() -> None:
    pose = seen("lens_distortion", {"k1": 0.1})
    radius = PROBE.pose[..., :2].norm(dim=-1)
    assert torch.allclose(pose[..., :2].norm(dim=-1), radius + 0.1 * radius**3)
    assert torch.equal(pose[..., 2:], PROBE.pose[..., 2:])


def test_larger_objects_have_larger_moments_at_the_same_mass() -> None:
    after = from_values("object_size", {"change": 0.1}).act(PROBE.state, PROBE.inputs)
    assert torch.allclose(after.size, 1.1 * PROBE.inputs.size)
    assert torch.allclose(after.inertia, 1.21 * PROBE.inputs.inertia)
    assert torch.equal(after.mass, PROBE.inputs.mass)


def test_each_of_several_trajectories_is_seen_at_its_own_times() -> None:
    pose = torch.cat([steady(FRAMES), steady(2 * FRAMES), steady(0.5 * FRAMES)])
    time = torch.stack([FRAMES, 1.5 * FRAMES, FRAMES + 3])
    wanted = time + torch.tensor([0.3, 0.1, -0.6]).double()[:, None]
    together = at_times(pose, time, wanted)
    for k in range(3):
        assert torch.equal(together[k : k + 1], at_times(pose[k : k + 1], time[k : k + 1], wanted[k : k + 1]))
    assert torch.equal(at_times(pose, time[:1], wanted[:1])[1:2], at_times(pose[1:2], time[:1], wanted[:1]))
