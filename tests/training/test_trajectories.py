"""Segments and twists of recorded trajectories."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from tests.training.pushed import SCENE, push_batch
from torch import Tensor

from physid.physics.rotations import exponential, multiply
from physid.training.parameters.trajectories import Trajectories
from physid.training.parameters.twist import twist_from_poses

STEP = 1 / 240
CLOSE = 1e-8


def whole() -> Trajectories:
    return Trajectories.of(push_batch(frames=25), SCENE.time_step)


def flight(frames: int, bounce: int | None = None) -> tuple[Tensor, Tensor]:
    """Return poses (1, T, 1, 7) and twists of free flight in semi-implicit steps, with a kick at frame `bounce`."""
    velocity, spin = torch.tensor([1.0, -0.5, 2.0]).double(), torch.tensor([0.3, 2.0, -1.0]).double()
    position, turn = torch.zeros(3).double(), torch.tensor([0.0, 0.0, 0.0, 1.0]).double()
    poses, twists = [torch.cat([position, turn])], [torch.cat([spin, velocity])]
    for frame in range(1, frames):
        velocity = velocity - torch.tensor([0.0, 0.0, 9.81 * STEP]).double()
        if frame == bounce:
            velocity, spin = velocity * torch.tensor([1.0, 1.0, -1.0]), -spin
        position, turn = position + STEP * velocity, multiply(exponential(STEP * spin), turn)
        poses.append(torch.cat([position, turn]))
        twists.append(torch.cat([spin, velocity]))
    return torch.stack(poses)[None, :, None], torch.stack(twists)[None, :, None]


def test_each_segment_begins_in_the_frame_in_which_the_one_before_ends() -> None:
    cut = whole().segments(8)
    ends, starts = cut.pose[:-1, -1], cut.pose[1:, 0]
    same = cut.index[:-1] == cut.index[1:]
    assert torch.equal(ends[same], starts[same])
    assert cut.pose.shape[:2] == (9, 9)


def test_segments_count_every_step_of_a_shorter_trajectory_once() -> None:
    short = dataclasses.replace(whole(), length=torch.tensor([25, 10, 2]))
    cut = short.segments(8)
    steps = torch.zeros(3, dtype=torch.long).index_add(0, cut.index, cut.real.sum(1) - 1)
    assert steps.tolist() == [24, 9, 1]


def test_copies_lie_one_behind_the_other() -> None:
    assert whole().repeated(2).index.tolist() == [0, 1, 2, 0, 1, 2]


def test_a_segment_without_a_step_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 1 step"):
        whole().segments(0)


def test_the_twist_of_free_flight_is_found_exactly() -> None:
    pose, twist = flight(30)
    assert (twist_from_poses(pose, torch.tensor([30]), STEP) - twist).abs().max() < CLOSE


def test_an_impact_spoils_no_twist_beside_it() -> None:
    pose, twist = flight(40, bounce=20)
    assert (twist_from_poses(pose, torch.tensor([40]), STEP) - twist)[:, [18, 20, 22]].abs().max() < CLOSE


def test_padding_changes_no_twist() -> None:
    pose, _ = flight(30)
    padded = torch.cat([pose, pose[:, -1:].expand(-1, 10, -1, -1)], 1)
    alone = twist_from_poses(pose, torch.tensor([30]), STEP)
    assert torch.equal(twist_from_poses(padded, torch.tensor([30]), STEP)[:, :30], alone)
