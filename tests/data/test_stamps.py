"""Stamps that jitter or miss frames are data; stamps of another rate, or of another clock, are mistakes."""

import numpy as np
import pytest
from numpy.typing import NDArray

from physid.data import Recording
from physid.data.observations.remarks import remarks_on
from physid.data.observations.stamps import check_clocks, rhythm_of

SIZES = np.array([[0.3, 0.2, 0.2]])
RATE = 60.0


def stamps(
    frames: int, rate: float = RATE, jitter: float = 0.0, missing: float = 0.0, seed: int = 0
) -> NDArray[np.float64]:
    """Return stamps with uniform jitter (share of a period), some of them left out."""
    generator = np.random.default_rng(seed)
    number = np.flatnonzero(generator.random(2 * frames) >= missing)[:frames]
    return np.asarray((number + generator.uniform(-jitter, jitter, frames)) / rate)


def moving(time: NDArray[np.float64] | None, frames: int = 0, **forces: NDArray[np.float64]) -> Recording:
    """Return a recording of one body with these stamps."""
    pose = np.zeros((frames or len(time), 1, 7))  # type: ignore[arg-type]
    pose[..., 6] = 1
    return Recording(pose=pose, time=time, **forces)


@pytest.mark.parametrize("frames", [12, 40, 300])
@pytest.mark.parametrize("seed", range(5))
def test_jitter_of_a_fifth_and_a_tenth_of_the_frames_missing_pass(frames: int, seed: int) -> None:
    check_clocks(moving(stamps(frames, jitter=0.2, missing=0.1, seed=seed)), 1 / RATE)


@pytest.mark.parametrize("found", [29.97, 30.0 * 1.005])
def test_what_cameras_clocks_are_off_passes(found: float) -> None:
    check_clocks(moving(stamps(300, found)), 1 / 30)


@pytest.mark.parametrize(
    ("found", "remedy"),
    [
        (240.0, "if the stamps are right, write time_step: 0.00416667 into recording.yaml"),
        (50.0, "write time_step: 0.02"),
        (62.0, "write time_step: 0.016129"),
        (15.0, "write time_step: 0.0666667"),
        (0.06, "these are milliseconds: divide the stamps by 1000"),
        (6e-5, r"these are microseconds: divide the stamps by 1e\+06"),
        (6e-8, r"these are nanoseconds: divide the stamps by 1e\+09"),
        (1.0, "these count frames: leave `time` out, or multiply it by time_step"),
    ],
)
@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_another_rate_is_refused_with_both_rates_and_the_remedy(found: float, remedy: str, jitter: float) -> None:
    if found == 1.0 and jitter:
        return
    remedy = remedy if jitter == 0 else remedy.partition(":")[0]
    with pytest.raises(ValueError, match=rf"time: expected about 60 frames per second .*, found .*{remedy}"):
        check_clocks(moving(stamps(200, found, jitter, missing=jitter / 2)), 1 / RATE)


def test_period_jitter_and_holes_are_found() -> None:
    time = stamps(300, jitter=0.2, missing=0.1)
    rhythm = rhythm_of(time + 1.7e9)
    assert rhythm.period * RATE == pytest.approx(1, abs=1e-3)
    assert rhythm.jitter * RATE == pytest.approx(0.2 / np.sqrt(3), rel=0.1)
    assert rhythm.change is None
    assert rhythm_of(np.delete(np.arange(100) / RATE, [10, 20, 21])).missing == 3


def test_a_rate_that_changes_is_remarked_with_the_frame() -> None:
    slower = np.append(np.arange(150) / RATE, 150 / RATE + np.arange(100) / 30)
    check_clocks(moving(slower), 1 / RATE)
    (remark,) = remarks_on(moving(slower), 1 / RATE, SIZES)
    assert "changes from 60 to 30 frames per second in frame 150" in remark.text
    assert not remarks_on(moving(stamps(300, jitter=0.2, missing=0.1)), 1 / RATE, SIZES)


@pytest.mark.parametrize(("shift", "rate"), [(1.7e9, 500.0), (-100.0, 500.0), (6.0, 500.0)])
def test_two_clocks_that_never_overlap_are_refused(shift: float, rate: float) -> None:
    rows = np.zeros((500, 1, 6))
    with pytest.raises(ValueError, match="the two never overlap; shift one clock by the offset"):
        check_clocks(moving(stamps(300), wrench=rows, wrench_time=np.arange(500) / rate + shift), 1 / RATE)


def test_a_single_row_of_forces_holds_for_the_whole_trajectory() -> None:
    check_clocks(moving(stamps(300), wrench=np.ones((1, 1, 6)), wrench_time=np.zeros(1)), 1 / RATE)


def test_forces_that_begin_late_or_end_early_are_remarked() -> None:
    rows = np.ones((100, 1, 6))
    late = moving(stamps(300), wrench=rows, wrench_time=1 + np.arange(100) / 100)
    begin, end = remarks_on(late, 1 / RATE, SIZES)
    assert "forces begin 1 s after the poses" in begin.text
    assert "forces end 2.99 s before the poses" in end.text


@pytest.mark.parametrize(
    ("time", "message"),
    [
        ([0.0, 0.1, 0.1], "found 0.1 s in frame 2, the same again"),
        ([0.0, 0.1, 0.05], "found 0.05 s in frame 2, after 0.1 s; sort the rows by time"),
    ],
)
def test_time_that_doubles_or_runs_back_is_refused(time: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=f"time: expected increasing times, {message}"):
        moving(np.array(time))


@pytest.mark.parametrize("gap", [20.0, 3600.0, 1e9])
def test_a_gap_of_many_more_frames_than_there_are_is_refused_at_once(gap: float) -> None:
    time = stamps(60)
    time[30:] += gap
    with pytest.raises(ValueError, match=r"found none for .* s after frame 29; cut the recording there"):
        check_clocks(moving(time), 1 / RATE)


def test_a_gap_of_several_times_the_frames_there_are_passes() -> None:
    time = stamps(60)
    time[30:] += 5.0
    check_clocks(moving(time), 1 / RATE)


def test_another_rate_or_bursts_are_no_gap() -> None:
    slower = np.concatenate([np.arange(1000) / 1000, 1 + np.arange(500) / 10])
    assert rhythm_of(slower).change is not None
    bursts = (np.arange(100)[:, None] * 0.05 + np.arange(10) * 1e-4).ravel()
    assert rhythm_of(bursts).period < 1e-3
    with pytest.raises(ValueError, match=r"found none for .* after frame 1200"):
        rhythm_of(np.concatenate([slower[:1201], slower[1201:] + 1e6]))
