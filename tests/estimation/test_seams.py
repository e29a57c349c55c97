"""Filters of poses do not reach from one segment of a prediction into the next."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from physid.effects import CATALOGUE, from_values
from physid.estimation.prediction import Segmentation
from physid.estimation.prediction.seams import mixes_frames, observe_apart
from physid.physics.rotations import exponential, multiply

TIME = torch.arange(40).double()[None] / 60
BEGINS = torch.zeros(1, 40, dtype=torch.bool)
BEGINS[0, [0, 13, 25]] = True
FILTERS = [("observation_lag", "time_constant", 0.03), ("observation_smoothing", "variance", 0.0008)]


def steady() -> Tensor:
    """Return poses of a body that goes on and turns steadily, shape (1, T, 1, 7)."""
    place = TIME[..., None] * torch.tensor([0.5, -0.2, 0.1]).double()
    return torch.cat([place, exponential(TIME[..., None] * torch.tensor([0.0, 0.0, 2.0]).double())], -1)[:, :, None]


def jumping(pose: Tensor) -> Tensor:
    """Shift and turn all poses from the beginning of the second and of the third segment on."""
    moved = pose.clone()
    for start, shift, angle in ((13, 0.01, 0.03), (25, -0.02, -0.05)):
        moved[:, start:, :, :3] += shift
        turn = exponential(torch.tensor([0.0, 0.0, angle]).double()).expand_as(moved[:, start:, :, 3:])
        moved[:, start:, :, 3:] = multiply(turn, moved[:, start:, :, 3:])
    return moved


@pytest.mark.parametrize(("name", "key", "value"), FILTERS)
def test_a_filter_sees_each_segment_by_itself(name: str, key: str, value: float) -> None:
    effect, pose = from_values(name, {key: value}), jumping(steady())
    pose[..., 0] += 0.3 * TIME[..., None].square()
    found = observe_apart(effect, pose, TIME, BEGINS)
    for part in (slice(0, 13), slice(13, 25), slice(25, 40)):
        assert torch.allclose(found[:, part], effect.observe(pose[:, part], TIME[:, part]), atol=1e-12)
    assert float((effect.observe(pose, TIME) - found).abs().max()) > 2e-3, "what averages the jumps"


@pytest.mark.parametrize(("name", "key", "value"), FILTERS)
def test_a_filter_ends_at_each_seam_whatever_stamps_round_to(name: str, key: str, value: float) -> None:
    """Of bodies at rest, whose places differ from segment to segment, a filter changes nothing."""
    generator = torch.Generator().manual_seed(0)
    rows, frames = 400, 240
    time = (torch.arange(frames) + torch.rand(rows, frames, generator=generator).double() * 0.4 - 0.2) / 60
    begins = torch.zeros(rows, frames, dtype=torch.bool)
    begins[:, ::8] = True
    begins[:, 17::40] = True  # segments of one frame
    pose = torch.zeros(rows, frames, 1, 7).double()
    pose[..., 6] = 1.0
    pose[..., 0] = 0.01 * begins.cumsum(1)[..., None]
    assert torch.equal(observe_apart(from_values(name, {key: value}), pose, time, begins), pose)


@pytest.mark.parametrize(("name", "key", "value"), FILTERS)
def test_where_nothing_begins_anew_nothing_changes(name: str, key: str, value: float) -> None:
    effect, whole = from_values(name, {key: value}), torch.zeros_like(BEGINS)
    whole[:, 0] = True
    pose = jumping(steady())
    assert torch.equal(observe_apart(effect, pose, TIME, whole), effect.observe(pose, TIME))


@pytest.mark.parametrize(("name", "key", "value"), FILTERS)
def test_an_effect_of_no_size_keeps_jumps_to_the_last_digits(name: str, key: str, value: float) -> None:
    pose = jumping(steady())
    assert torch.allclose(observe_apart(from_values(name, {key: 0.0}), pose, TIME, BEGINS), pose, atol=1e-12)


def test_seams_are_where_segments_begin_and_where_others_end() -> None:
    whole = Segmentation.equal(2, 12, 4)
    assert whole.seams.nonzero().tolist() == [[row, frame] for row in (0, 1) for frame in (0, 4, 8)]
    assert whole.only(torch.tensor([1])).seams.nonzero().tolist() == [[0, 4], [0, 8]]


def test_filters_alone_mix_frames() -> None:
    assert {kind.name for kind in CATALOGUE if mixes_frames(kind)} == {name for name, *_ in FILTERS}


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_segments_of_single_frames_are_reported(frames: int) -> None:
    effect = from_values("observation_smoothing", {"variance": 0.0008})
    time, pose = TIME[:, :frames], steady()[:, :frames]
    found = observe_apart(effect, pose, time, torch.ones(1, frames, dtype=torch.bool))
    assert bool(found.isfinite().all())
