"""Segments, frames and steps against the definitions of their words, on random events, clocks and forces."""

from __future__ import annotations

import threading
from itertools import pairwise

import pytest
import torch
from torch import Tensor

from estimation.flights import FORCE, MASS, G, flights
from physid.data.observations.step_grid import StepGrid
from physid.effects import find
from physid.estimation.prediction import Predictor, Segmentation, Timeline, Variants
from physid.estimation.prediction.segments import Batch, CutRule, at_once

LEAD, TRAIL, LONGEST, LEAST = 3, 2, 5, 4
RULE = CutRule(lead=LEAD, trail=TRAIL, longest=LONGEST, least=LEAST, fewest=(1, 1, 1, 1))


def runs(mask: list[bool]) -> list[tuple[int, int, bool]]:
    """Return (first frame, frames, value) of the stretches of a mask."""
    edges = [0, *(k for k in range(1, len(mask)) if mask[k] != mask[k - 1]), len(mask)]
    return [(a, b - a, mask[a]) for a, b in pairwise(edges)]


@pytest.mark.parametrize("share", [0.02, 0.08, 0.3])
def test_frames_near_an_event_are_cut_short_and_what_is_free_stays_whole_unless_it_is_too_short(share: float) -> None:
    events = torch.rand(30, 40, generator=torch.Generator().manual_seed(1)) < share
    segments = Segmentation.around(events, RULE, time_step=1.0)
    for row, own in enumerate(events.tolist()):
        near = [any(own[max(0, k - TRAIL) : k + LEAD + 1]) for k in range(len(own))]
        free = runs(near)
        for first, size, hit in free:
            if not hit and size < LEAST and len(free) > 1:
                near[first : first + size] = [True] * size
        chosen = segments.trajectory == row
        found = list(
            zip(*(each[chosen].tolist() for each in (segments.start, segments.size, segments.contact)), strict=True)
        )
        for first, size, hit in runs(near):
            parts = [(start, count) for start, count, _ in found if first <= start < first + size]
            assert sum(count for _, count in parts) == size
            assert len(parts) == (-(-size // LONGEST) if hit else 1)
            assert max(count for _, count in parts) - min(count for _, count in parts) <= 1
        assert [hit for start, count, hit in found for _ in range(count)] == near


def test_a_rule_counts_frames_of_its_times_and_as_many_as_are_asked_for_at_least() -> None:
    rule = CutRule(lead=0.1, trail=0.05, longest=0.2, least=0.3, fewest=(2, 3, 4, 5))
    assert rule.frames(0.01) == (10, 5, 20, 30)
    assert rule.frames(0.05) == (2, 3, 4, 6)
    assert rule.frames(1.0) == (2, 3, 4, 5)


@pytest.mark.parametrize(
    ("frames", "length", "sizes"), [(10, 10, [10]), (10, 4, [3, 3, 4]), (10, 9, [5, 5]), (3, 1, [1] * 3)]
)
def test_equal_parts_are_as_few_as_their_length_allows(frames: int, length: int, sizes: list[int]) -> None:
    segments = Segmentation.equal(2, frames, length)
    assert segments.size.tolist() == 2 * sizes
    assert segments.start.tolist() == 2 * [sum(sizes[:k]) for k in range(len(sizes))]
    assert not segments.contact.any()


def test_whole_trajectories_of_their_own_lengths_and_some_of_the_segments() -> None:
    whole = Segmentation.whole(torch.tensor([5, 2, 9]), 9)
    assert (whole.trajectory.tolist(), whole.start.tolist(), whole.size.tolist()) == ([0, 1, 2], [0, 0, 0], [5, 2, 9])
    assert not whole.contact.any()
    ones = torch.ones(1, 3, 9)
    assert whole.sum_frames(ones).tolist() == [[5.0, 2.0, 9.0]]
    assert whole.position[1].tolist() == [0, 1] + [0] * 7
    some = Segmentation.equal(2, 9, 3).only(torch.tensor([1, 5]))
    assert (some.trajectory.tolist(), some.start.tolist(), some.size.tolist()) == ([0, 1], [3, 6], [3, 3])
    assert some.spread(torch.tensor([7, 8])).tolist() == [[0, 0, 0, 7, 7, 7, 0, 0, 0], [0] * 6 + [8, 8, 8]]
    assert some.sum_segments(torch.tensor([[1.0, 2.0], [3.0, 4.0]])).tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert some.cost == 6


def test_batches_hold_every_segment_once_with_the_frames_that_are_its_own() -> None:
    segments = Segmentation.around(torch.rand(6, 200, generator=torch.Generator().manual_seed(2)) < 0.01, CutRule())
    assert sorted(torch.cat([batch.segments for batch in segments.batches]).tolist()) == list(range(len(segments)))
    for batch in segments.batches:
        size = segments.size[batch.segments]
        assert torch.equal(batch.inside.sum(1), size)
        assert batch.frame.shape[1] == int(size.max())
        assert torch.equal(batch.frame[:, 0], segments.start[batch.segments])
        steps = batch.frame.diff(dim=1)
        assert bool((steps[batch.inside[:, 1:]] == 1).all())
        assert int(batch.frame.max()) < segments.frames


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_each_segment_is_simulated_once_however_many_threads_there_are(threads: int) -> None:
    segments = Segmentation.around(torch.rand(9, 200, generator=torch.Generator().manual_seed(3)) < 0.02, CutRule())
    seen: list[int] = []
    lock = threading.Lock()

    def simulate(batch: Batch) -> None:
        with lock:
            seen.extend(batch.segments.tolist())

    before = torch.get_num_threads()
    try:
        torch.set_num_threads(threads)
        at_once(simulate, segments.batches)
    finally:
        torch.set_num_threads(before)
    assert sorted(seen) == list(range(len(segments)))


def clocked(seed: int = 0) -> Timeline:
    """Return three trajectories of 5 frames and up to 8 uneven steps on clocks of their own, with random forces."""
    generator = torch.Generator().manual_seed(seed)
    steps = 0.1 + torch.rand(3, 8, generator=generator, dtype=torch.float64)
    wrench = torch.randn(3, 8, 2, 6, generator=generator, dtype=torch.float64)
    frame_step = torch.tensor([[0, 1, 4, 4, 8], [0, 2, 3, 5, 6], [0, 1, 2, 2, 2]])
    grid = StepGrid(steps, wrench, frame_step, torch.tensor([8, 6, 2]))
    offset = torch.tensor([[3.0], [-1.0], [0.5]], dtype=torch.float64)
    return Timeline(grid.times.gather(1, frame_step) + offset, grid)


def impulse(timeline: Timeline, row: int, until: float) -> Tensor:
    """Integrate the force of a trajectory up to a time: none before its first frame, the last one after its end."""
    total, grid = torch.zeros(2, 6).double(), timeline.grid
    begin = float(timeline.time[row, 0])
    count = int(grid.count[row])
    for k in range(count):
        end = begin + float(grid.steps[row, k])
        last = until if k == count - 1 else end
        total += max(0.0, min(until, max(end, last)) - begin) * grid.wrench[row, k]
        begin = end
    return total


def test_forces_between_any_times_are_the_mean_of_what_acts_there() -> None:
    timeline = clocked()
    generator = torch.Generator().manual_seed(5)
    first = timeline.time[:, :1] - 1.0
    edges = first + 0.05 + (1.5 * torch.rand(2, 3, 9, generator=generator, dtype=torch.float64)).cumsum(2)
    edges[0] = timeline.edges
    found = timeline.wrench_between(edges)
    for row in range(3):
        assert torch.allclose(
            found[0, row, : timeline.grid.count[row]], timeline.grid.wrench[row, : timeline.grid.count[row]]
        )
        for k in range(8):
            a, b = float(edges[1, row, k]), float(edges[1, row, k + 1])
            mean = (impulse(timeline, row, b) - impulse(timeline, row, a)) / (b - a)
            assert torch.allclose(found[1, row, k], mean, atol=1e-9)


def test_steps_belong_to_the_frame_before_them_and_begin_on_the_clock_of_their_trajectory() -> None:
    timeline = clocked()
    assert timeline.frames == 5
    assert timeline.owner[0].tolist() == [0, 1, 1, 1, 3, 3, 3, 3]
    assert timeline.owner[1, :6].tolist() == [0, 0, 1, 2, 2, 3]
    assert torch.allclose(timeline.step_time[:, 0], timeline.time[:, 0])
    assert torch.allclose(timeline.edges.diff(dim=1), timeline.grid.steps)
    held = torch.randn(2, 3, 5, 2, 6).double()
    on_steps = timeline.on_steps(held)
    assert torch.equal(on_steps[1, 0, 5], held[1, 0, 3])
    assert torch.equal(on_steps[0, 1, 1], held[0, 1, 0])


def test_frames_at_equal_times_are_a_step_apart_and_one_frame_has_a_step_that_nothing_refers_to() -> None:
    wrench = torch.randn(2, 4, 1, 6).double()
    timeline = Timeline.regular(wrench, 0.25)
    assert timeline.time.tolist() == [[0.0, 0.25, 0.5, 0.75]] * 2
    assert torch.equal(timeline.wrench[:, :3], wrench[:, :3])
    assert not timeline.wrench[:, 3].any()
    assert timeline.grid.frame_step.tolist() == [[0, 1, 2, 3]] * 2
    assert timeline.grid.count.tolist() == [3, 3]
    one = Timeline.regular(wrench[:, :1], 0.25)
    assert (one.frames, one.grid.steps.tolist(), one.time.tolist()) == (1, [[0.25]] * 2, [[0.0]] * 2)


def test_the_steps_of_a_segment_lead_from_its_first_frame_to_its_last() -> None:
    timeline = clocked()
    segments = Segmentation(3, 5, torch.tensor([0, 0, 1, 2]), torch.tensor([0, 2, 1, 1]), torch.tensor([2, 3, 3, 2]),
                            *2 * [torch.zeros(4).bool()])  # fmt: skip
    (batch,) = segments.batches
    steps = timeline.cut(batch)
    assert steps.count.tolist() == [1, 4, 3, 1]
    assert steps.at.tolist() == [[0, 1, 1], [0, 0, 4], [0, 1, 3], [0, 1, 1]]
    assert steps.index[1].tolist() == [4, 5, 6, 7]
    assert steps.index[2, :3].tolist() == [2, 3, 4]
    assert torch.allclose(steps.length[2, :3], timeline.grid.steps[1, 2:5])
    starts = [float(timeline.time[row, frame]) for row, frame in ((0, 0), (0, 2), (1, 1), (2, 1))]
    assert steps.start.tolist() == pytest.approx(starts)
    assert timeline.cost(batch) == 16
    whole = torch.arange(48.0).reshape(2, 3, 8)[..., None, None]
    assert steps.wrench(whole)[1, 2, :3, 0, 0].tolist() == [34.0, 35.0, 36.0]
    (short,) = segments.only(torch.tensor([2, 3])).batches
    late = Segmentation(
        3, 5, torch.tensor([1, 1]), torch.tensor([1, 0]), torch.tensor([2, 4]), *2 * [torch.zeros(2).bool()]
    )
    assert timeline.cut(late.batches[0]).at.tolist() == [[0, 1, 1, 1], [0, 2, 3, 5]], "no further than its last frame"
    assert timeline.cut(short).at.tolist() == [[0, 1, 3], [0, 1, 1]]
    values = torch.arange(1.0, 33.0).reshape(8, 4, 1)  # of four segments in two variants each, after each step
    after = torch.cat([torch.zeros(8, 1, 1), values], 1)
    assert steps.at_frames(after)[2, 1, :, 0].tolist() == [0.0, float(values[5, 0]), float(values[5, 2])]
    between = steps.between_frames(values)
    assert between[1, 0, :, 0].tolist() == [0.0, float(values[2].sum()), 0.0]
    assert between[2, 1, :, 0].tolist() == [float(values[5, 0]), float(values[5, 1:3].sum()), 0.0]


def test_variants_are_picked_joined_and_repeated_field_by_field() -> None:
    made = flights(trajectories=1)
    many = made.true.repeat(3)
    many.effects[:, 0] = torch.tensor([1.0, 2.0, 3.0]).double()
    assert len(many) == 3
    assert float(made.true.effects[0, 0]) == FORCE[0], "a copy"
    both = Variants.join([many[2:], many[:1]])
    assert both.effects[:, 0].tolist() == [3.0, 1.0]
    assert many[:1].force is None
    pushed = many.replace(force=torch.ones(3, 1))[1:]
    assert pushed.force is not None
    assert len(pushed.force) == 2
    assert made.start.engine.tolist() == [[0.0]]


@pytest.mark.parametrize("most", [1, 100, 10_000])
def test_variants_are_predicted_alike_however_many_fit_in_memory_and_all_are_counted(most: int) -> None:
    made = flights(trajectories=2)
    old = made.experiment.predictor
    predictor = Predictor(old.model, old.timeline, old.segments, old.candidates, most)
    many = made.true.repeat(5)
    many.effects[:, 0] = torch.linspace(-1, 1, 5).double()
    found = predictor.predict(many)
    expected = old.predict(many)
    assert torch.allclose(found.pose, expected.pose, atol=1e-12)
    assert torch.allclose(found.twist, expected.twist, atol=1e-12)
    assert predictor.simulated == [5]
    over = predictor.over(Segmentation.equal(2, 24, 24))
    over.predict(many[:2].replace(pose=many.pose[:2, ::2], twist=many.twist[:2, ::2]))
    assert predictor.simulated == over.simulated == [7]
    assert predictor.at_times(predictor.timeline).simulated == [0]


def test_a_force_on_top_and_an_effect_bend_a_flight_by_its_closed_form() -> None:
    made = flights(trajectories=2)
    predictor, segments = made.experiment.predictor, made.experiment.predictor.segments
    force = torch.zeros(1, 2, 24, 1, 6).double()
    force[0, 1, :, 0, 4] = 3.0
    found = predictor.predict(made.true.replace(force=force))
    owner = segments.spread(torch.arange(len(segments)))
    time = predictor.timeline.time
    since = (time - time.gather(1, segments.spread(segments.start)))[..., None]
    pull = (
        torch.tensor([[FORCE[0], FORCE[1], -G * MASS], [FORCE[0], FORCE[1] + 3.0, -G * MASS]]).double()[:, None] / MASS
    )
    place, speed = made.true.pose[0, owner, 0, :3], made.true.twist[0, owner, 0, 3:]
    assert torch.allclose(found.pose[0, :, :, 0, :3], place + speed * since + pull * since**2 / 2, atol=1e-9)
    assert torch.allclose(found.twist[0, :, :, 0, 3:], speed + pull * since, atol=1e-9)
    assert torch.equal(found.state, found.pose)
    assert float(found.impulse.abs().max()) < 1e-6
    assert not found.impulse[:, :, [11, 23]].any()


def test_effects_that_act_late_ask_for_the_shorter_steps() -> None:
    made = flights(trajectories=1, kinds=("constant_force", "force_delay"), sizes=(0.0, 0.0, 0.0))
    old = made.experiment.predictor
    late = old.timeline.refined(2)
    predictor = Predictor(
        old.model, old.timeline, old.segments, [find("constant_force"), find("force_delay")], late=late
    )
    assert predictor.for_effects(torch.tensor([0, 1])) is predictor
    assert predictor.for_effects(torch.tensor([0, 2])).timeline is late
    assert old.for_effects(torch.tensor([2])) is old
    assert predictor.over(old.segments).late is late
    assert [term.label for term in predictor.terms] == ["constant_force.x", "constant_force.y", "force_delay.delay"]


def test_frames_of_no_segment_hold_the_states_that_are_given_for_them() -> None:
    made = flights(trajectories=2)
    old = made.experiment.predictor
    whole = old.predict(made.true)
    elsewhere = whole.state[0] + 100.0
    chosen = torch.tensor([1])
    some = old.over(old.segments.only(chosen), elsewhere)
    found = some.predict(made.true.replace(pose=made.true.pose[:, chosen], twist=made.true.twist[:, chosen]))
    inside = torch.zeros(2, 24, dtype=torch.bool)
    inside[0, 12:] = True
    assert torch.equal(found.state[0][inside], whole.state[0][inside])
    assert torch.equal(found.state[0][~inside], elsewhere[~inside])
    assert not found.twist[0][~inside].any()
