"""Times and steps of trajectories: what a prediction owes to physics, however frames and forces are clocked."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
import torch
from torch import Tensor

from physid.data import Recording
from physid.data.observations.step_grid import StepGrid
from physid.data.observations.trajectories import from_recordings
from physid.effects import find
from physid.estimation.prediction.nominal_model import NominalModel
from physid.estimation.prediction.rollout import Predictor
from physid.estimation.prediction.segments import Segmentation
from physid.estimation.prediction.timeline import Timeline
from physid.estimation.prediction.variants import Variants
from physid.scenes import Scene, find_setup

SCENE = find_setup("push").scene
REST = torch.tensor([0.0, 0.0, SCENE.sizes[0, 2] / 2, 0, 0, 0, 1], dtype=torch.float64)
EXACT = 1e-12


def forces(count: int) -> Tensor:
    """Return wrenches (1, count, 1, 6) along x that push the block hard."""
    wrench = torch.zeros(1, count, 1, 6, dtype=torch.float64)
    wrench[0, :, 0, 3] = 8 + 4 * torch.rand(count, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return wrench


def predicted(timeline: Timeline, segments: Segmentation, scene: Scene = SCENE) -> Tensor:
    """Predict from rest; shape (R, T, N, 7)."""
    model, count = NominalModel(scene), len(segments)
    point = Variants(
        REST.expand(1, count, 1, 7),
        torch.zeros(1, count, 1, 6, dtype=torch.float64),
        model.guess[None],
        torch.zeros(1, 0, dtype=torch.float64),
        torch.zeros(1, 1, dtype=torch.float64),
    )
    return Predictor(model, timeline, segments).predict(point).pose[0]


def test_steps_between_frames_change_nothing_at_frames_that_are_steps_already() -> None:
    frames = Timeline.regular(forces(40), SCENE.time_step)
    grid = dataclasses.replace(frames.grid, frame_step=frames.grid.frame_step[:, ::4])
    sparse = Timeline(frames.time[:, ::4], grid)
    every, some = (predicted(one, Segmentation.equal(1, one.frames, one.frames)) for one in (frames, sparse))
    assert torch.allclose(some, every[:, ::4], atol=EXACT)


def test_mean_wrenches_keep_the_impulse_from_frame_to_frame() -> None:
    time = np.array([0.0, 0.021, 0.034, 0.06])
    pose = np.tile(REST.numpy(), (4, 1, 1))
    held = forces(13)[0].numpy()
    one = Recording(pose=pose, time=time, wrench=held, wrench_time=np.arange(13) * 0.005)
    read = from_recordings([one], 0.02)
    mean = Timeline(read.time, read.grid).wrench[0, :-1, 0, 3] * torch.from_numpy(np.diff(time))
    edges = np.arange(14) * 0.005
    given = [
        sum(held[k, 0, 3] * max(0.0, min(b, edges[k + 1]) - max(a, edges[k])) for k in range(13))
        for a, b in pairwise(time)
    ]
    assert torch.allclose(mean, torch.tensor(given, dtype=torch.float64), atol=EXACT)


@pytest.mark.parametrize(
    ("late", "rate", "first", "second"),
    [
        (0.0, 1.0, [1.0, 2.0, 4.0], [5.0, 7.0]),
        (0.5, 1.0, [0.5, 1.5, 3.0], [2.5, 6.0]),
        (-0.5, 1.0, [1.5, 3.0, 4.0], [6.0, 7.0]),
        (-1.25, 1.0, [2.5, 4.0, 4.0], [7.0, 7.0]),
        (0.0, 2.0, [1.5, 4.0, 4.0], [6.0, 7.0]),
    ],
)
def test_forces_between_other_times_are_means_none_before_the_first_frame_and_the_last_one_after(
    late: float, rate: float, first: list[float], second: list[float]
) -> None:
    """Forces of 1, 2 and 4 N are held for a second each; another trajectory has 5 and 7 N, and what fills it up."""
    wrench = torch.zeros(2, 3, 1, 6, dtype=torch.float64)
    wrench[..., 0, 3] = torch.tensor([[1.0, 2.0, 4.0], [5.0, 7.0, 99.0]])
    frames = torch.tensor([[0, 1, 2, 3], [0, 1, 2, 2]])
    grid = StepGrid(torch.ones(2, 3, dtype=torch.float64), wrench, frames, torch.tensor([3, 2]))
    timeline = Timeline(frames.double(), grid)
    mean = timeline.wrench_between((rate * timeline.edges - late)[None])[0, ..., 0, 3]
    assert mean[0].tolist() == pytest.approx(first)
    assert mean[1, :2].tolist() == pytest.approx(second)


@pytest.mark.parametrize("factor", [2, 5])
def test_refined_steps_keep_frames_and_forces(factor: int) -> None:
    timeline = Timeline.regular(forces(20), SCENE.time_step)
    fine = timeline.refined(factor)
    assert torch.equal(fine.time, timeline.time)
    assert torch.allclose(fine.wrench, timeline.wrench, atol=1e-9)
    assert torch.equal(fine.owner[:, :factor], torch.zeros(1, factor, dtype=torch.int64))


def test_impulses_between_frames_are_sums_over_their_steps() -> None:
    timeline = Timeline.regular(forces(20), SCENE.time_step).refined(3)
    for segments in (Segmentation.equal(1, 20, 10), Segmentation.equal(1, 20, 7)):  # of 10 frames each; of 6 and 7
        for batch in segments.batches:
            steps = timeline.cut(batch)
            ones = torch.ones(len(batch.segments), steps.index.shape[1], 1, dtype=torch.float64)
            found = steps.between_frames(ones)[:, 0, :, 0]
            followed = torch.nn.functional.pad(batch.inside[:, 1:], (0, 1))
            assert torch.equal(found, 3.0 * followed), "none after the last frame, however long other segments are"


def test_steps_of_a_segment_begin_with_its_first_frame_and_end_with_its_last() -> None:
    timeline = Timeline.regular(forces(20), SCENE.time_step).refined(3)
    for batch in Segmentation.equal(1, 20, 7).batches:
        steps = timeline.cut(batch)
        assert torch.allclose(steps.start, timeline.time[0, batch.frame[:, 0]], atol=EXACT)
        until = torch.cat([torch.zeros(len(steps.length), 1), steps.length.cumsum(1)], 1).gather(1, steps.at)
        last = timeline.time[0, batch.frame]
        assert torch.allclose((steps.start[:, None] + until)[batch.inside], last[batch.inside], atol=EXACT)


def pushed(time: Tensor, first: float, second: float, change: float) -> tuple[Tensor, Tensor]:
    """Return way and speed at some times of the block that rests until 0, and is pushed from then on, by closed form.

    Args:
        time: [s].
        first: Force until `change` [N].
        second: Force from then on [N].
        change: [s].
    """
    body = SCENE.bodies[0]
    one, other = (force / body.mass - body.friction * 9.81 for force in (first, second))
    early, late = time.clamp(0, change), (time - change).clamp_min(0)
    return one * early**2 / 2 + one * early * late + other * late**2 / 2, one * early + other * late


@pytest.mark.parametrize(("name", "size"), [("clock_rate", 0.15), ("clock_rate", -0.1), ("observation_latency", 0.013)])
def test_a_camera_with_a_clock_of_its_own_sees_the_motion_at_other_times_in_every_segment(
    name: str, size: float
) -> None:
    frames, cut, (first, second) = 60, 30, (12.0, 7.0)
    wrench = torch.zeros(1, frames, 1, 6, dtype=torch.float64)
    wrench[0, :, 0, 3] = torch.where(torch.arange(frames) < 30, first, second)
    timeline = Timeline.regular(wrench, SCENE.time_step)
    taken = find(name)(torch.tensor([size], dtype=torch.float64)).elapse(timeline.time)[0]
    way, speed = pushed(taken, first, second, 30 * SCENE.time_step)
    segments = Segmentation.equal(1, frames, cut)
    model = NominalModel(SCENE)
    predictor = Predictor(model, timeline, segments, [find(name)])
    pose, twist = REST.expand(1, 2, 1, 7).clone(), torch.zeros(1, 2, 1, 6, dtype=torch.float64)
    pose[0, 1, 0, 0], twist[0, 1, 0, 3] = way[cut], speed[cut]
    effects = torch.tensor([[size]], dtype=torch.float64)
    point = Variants(pose, twist, model.guess[None], effects, torch.zeros(1, 1, dtype=torch.float64))
    seen = predictor.predict(point).pose[0, 0, :, 0, 0]
    step = (
        SCENE.bodies[0].friction * 9.81 * SCENE.time_step**2
    )  # a force that comes within a step is held for all of it
    assert torch.allclose(seen, way, rtol=0, atol=step * frames / 8)
    assert float((seen - way).abs().median()) < step / 2


def test_a_camera_moves_what_is_seen_in_the_variants_in_which_its_effect_is_at_work() -> None:
    offsets = torch.tensor([[0.0, 0.0, 0.0], [0.01, 0.0, -0.02], [0.0, 0.03, 0.0]], dtype=torch.float64)
    timeline = Timeline.regular(forces(20).repeat(2, 1, 1, 1), SCENE.time_step)
    model, segments = NominalModel(SCENE), Segmentation.equal(2, 20, 10)
    predictor = Predictor(model, timeline, segments, [find("camera_offset")])
    still = torch.zeros(1, len(segments), 1, 6, dtype=torch.float64)
    point = Variants.of_states(REST.expand(1, len(segments), 1, 7), still, model.guess[None], offsets[:1]).repeat(3)
    found = predictor.predict(point.replace(effects=offsets))
    assert torch.equal(found.state, found.state[:1].expand_as(found.state))
    expected = found.state.clone()
    expected[..., :3] += offsets[:, None, None, None]
    assert torch.allclose(found.pose, expected, atol=EXACT)
