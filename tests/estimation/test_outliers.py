"""Outliers wherever they stand: at an end, side by side, among frames that are lost, at uneven times."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from physid.estimation.measurement.outliers import frame_weights, outlier_poses
from physid.estimation.measurement.sensor_noise import Noise, NoiseSettings, estimate_noise
from physid.physics.rotations import exponential

FRAMES = 14
SETTINGS = NoiseSettings(jump=(0.1, 0.015))
TIME = (torch.arange(FRAMES) + 0.6 * torch.rand(3, FRAMES, generator=torch.Generator().manual_seed(0))).double() / 30
THERE = torch.ones(3, FRAMES, 2).double()


def steady(bend: float = 0.0) -> Tensor:
    """Return poses of two bodies that move and turn evenly, one of them along a parabola."""
    pose = torch.zeros(3, FRAMES, 2, 7).double()
    pose[..., 0, 0], pose[..., 1, 1] = 2.0 * TIME, -1.0 * TIME
    pose[..., 1, 2] = bend * TIME**2 / 2
    pose[..., 0, 3:] = exponential(torch.tensor([0.0, 0.0, 3.0]).double() * TIME[..., None])
    pose[..., 1, 6] = 1.0
    return pose


@pytest.mark.parametrize("kind", [0, 1])
@pytest.mark.parametrize("frame", range(FRAMES))
def test_one_pose_that_jumps_is_found_wherever_it_stands_and_no_other(frame: int, kind: int) -> None:
    for body in (0, 1):
        pose = steady()
        if kind:
            pose[1, frame, body, :3] += torch.tensor([0.0, 0.06, -0.08]).double()
        else:
            pose[1, frame, body, 3:] = exponential(torch.tensor([0.7, 0.0, 0.0]).double())
        found = outlier_poses(pose, THERE, TIME, SETTINGS)
        assert found.nonzero().tolist() == [[1, frame, body]]


@pytest.mark.parametrize("bend", [-9.81, 40.0])
def test_what_falls_or_is_thrown_leaves_no_outlier_though_it_leaves_every_line(bend: float) -> None:
    """A parabola goes on from the frames of either side, at uneven times and at the ends as well."""
    settings = NoiseSettings(jump=(1e-9, 1e-9), usual=1e-9)
    pose = steady(bend)
    pose[..., 0, :3], pose[..., 0, 3:] = pose[..., 1, :3], pose[..., 1, 3:]
    assert not bool(outlier_poses(pose, THERE, TIME, settings).any())


@pytest.mark.parametrize("frame", [4, 7, 9])
def test_a_bounce_leaves_no_outlier_and_one_beside_it_is_found(frame: int) -> None:
    """Before and after it bodies go on along lines of their own."""
    pose = steady()
    pose[..., 1, 1] += 3.0 * (TIME - (TIME[:, frame] + 0.01)[:, None]).clamp_min(0)
    assert not bool(outlier_poses(pose, THERE, TIME, SETTINGS).any())
    pose[2, frame, 1, 2] += 0.2
    assert outlier_poses(pose, THERE, TIME, SETTINGS).nonzero().tolist() == [[2, frame, 1]]


@pytest.mark.parametrize("frames", [1, 4, 5])
def test_of_few_frames_none_is_an_outlier_that_others_do_not_contradict(frames: int) -> None:
    pose = steady()[:, :frames]
    assert not bool(outlier_poses(pose, THERE[:, :frames], TIME[:, :frames], SETTINGS).any())


@pytest.mark.parametrize("frame", range(FRAMES))
def test_a_residual_that_stands_alone_loses_its_weight_wherever_it_stands(frame: int) -> None:
    """Beside it none counts less: of each frame and its neighbours the median is theirs, of an end that of the next."""
    noise = Noise(0.004, 0.001)
    residual = torch.zeros(3, FRAMES, 2, 6).double()
    residual[2, frame, 0, 4] = 40 * noise.position
    weight = frame_weights(residual, THERE, TIME, noise)
    expected = THERE.clone()
    expected[2, frame, 0] = 0.0
    assert torch.equal(weight, expected)


@pytest.mark.parametrize("pattern", [(1.0, 1.0, 0.0), (1.0, 0.0), (1.0, 1.0, 0.0, 0.0)])
def test_noise_is_seen_in_three_frames_in_a_row_alone(pattern: tuple[float, ...]) -> None:
    settings, generator = NoiseSettings(), torch.Generator().manual_seed(1)
    residual = 1e-2 * torch.randn(3, FRAMES, 2, 6, generator=generator).double()
    weight = torch.tensor(pattern).repeat(FRAMES)[:FRAMES, None].expand(3, FRAMES, 2)
    found = estimate_noise(residual, weight, None, settings)
    assert (found.rotation, found.position) == settings.unseen
    some = weight.clone()
    some[0, 4:7] = 1.0
    assert estimate_noise(residual, some, None, settings).position != settings.unseen[1]


@pytest.mark.parametrize("off", [[0, 1, 0], [0, 0, 1, 1, 0], [0, 0, 1, 1, 0, 0]])
def test_of_few_frames_the_median_is_that_of_as_many_as_there_are_on_both_sides(off: list[int]) -> None:
    """Two of five neighbours that go together are outliers, as is one of three."""
    noise, away = Noise(0.004, 0.001), torch.tensor(off).double()
    frames = len(off)
    residual = torch.zeros(1, frames, 1, 6).double()
    residual[0, :, 0, 5] = 40 * noise.position * away
    found = frame_weights(residual, torch.ones(1, frames, 1), TIME[:1, :frames], noise)[0, :, 0]
    assert bool((found[away > 0] < 0.1).all())
    assert bool((found[away == 0] == 1).all())
