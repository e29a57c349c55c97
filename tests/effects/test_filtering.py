"""Trackers that filter poses, against closed forms and scipy's filters."""

import math

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter1d, uniform_filter1d
from torch import Tensor

from physid.effects import find, from_values
from physid.physics.rotations import angle_between, exponential

RATE = 60.0
TIME = torch.arange(240).double()[None] / RATE
FILTERS = [("observation_lag", "time_constant", 0.03), ("observation_smoothing", "variance", 0.0008)]


def poses(position: Tensor, turn: Tensor | None = None) -> Tensor:
    """Return poses (B, T, 1, 7) at positions and rotation vectors (B, T, 3)."""
    turn = torch.zeros_like(position) if turn is None else turn
    return torch.cat([position, exponential(turn)], -1)[:, :, None]


def along(x: Tensor) -> Tensor:
    """Return positions (B, T, 3) along the first axis."""
    return torch.stack([x, torch.zeros_like(x), torch.zeros_like(x)], -1)


def seen(name: str, key: str, value: float, pose: Tensor, time: Tensor = TIME) -> Tensor:
    """Return what the tracker reports."""
    return from_values(name, {key: value}).observe(pose, time)


def uneven() -> Tensor:
    """Return times of which a tenth are left out and the others jitter by a fifth of a frame."""
    source = torch.Generator().manual_seed(2)
    time = TIME + 0.2 / RATE * (torch.rand(TIME.shape, generator=source, dtype=torch.float64) - 0.5)
    return time[:, torch.rand(TIME.shape[1], generator=source) > 0.1]


@pytest.mark.parametrize("time", [TIME, uneven()], ids=["even", "uneven"])
def test_a_lag_reports_a_steady_motion_late_by_its_time_constant_from_the_first_frame_on(time: Tensor) -> None:
    turn = torch.stack([0 * time, 0.9 * time, 0 * time], -1)
    pose, late = (
        poses(along(0.4 * t), turn * t[..., None] / time[..., None].clamp_min(1e-9)) for t in (time, time - 0.03)
    )
    found = seen("observation_lag", "time_constant", 0.03, pose, time)
    assert torch.allclose(found[..., :3], late[..., :3], atol=1e-12)
    # Quaternions of a steady turn are no straight line: the chord of 0.03 s is off by the square of its angle.
    assert angle_between(found[:, 20:, :, 3:], late[:, 20:, :, 3:]).max() < (0.9 * 0.03) ** 3


def test_a_lag_is_exponential_smoothing_and_at_short_steps_the_solution_of_a_low_pass() -> None:
    weight, x = 0.4, torch.randn(1, 60, dtype=torch.float64).cumsum(1)
    tau = (1 - weight) / weight / RATE
    found = seen("observation_lag", "time_constant", tau, poses(along(x)), TIME[:, :60])[0, :, 0, 0]
    wanted = found[:1].tolist()
    for value in x[0, 1:].tolist():
        wanted.append(wanted[-1] + weight * (value - wanted[-1]))
    assert torch.allclose(found, torch.tensor(wanted).double(), atol=1e-12)

    errors = []
    for rate in (1000, 2000):
        time = torch.arange(2 * rate).double()[None] / rate
        since = (time - 1.0).clamp_min(0)
        low_pass = 2.0 * (since - 0.05 * (1 - torch.exp(-since / 0.05)))
        errors.append(
            (seen("observation_lag", "time_constant", 0.05, poses(along(2.0 * since)), time)[..., 0, 0] - low_pass)
            .abs()
            .max()
        )
    assert errors[1] < 4e-4
    assert float(errors[0] / errors[1]) == pytest.approx(2, rel=0.05)


@pytest.mark.parametrize("time", [TIME, uneven()], ids=["even", "uneven"])
def test_a_smoothing_leaves_a_steady_motion_and_adds_half_its_variance_times_the_acceleration(time: Tensor) -> None:
    steady = seen("observation_smoothing", "variance", 0.0008, poses(along(0.4 * time)), time)
    assert torch.allclose(steady[..., 0, 0], 0.4 * time, atol=1e-12)
    fall = seen("observation_smoothing", "variance", 0.0008, poses(along(0.5 * 3.0 * time**2)), time)
    inside = slice(60, -60)
    assert torch.allclose(
        (fall[..., 0, 0] - 1.5 * time**2)[:, inside], torch.tensor(0.5 * 3.0 * 0.0008).double(), atol=1e-6
    )


@pytest.mark.parametrize("width", [3, 5, 9])
def test_a_smoothing_is_near_a_running_mean_and_a_gaussian_bell_of_its_variance(width: int) -> None:
    variance = (width**2 - 1) / 12 / RATE**2
    x = np.where(TIME[0] > 2.0, 0.0, -1.2 * (2.0 - TIME[0].numpy()) ** 2)  # a sliding body that comes to rest
    found = seen("observation_smoothing", "variance", variance, poses(along(torch.from_numpy(x)[None])))[0, :, 0, 0]
    for kernel in (uniform_filter1d(x, width), gaussian_filter1d(x, math.sqrt(variance) * RATE, truncate=8.0)):
        change = np.abs(kernel - x)[20:-20].max()
        assert np.abs(found.numpy() - kernel)[20:-20].max() < 0.08 * change


@pytest.mark.parametrize(("name", "key", "value"), FILTERS)
def test_the_derivative_of_a_filter_is_that_of_differences_also_at_zero(name: str, key: str, value: float) -> None:
    pose = poses(torch.randn(1, 12, 3, dtype=torch.float64).cumsum(1), 0.3 * torch.randn(1, 12, 3, dtype=torch.float64))
    time = torch.linspace(0, 0.4, 12, dtype=torch.float64)[None]
    for at in (0.0, value):
        size = torch.tensor([at], dtype=torch.float64, requires_grad=True)
        weight = torch.linspace(-1, 1, pose.numel(), dtype=torch.float64).view(pose.shape)
        (weight * find(name)(**{key: size}).observe(pose, time)).sum().backward()
        step = 1e-6 * value
        sides = [
            (weight * seen(name, key, at + k * step, pose, time)).sum() for k in ((0, 1, 2) if at == 0 else (-1, 0, 1))
        ]
        slope = (4 * sides[1] - 3 * sides[0] - sides[2]) / (2 * step) if at == 0 else (sides[2] - sides[0]) / (2 * step)
        assert size.grad is not None
        assert float(size.grad) == pytest.approx(float(slope), rel=2e-4)


@pytest.mark.parametrize(("name", "key", "value"), FILTERS)
def test_a_filter_does_not_care_for_signs_of_quaternions_and_reports_unit_ones(
    name: str, key: str, value: float
) -> None:
    turn = torch.stack([3.0 * TIME, 0.5 * TIME, 0 * TIME], -1)
    pose = poses(along(TIME), turn)
    flipped = pose.clone()
    flipped[:, ::3, :, 3:] *= -1
    one, two = (seen(name, key, value, each) for each in (pose, flipped))
    assert angle_between(one[..., 3:], two[..., 3:]).max() < 1e-7
    assert torch.allclose(one[..., 3:].norm(dim=-1), torch.ones(()).double(), atol=1e-12)


@pytest.mark.parametrize(("name", "key", "value"), FILTERS)
def test_frames_that_fill_up_a_shorter_trajectory_do_not_reach_into_it(name: str, key: str, value: float) -> None:
    time = TIME[:, :60]
    pose = poses(along(time.square()))
    padded = torch.cat([pose, torch.zeros_like(pose)], 1)
    found = seen(name, key, value, padded, torch.cat([time, time[:, -1:].expand(-1, 60)], 1))
    assert torch.equal(found[:, :60], seen(name, key, value, pose, time))
    assert bool(found.isfinite().all())


@pytest.mark.parametrize(("name", "key", "value"), FILTERS)
@pytest.mark.parametrize("frames", [1, 2])
def test_one_or_two_frames_can_be_filtered(name: str, key: str, value: float, frames: int) -> None:
    pose = poses(along(TIME[:, :frames]))
    found = seen(name, key, value, pose, TIME[:, :frames])
    assert found.shape == pose.shape
    assert bool(found.isfinite().all())
