"""Windows: every frame in exactly one, sums that agree, hits with a lead before them."""

from __future__ import annotations

import pytest
import torch

from physid.estimation.prediction.segments import HITS, Windows


def around(*hits: int, frames: int = 150) -> Windows:
    events = torch.zeros(2, frames, dtype=torch.bool)
    events[0, list(hits)] = True
    return Windows.around(events, HITS)


@pytest.mark.parametrize("windows", [Windows.equal(3, 121, 30), around(), around(40), around(3, 60, 64, 149)])
def test_every_frame_is_in_exactly_one_window(windows: Windows) -> None:
    assert windows.sum_windows(windows.size).tolist() == [windows.frames] * windows.trajectories
    counted = torch.zeros(windows.trajectories, windows.frames)
    for row, start, size in zip(windows.trajectory, windows.start, windows.size, strict=True):
        counted[row, start : start + size] += 1
    assert (counted == 1).all()
    assert int(windows.size.min()) > 1


def test_equal_windows_are_equal_but_for_one_frame() -> None:
    size = Windows.equal(1, 121, 30).size
    assert int(size.max()) <= 30
    assert int(size.max() - size.min()) <= 1


def test_what_is_cut_is_put_back_where_it_was() -> None:
    windows = around(40, 100)
    value = torch.randn(1, 2, 150, 3, generator=torch.Generator().manual_seed(0))
    back = torch.zeros_like(value)
    for batch in windows.batches:
        batch.put(batch.cut(value), back)
    assert torch.equal(back, value)


def test_sums_over_frames_and_windows_are_sums_over_trajectories() -> None:
    windows = around(40, 100)
    value = torch.rand(1, 2, 150, generator=torch.Generator().manual_seed(0))
    whole = windows.sum_windows(windows.sum_frames(value)[0])
    assert torch.allclose(whole, value.sum(2)[0])


def test_a_calm_trajectory_is_one_window_and_a_hit_has_a_short_busy_one() -> None:
    windows = around(40)
    assert windows.size[windows.trajectory == 1].tolist() == [150]
    busy = windows.busy & (windows.trajectory == 0)
    assert int(windows.start[busy].min()) == 40 - HITS.lead
    assert int((windows.start + windows.size)[busy].max()) == 40 + HITS.trail + 1
    assert int(windows.size[busy].max()) <= HITS.longest


def test_each_window_has_its_value_on_its_frames() -> None:
    windows = around(40)
    spread = windows.spread(torch.arange(len(windows)))
    for number, (row, start, size) in enumerate(zip(windows.trajectory, windows.start, windows.size, strict=True)):
        assert (spread[row, start : start + size] == number).all()


@pytest.mark.parametrize("parts", [1, 2, 3, 100])
def test_parts_of_a_batch_are_all_of_it_with_the_longest_windows_first(parts: int) -> None:
    for batch in around(3, 40, 60, 100, 149).batches:
        split = batch.split(parts)
        assert len(split) == min(parts, len(batch.windows))
        assert sorted(torch.cat([part.windows for part in split]).tolist()) == sorted(batch.windows.tolist())
        for part in split:
            assert part.inside.sum(1).diff().le(0).all()
            rows = [batch.windows.tolist().index(window) for window in part.windows.tolist()]
            assert torch.equal(part.frame, batch.frame[rows])
            assert torch.equal(part.trajectory, batch.trajectory[rows])
