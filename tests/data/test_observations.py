"""The steps of a simulation keep every impulse of the held forces, and meet every frame."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from tests.data.sets import SCENE, recording, write_set

from physid.data import Recording, RecordingSet
from physid.data.observations.step_grid import SHORTEST, lay_steps
from physid.data.observations.trajectories import Trajectories, from_recordings, load_trajectories

STEP = 1 / 60
Array = NDArray[np.float64]


def impulse(wrench: Array, start: Array, until: float) -> Array:
    """Return the time integral of rows that are held from each start to the next, from 0 to `until`, shape (N, 6)."""
    ends = np.append(start[1:], np.inf)
    held = np.clip(np.minimum(ends, until) - np.maximum(start, 0.0), 0.0, None)
    return np.einsum("s,snk->nk", held, wrench)


def shaken(seed: int, frames: int = 60, forces: int = 333, rate: float = 500.0) -> Recording:
    """Return poses with jitter and missing frames, under forces with a clock of their own."""
    generator = np.random.default_rng(seed)
    number = np.flatnonzero(generator.random(2 * frames) > 0.1)[:frames]
    time = (number + generator.uniform(-0.2, 0.2, frames)) * STEP
    pose = recording(frames, seed).pose
    wrench = generator.normal(size=(forces, 1, 6))
    return Recording(
        pose=pose, time=time, wrench=wrench, wrench_time=time[0] + np.sort(generator.uniform(-0.1, 1.2, forces))
    )


@pytest.mark.parametrize("shortest", [None, STEP / 4, 10 * STEP])
@pytest.mark.parametrize("seed", range(4))
def test_the_impulse_up_to_every_frame_is_that_of_the_held_forces(seed: int, shortest: float | None) -> None:
    one = shaken(seed)
    assert one.wrench is not None
    assert one.wrench_time is not None
    assert one.time is not None
    grid = from_recordings([one], STEP, shortest=shortest).grid
    given = (grid.steps[..., None, None] * grid.wrench).cumsum(1)[0]
    given = torch.cat([torch.zeros_like(given[:1]), given])[grid.frame_step[0]].numpy()
    start = one.wrench_time - one.time[0]
    times = grid.times[0][grid.frame_step[0]].tolist()
    assert np.allclose(given, np.stack([impulse(one.wrench, start, until) for until in times]), atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_every_frame_lies_at_the_end_of_a_step_and_no_step_is_too_short(seed: int) -> None:
    found = from_recordings([shaken(seed)], STEP)
    off = found.grid.times.gather(1, found.grid.frame_step) - found.time
    assert float(off.abs().max()) <= SHORTEST * STEP
    assert float(found.grid.steps.min()) >= SHORTEST * STEP * (1 - 1e-9)


def test_the_force_in_a_step_without_a_change_is_the_row_itself() -> None:
    one = shaken(0)
    found = from_recordings([one], STEP)
    rows = {tuple(row) for row in one.wrench[:, 0].tolist()} if one.wrench is not None else set()
    same = [tuple(row) in rows for row in found.grid.wrench[0, :, 0].tolist()]
    assert np.mean(same) > 0.9


def test_refined_steps_keep_times_and_impulses() -> None:
    found = from_recordings([shaken(0), shaken(1, frames=30)], STEP)
    generator = torch.Generator().manual_seed(0)
    for factors in (3, torch.randint(1, 6, found.grid.steps.shape, generator=generator)):
        fine = found.refine(factors)
        for grid, other in ((found.grid, fine.grid),):
            now = grid.times.gather(1, grid.frame_step)
            then = other.times.gather(1, other.frame_step)
            assert torch.allclose(now, then, atol=1e-14)
            before, after = (
                torch.nn.functional.pad((one.steps[..., None, None] * one.wrench).cumsum(1), (0, 0, 0, 0, 1, 0))
                for one in (grid, other)
            )
            rows = torch.arange(2)[:, None]
            assert torch.allclose(before[rows, grid.frame_step], after[rows, other.frame_step], atol=1e-13)
        parts = factors if isinstance(factors, torch.Tensor) else torch.full_like(found.grid.steps, factors)
        assert torch.equal(fine.grid.count, (parts * found.grid.real).sum(1).long())


def test_an_even_log_gives_one_step_of_exactly_the_time_step_per_frame() -> None:
    plain = recording(30)
    for time in (None, np.arange(30) * STEP, 5 + np.arange(30) * STEP):
        found = from_recordings([dataclasses.replace(plain, time=time), recording(20, 1)], STEP)
        assert found.regular
        assert plain.wrench is not None
        assert np.array_equal(found.grid.wrench[0, :29].numpy(), plain.wrench[:-1])
    assert not from_recordings([shaken(0)], STEP).regular


def test_forces_at_a_multiple_of_the_frame_rate_give_that_many_steps() -> None:
    wrench = np.random.default_rng(0).normal(size=(150, 1, 6))
    one = Recording(pose=recording(30).pose, wrench=wrench, wrench_time=np.arange(150) * STEP / 5)
    grid = from_recordings([one], STEP).grid
    assert int(grid.count[0]) == 5 * 29
    assert torch.allclose(grid.steps, torch.full_like(grid.steps, STEP / 5))
    assert np.array_equal(grid.wrench[0].numpy(), wrench[:145])


def test_a_force_that_does_not_change_causes_no_step() -> None:
    wrench = np.ones((150, 1, 6))
    one = Recording(pose=recording(30).pose, wrench=wrench, wrench_time=np.arange(150) * STEP / 5)
    assert from_recordings([one], STEP).regular


def test_no_force_acts_before_the_first_row_and_the_last_one_is_held() -> None:
    one = Recording(pose=recording(30).pose, wrench=np.ones((1, 1, 6)), wrench_time=np.array([10.5 * STEP]))
    grid = from_recordings([one], STEP).grid
    assert int(grid.count[0]) == 30
    assert (grid.wrench[0, :11] == 0).all()
    assert (grid.wrench[0, 11:] == 1).all()


def test_changes_that_are_too_close_are_merged_without_losing_impulse() -> None:
    start = np.array([0.0, 3.4, 3.4001, 3.4002, 3.4003, 3.4004, 5.00001]) * STEP
    wrench = np.random.default_rng(0).normal(size=(7, 1, 6))
    steps = lay_steps(np.arange(8) * STEP, wrench, start, STEP)
    assert len(steps.lengths) == 8
    total = np.einsum("s,snk->nk", steps.lengths, steps.wrench)
    assert np.allclose(total, impulse(wrench, start, 7 * STEP), atol=1e-14)


def test_unseen_bodies_are_masked_and_hold_a_pose_nearby() -> None:
    one = recording(10)
    assert one.pose is not None
    pose = one.pose.copy()
    pose[[0, 1, 4, 9]] = np.nan
    found = from_recordings([Recording(pose=pose), recording(12, 1)], STEP)
    assert found.first == (2, 0)
    assert found.seen[0, :, 0].tolist() == [True, True, False, True, True, True, True, False] + 4 * [False]
    assert torch.equal(found.pose[0, 2], found.pose[0, 1])
    assert float(found.time[0, 1]) == pytest.approx(STEP)


def test_a_set_is_loaded_with_what_each_trajectory_is_for(tmp_path: Path) -> None:
    folder = write_set(tmp_path, [recording(8), recording(6, 1, split="test"), recording(9, 2, split=None)])
    found = load_trajectories(RecordingSet(folder), [2, 1])
    assert found.index == (2, 1)
    assert found.splits == (None, "test")
    assert found.twist is not None
    assert found.seen.sum(1)[:, 0].tolist() == [9, 6]
    short = found.chosen(torch.tensor([False, True]))
    assert short.index == (1,)
    assert short.pose.shape[1] == 6
    assert short.grid.steps.shape[1] == 5
    assert torch.equal(short.pose[0], found.pose[1, :6])


def test_a_body_that_is_never_seen_is_named(tmp_path: Path) -> None:
    pose = np.concatenate([recording().pose, np.full((8, 1, 7), np.nan)], 1)  # type: ignore[list-item]
    bodies = [SCENE.bodies[0], dataclasses.replace(SCENE.bodies[0], name="other")]
    folder = write_set(tmp_path, [Recording(pose=pose)], SCENE.with_bodies(bodies))
    with pytest.raises(ValueError, match=r"000000.h5: pose: expected every body in some frame, found other in none"):
        load_trajectories(RecordingSet(folder))


def test_stamps_that_contradict_the_time_step_are_refused_with_the_file(tmp_path: Path) -> None:
    good = recording(40)
    folder = write_set(tmp_path, [good, dataclasses.replace(good, time=np.arange(40) / 60)])
    with pytest.raises(ValueError, match=r"000001.h5: time: expected about 240 frames per second .* found 60 "):
        load_trajectories(RecordingSet(folder))


def test_what_contradicts_itself_is_refused() -> None:
    found = from_recordings([recording(8)], STEP)
    with pytest.raises(ValueError, match="frames must lie at the ends of steps"):
        dataclasses.replace(found, time=found.time * 1.1)
    with pytest.raises(ValueError, match="seen must have shape"):
        dataclasses.replace(found, seen=found.seen[:, :-1])
    with pytest.raises(ValueError, match="factors must be at least 1"):
        found.refine(0)
    assert isinstance(found.to("cpu"), Trajectories)
