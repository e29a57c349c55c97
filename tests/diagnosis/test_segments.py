"""Segments: every frame in exactly one, sums that agree, impacts with a lead before them."""

from __future__ import annotations

import pytest
import torch

from physid.estimation.prediction.segments import CutRule, Segmentation

IMPACTS = CutRule()


def around(*impacts: int, frames: int = 150) -> Segmentation:
    events = torch.zeros(2, frames, dtype=torch.bool)
    events[0, list(impacts)] = True
    return Segmentation.around(events, IMPACTS)


@pytest.mark.parametrize("segments", [Segmentation.equal(3, 121, 30), around(), around(40), around(3, 60, 64, 149)])
def test_every_frame_is_in_exactly_one_segment(segments: Segmentation) -> None:
    assert segments.sum_segments(segments.size).tolist() == [segments.frames] * segments.trajectories
    counted = torch.zeros(segments.trajectories, segments.frames)
    for row, start, size in zip(segments.trajectory, segments.start, segments.size, strict=True):
        counted[row, start : start + size] += 1
    assert (counted == 1).all()
    assert int(segments.size.min()) > 1


def test_equal_segments_are_equal_but_for_one_frame() -> None:
    size = Segmentation.equal(1, 121, 30).size
    assert int(size.max()) <= 30
    assert int(size.max() - size.min()) <= 1


def test_what_is_cut_is_put_back_where_it_was() -> None:
    segments = around(40, 100)
    value = torch.randn(1, 2, 150, 3, generator=torch.Generator().manual_seed(0))
    back = torch.zeros_like(value)
    for batch in segments.batches:
        batch.put(batch.cut(value), back)
    assert torch.equal(back, value)


def test_columns_are_the_numbers_of_each_segment_and_zero_beyond_its_end() -> None:
    segments = around(40, 100)
    value = torch.randn(3, 2, 150, 1, 6, generator=torch.Generator().manual_seed(0))
    for batch in segments.batches:
        columns = batch.columns(value).unflatten(1, (-1, 1, 6))
        for number, column in zip(batch.segments.tolist(), columns, strict=True):
            start, size = int(segments.start[number]), int(segments.size[number])
            own = value[:, segments.trajectory[number], start : start + size]
            assert torch.equal(column[:size].movedim(-1, 0), own)
            assert not column[size:].any()


def test_sums_over_frames_and_segments_are_sums_over_trajectories() -> None:
    segments = around(40, 100)
    value = torch.rand(1, 2, 150, generator=torch.Generator().manual_seed(0))
    whole = segments.sum_segments(segments.sum_frames(value)[0])
    assert torch.allclose(whole, value.sum(2)[0])


def test_a_contact_free_trajectory_is_one_segment_and_an_impact_has_a_short_one() -> None:
    segments = around(40)
    assert segments.size[segments.trajectory == 1].tolist() == [150]
    contact = segments.contact & (segments.trajectory == 0)
    lead, trail, longest, _ = IMPACTS.frames(1 / 240)
    assert int(segments.start[contact].min()) == 40 - lead
    assert int((segments.start + segments.size)[contact].max()) == 40 + trail + 1
    assert int(segments.size[contact].max()) <= longest


@pytest.mark.parametrize("impacts", [(143,), (3, 149), (40, 60), (25,)])
def test_a_contact_free_stretch_that_is_too_short_belongs_to_the_contact_beside_it(impacts: tuple[int, ...]) -> None:
    segments = around(*impacts)
    free = ~segments.contact & (segments.trajectory == 0)
    least = IMPACTS.frames(1 / 240)[3]
    assert (segments.size[free] >= least).all()


def test_a_short_trajectory_without_an_event_is_free_of_contact() -> None:
    segments = around(frames=IMPACTS.frames(1 / 240)[3] - 1)
    assert not bool(segments.contact[1])


@pytest.mark.parametrize("rate", [30.0, 60.0, 240.0, 1000.0])
def test_cuts_last_as_long_at_any_rate_but_hold_frames_enough_to_see_velocities(rate: float) -> None:
    frames = IMPACTS.frames(1 / rate)
    lasting = (IMPACTS.lead, IMPACTS.trail, IMPACTS.longest, IMPACTS.least)
    assert all(
        count == fewest or abs(count / rate - time) <= 0.51 / rate
        for count, time, fewest in zip(frames, lasting, IMPACTS.fewest, strict=True)
    )


def test_each_segment_has_its_value_on_its_frames() -> None:
    segments = around(40)
    spread, position = segments.spread(torch.arange(len(segments))), segments.position
    for number, (row, start, size) in enumerate(zip(segments.trajectory, segments.start, segments.size, strict=True)):
        assert (spread[row, start : start + size] == number).all()
        assert torch.equal(position[row, start : start + size], torch.arange(int(size)))


@pytest.mark.parametrize("parts", [1, 2, 3, 100])
def test_parts_of_a_batch_are_all_of_it_with_the_longest_segments_first(parts: int) -> None:
    for batch in around(3, 40, 60, 100, 149).batches:
        split = batch.split(parts)
        assert len(split) == min(parts, len(batch.segments))
        assert sorted(torch.cat([part.segments for part in split]).tolist()) == sorted(batch.segments.tolist())
        for part in split:
            assert part.inside.sum(1).diff().le(0).all()
            rows = [batch.segments.tolist().index(segment) for segment in part.segments.tolist()]
            assert torch.equal(part.frame, batch.frame[rows])
            assert torch.equal(part.trajectory, batch.trajectory[rows])


@pytest.mark.parametrize("frames", [2, 7, 8])
def test_pairs_from_both_first_frames_hold_every_step_once(frames: int) -> None:
    steps = torch.zeros(3, frames - 1)
    for first in (0, 1):
        pairs = Segmentation.pairs(3, frames, first)
        steps[pairs.trajectory, pairs.start] += 1
        assert (pairs.size == 2).all()
        assert (pairs.start + 1 < frames).all()
    assert (steps == 1).all()
