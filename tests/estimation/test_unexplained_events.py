"""What a fit leaves at impacts is said where it is most of them, however little it counts in the fit."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from physid.estimation.measurement import Noise
from physid.estimation.prediction import CutRule, Segmentation
from physid.estimation.segmented_fit import (
    UnexplainedSettings,
    squares_of_segments,
    unexplained_events,
)

NOISE = Noise(rotation=2e-3, position=3e-4)
FLOORS = torch.tensor([NOISE.rotation_floor, NOISE.floor]).double()
SETTINGS = UnexplainedSettings()
STRUCK = torch.arange(14) < 12


def left_by(*times: float) -> Tensor:
    """Return mean squares of segments that leave so many times the floors, (K, 2)."""
    return (torch.tensor(times).double()[:, None] * FLOORS).square()


def test_what_many_segments_with_an_event_leave_is_their_median_beyond_noise() -> None:
    found = unexplained_events(left_by(*[1] * 5, 3, 3, 3, 5, 9, 9, 9, 40, 40), STRUCK, NOISE, SETTINGS)
    assert found is not None
    assert (found.unexplained, found.among) == (7, 12)
    beyond = 24**0.5  # the median is 5 times the floor, of which one is noise
    assert (found.position, found.rotation) == pytest.approx((beyond * NOISE.floor, beyond * NOISE.rotation_floor))


@pytest.mark.parametrize("times", [(1,) * 6 + (50,) * 8, (1.4,) * 14, (0.7,) * 14])
def test_a_few_of_them_may_be_chance_and_so_may_what_noise_explains(times: tuple[float, ...]) -> None:
    assert unexplained_events(left_by(*times), STRUCK, NOISE, SETTINGS) is None


@pytest.mark.parametrize("among", [3, 12, 40, 200])
def test_a_right_model_fails_by_chance_as_seldom_as_is_said(among: int) -> None:
    generator, sets = torch.Generator().manual_seed(among), 2000
    lost = torch.rand(sets, among, generator=generator) < SETTINGS.usual
    struck = torch.ones(among).bool()
    said = sum(
        unexplained_events(left_by(*(1 + 9 * row.double())), struck, NOISE, SETTINGS) is not None for row in lost
    )
    assert said <= sets * SETTINGS.chance + 3 * (sets * SETTINGS.chance) ** 0.5


def test_a_segment_of_which_nothing_was_seen_is_neither_explained_nor_not() -> None:
    found = unexplained_events(left_by(*[1] * 2, *[0] * 4, *[3] * 6, 1, 1), STRUCK, NOISE, SETTINGS)
    assert found is not None
    assert (found.unexplained, found.among) == (6, 8)


def test_without_an_event_nothing_is_said() -> None:
    assert unexplained_events(left_by(*[9.0] * 14), torch.zeros(14).bool(), NOISE, SETTINGS) is None


def test_what_is_unexplained_and_how_many_by_chance_is_set() -> None:
    square = left_by(*[1] * 6, *[3] * 6, 1, 1)
    assert unexplained_events(square, STRUCK, NOISE, SETTINGS.model_copy(update={"usual": 0.1})) is not None
    assert unexplained_events(square, STRUCK, NOISE, SETTINGS.model_copy(update={"chance": 0.1})) is not None
    larger = SETTINGS.model_copy(update={"misfit": 10.0, "usual": 0.1})
    assert unexplained_events(square, STRUCK, NOISE, larger) is None


def test_segments_around_an_event_hold_it_or_not() -> None:
    events = torch.zeros(2, 60).bool()
    events[0, 30] = True
    segments = Segmentation.around(events, CutRule(), 1 / 100)
    inside = [
        bool(events[row, first : first + size].any())
        for row, first, size in zip(segments.trajectory, segments.start, segments.size, strict=True)
    ]
    assert segments.struck.tolist() == inside
    assert int(segments.struck.sum()) == 1 < int(segments.contact.sum())
    assert segments.only(torch.tensor([1, 2])).struck.tolist() == inside[1:3]


def test_squares_are_means_over_frames_that_are_present_but_for_the_worst() -> None:
    generator = torch.Generator().manual_seed(0)
    residual = torch.randn(2, 20, 2, 6, generator=generator).double()
    residual[0, 3] += 1e3  # a frame that stands alone
    present = torch.ones(2, 20, 2).double()
    present[1, 12:, 1] = 0
    segments = Segmentation.equal(2, 20, 10)
    square = squares_of_segments(segments, residual, present)
    for k, (row, first) in enumerate(zip(segments.trajectory.tolist(), segments.start.tolist(), strict=True)):
        part, seen = residual[row, first : first + 10], present[row, first : first + 10]
        for kind, axes in enumerate((slice(0, 3), slice(3, 6))):
            length = part[..., axes].square().sum(-1) * seen
            kept = torch.arange(10) != int((length.sum(1) / seen.sum(1)).argmax())
            assert float(square[k, kind]) == pytest.approx(float(length[kept].sum() / seen[kept].sum()))
    assert float(square.max()) < 1e2


def test_a_segment_that_nobody_saw_has_no_misfit() -> None:
    square = squares_of_segments(Segmentation.equal(1, 8, 8), torch.ones(1, 8, 1, 6).double(), torch.zeros(1, 8, 1))
    assert square.tolist() == [[0.0, 0.0]]
