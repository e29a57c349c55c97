"""How much a frame counts: which stand alone, and that those that are not there have no say."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from physid.estimation.measurement.outliers import _from_what_ends_continue, frame_weights
from physid.estimation.measurement.sensor_noise import Noise

FRAMES = 60
NOISE = Noise(rotation=0.004, position=0.001)
TIME = torch.arange(FRAMES, dtype=torch.float64)[None] / 30


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize(("away", "weight"), [(2.9, 1.0), (4.0, 0.75), (5.0, 0.6), (20.0, 0.0)])
def test_a_frame_that_stands_alone_counts_less_from_three_deviations_on(axis: int, away: float, weight: float) -> None:
    residual = torch.zeros(1, FRAMES, 2, 6).double()
    residual[0, 30, 1, axis] = -away * float(NOISE.spread()[axis])
    found = frame_weights(residual, torch.ones(1, FRAMES, 2), TIME, NOISE)
    assert float(found[0, 30, 1]) == pytest.approx(weight)
    found[0, 30, 1] = 1.0
    assert bool((found == 1).all())


def test_a_frame_is_wild_from_six_deviations_on_from_what_both_sides_lead_to() -> None:
    """A line through two frames enlarges white noise by the root of 1 + 4 + 1."""
    for factor, counts in ((0.99, True), (1.01, False)):
        residual = torch.zeros(1, FRAMES, 1, 6).double()
        residual[0, 30, 0, 3] = factor * 6 * 6**0.5 * NOISE.position
        found = frame_weights(residual, torch.ones(1, FRAMES, 1), TIME, NOISE)
        assert bool(found[0, 30, 0] > 0) is counts


@pytest.mark.parametrize("there", [True, False])
def test_frames_that_are_not_there_excuse_none_beside_them(there: bool) -> None:
    residual, present = torch.zeros(1, FRAMES, 1, 6).double(), torch.ones(1, FRAMES, 1)
    residual[0, 30, 0, 3], residual[0, 31, 0, 3] = 20 * NOISE.position, 10 * NOISE.position  # on a line with the next
    present[0, 31:33] = float(there)
    assert bool(frame_weights(residual, present, TIME, NOISE)[0, 30, 0] > 0) is there


def with_gaps() -> tuple[Tensor, Tensor]:
    """Return residuals with a few outliers (8, T, 2, 6), and the frames that are there, three of four (8, T, 2)."""
    generator = torch.Generator().manual_seed(2)
    residual = torch.randn(8, FRAMES, 2, 6, generator=generator, dtype=torch.float64) * NOISE.spread()
    drawn = torch.rand(2, 8, FRAMES, 2, generator=generator)
    residual[drawn[0] < 0.05] *= 20
    return residual, (drawn[1] < 0.75).double()


@pytest.mark.parametrize("stands", [0.0, -1e3, torch.inf, torch.nan])
def test_weights_do_not_depend_on_what_stands_in_frames_that_are_not_there(stands: float) -> None:
    residual, present = with_gaps()
    found = frame_weights(residual, present, TIME.expand(8, -1), NOISE)
    other = torch.where(present[..., None] > 0, residual, stands)
    assert torch.equal(found, frame_weights(other, present, TIME.expand(8, -1), NOISE))
    assert ((found > 0) & (found < 1)).any()
    assert (found[present == 0] == 0).all()


def test_weights_do_not_depend_on_the_signs_of_axes_nor_on_frames_before_and_after_all_that_are_there() -> None:
    residual, present = with_gaps()
    time = TIME.expand(8, -1)
    found = frame_weights(residual, present, time, NOISE)
    assert torch.equal(found, frame_weights(-residual, present, time, NOISE))
    present[:, :7], present[:, 50:] = 0.0, 0.0
    present[:, 7], present[:, 49] = 1.0, 1.0
    cut = (value[:, 7:50] for value in (residual, present, time))
    assert torch.equal(frame_weights(residual, present, time, NOISE)[:, 7:50], frame_weights(*cut, NOISE))


def test_a_frame_is_judged_by_those_of_its_neighbours_that_are_there() -> None:
    residual, present = torch.zeros(1, FRAMES, 1, 6).double(), torch.ones(1, FRAMES, 1)
    residual[0, 28:33, 0, 3] = NOISE.position * torch.tensor([0.0, 8.0, 8.0, 8.0, 0.0]).double()
    assert bool((frame_weights(residual, present, TIME, NOISE) == 1).all())  # three of five move together
    present[0, 29] = 0.0  # of four, two: half way between
    found = frame_weights(residual, present, TIME, NOISE)[0, 27:33, 0]
    assert found.tolist() == pytest.approx([1.0, 1.0, 0.0, 0.75, 0.75, 1.0])


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 5])
def test_short_recordings_have_weights_and_frames_that_are_not_there_none(frames: int) -> None:
    present = torch.ones(1, frames, 1)
    present[0, -1] = 0.0
    found = frame_weights(torch.zeros(1, frames, 1, 6).double(), present, TIME[:, :frames], NOISE)
    assert torch.equal(found, present.to(found))


def test_a_frame_that_counts_by_a_part_has_that_part_of_its_weight() -> None:
    residual, present = with_gaps()
    time, part = TIME.expand(8, -1), 0.5 + 0.5 * torch.rand(8, FRAMES, 2, generator=torch.Generator().manual_seed(5))
    found = frame_weights(residual, present * part, time, NOISE)
    assert torch.allclose(found, part * frame_weights(residual, present, time, NOISE))


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize(("start", "gap", "seen"), [(0, None, True), (7, None, True), (7, 5, False), (54, None, True)])
def test_an_end_that_leaves_the_line_of_the_five_beside_it_counts_only_where_one_of_them_is_not_there(
    late: bool, start: int, gap: int | None, seen: bool
) -> None:
    """The residuals grow as those of a wrong speed do: such a line has no end that stands alone."""
    residual, present = torch.zeros(1, FRAMES, 2, 6).double(), torch.ones(1, FRAMES, 2)
    residual[0, :, 0, 4] = 0.03 * TIME[0]
    present[0, :start] = 0.0
    if gap is not None:
        present[0, start + gap] = 0.0
    for off in (0.0, 20 * NOISE.position):
        moved = residual.clone()
        moved[0, start, 0, 4] += off
        expected = present.clone()
        expected[0, start, 0] = 0.0 if off and seen else 1.0
        found = frame_weights(*((each.flip(1) if late else each) for each in (moved, present)), TIME, NOISE)
        assert torch.equal(found.flip(1) if late else found, expected.to(found))


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
def test_where_fewer_than_six_frames_count_none_is_an_end_that_stands_alone(count: int) -> None:
    for place in (slice(0, count), slice(FRAMES - count, None)):
        residual, present = torch.zeros(1, FRAMES, 1, 6).double(), torch.zeros(1, FRAMES, 1)
        present[:, place] = 1.0
        residual[0, place, 0, 3] = 1e3 * torch.arange(count).double()
        assert torch.equal(frame_weights(residual, present, TIME, NOISE), present.to(residual))


def test_how_far_an_end_may_leave_its_line_is_what_least_squares_of_five_enlarge_noise_by() -> None:
    """Five even steps: 1 + 1/5 + 9/10; the line of two alone would admit 6 times the root of 6."""
    generator = torch.Generator().manual_seed(8)
    residual = torch.randn(4000, 6, 1, 6, generator=generator).double() * NOISE.spread()
    off = _from_what_ends_continue(residual, TIME[:, :6].expand(4000, -1), torch.ones(4000, 6, 1, dtype=torch.bool))
    for end in (0, -1):
        spread = (off[:, end, 0] / NOISE.spread()).std(0)
        assert spread.tolist() == pytest.approx([1.0] * 6, abs=0.08)  # the median is less exact than the mean
    assert (off[:, 1:-1] == 0).all()
