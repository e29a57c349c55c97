"""A frame rate too low for the motion: one law, said by check, fit and diagnose with trajectory and frames."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.data.sets import SCENE, write_set

from physid.cli import main
from physid.data import Recording, RecordingSet
from physid.data.observations.remarks import NEXT, TURN, pace_of, remarks_on
from physid.inspection.examination import examine, require_usable_set
from physid.scenes.rotations import from_vector

STEP, EDGE = SCENE.time_step, float(SCENE.sizes.min())
TOO_LOW = "the frame rate is too low for the motion"


def moving(way: float = 0.0, turn: float = 0.0, frames: int = 12, time: NDArray[np.float64] | None = None) -> Recording:
    """Return a body that goes so far [m] and turns so much [rad] between any two frames."""
    count = np.arange(frames, dtype=np.float64)
    place = np.outer(count, [way, 0.0, 0.0])
    turned = from_vector(np.outer(count, [0.0, 0.0, turn]))
    return Recording(pose=np.concatenate([place, turned], 1)[:, None], time=time)


@pytest.mark.parametrize(
    ("recording", "named"),
    [
        (moving(0.99 * EDGE, 0.99 * TURN), False),
        (moving(way=1.01 * EDGE), True),
        (moving(turn=1.01 * TURN), True),
        (moving(), False),
    ],
)
def test_a_body_that_goes_an_edge_or_turns_a_radian_between_frames_is_too_fast(
    recording: Recording, named: bool
) -> None:
    said = [one.text for one in remarks_on(recording, STEP, SCENE.sizes)]
    assert bool(said) == named
    if named:
        assert "from frame 0, 1, 2, 3, 4 and 6 more" in said[0]
        needed = float(pace_of(recording, STEP, SCENE.sizes).max()) / STEP
        assert f"record {needed:.3g} frames per second" in said[0]


def test_lost_frames_and_bodies_that_were_not_seen_say_nothing_of_the_rate() -> None:
    time = STEP * np.arange(12.0)
    time[6:] += NEXT * STEP
    steady = moving(0.9 * EDGE, time=time)
    assert steady.pose is not None
    jump = steady.pose.copy()
    jump[6:, 0, 0] += EDGE
    jump[3] = np.nan
    assert not remarks_on(Recording(pose=jump, time=time), STEP, SCENE.sizes)


def test_check_fit_and_diagnose_say_it_of_the_same_frames(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    slow, fast = moving(0.1 * EDGE), moving(0.1 * EDGE)
    assert fast.pose is not None
    fast.pose[5:, 0, 0] += 1.5 * EDGE
    recordings = RecordingSet(write_set(tmp_path, [slow, fast]))
    main(["check", str(tmp_path)])
    assert f"trajectory 1: pose: {TOO_LOW}: from frame 4 " in " ".join(capsys.readouterr().out.split())
    for found in (examine(recordings, [0, 1]), require_usable_set(recordings, [0, 1])):
        (said,) = (one.what for one in found if TOO_LOW in one.what)
        assert said.startswith(f"trajectory 1: pose: {TOO_LOW}: from frame 4 ")


def test_a_remark_on_many_trajectories_is_said_once_with_the_list_of_them(tmp_path: Path) -> None:
    rows, time = np.ones((20, 1, 6)), STEP * np.arange(12.0)
    short, long, begin = 3 * STEP, 5 * STEP, "wrench_time: forces begin"

    def late(by: float) -> Recording:
        clock = by + STEP * np.arange(20.0)
        return dataclasses.replace(moving(0.1 * EDGE, time=time), wrench=rows, wrench_time=clock)

    for name, starts, said in (
        ("alike", [short] * 8, f"trajectories 0, 1, 2, 3, 4 and 3 more: {begin} {short:.3g} s after"),
        ("unlike", [short, long, 0.0], f"trajectories 0, 1 (most in 1): {begin} {long:.3g} s after"),
        ("one", [0.0, 0.0, short], f"trajectory 2: {begin} {short:.3g} s after"),
        ("none", [0.0, 0.0], None),
    ):
        recordings = RecordingSet(write_set(tmp_path / name, [late(by) for by in starts]))
        found = [one.what for one in examine(recordings, range(len(starts))) if "wrench_time" in one.what]
        assert [one.startswith(str(said)) for one in found] == [True] * (said is not None)


@pytest.mark.parametrize("tolerance", ["0", "-0.001"])
def test_a_tolerance_of_nothing_is_refused_before_anything_is_computed(
    tolerance: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_set(tmp_path / "set", [moving()])
    assert main(["diagnose", str(tmp_path / "set"), "--tolerance", tolerance]) == 2
    assert "materiality.tolerance: expected greater than 0, got " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("break_clock", "message"),
    [
        (lambda time: time[::-1], "sort the rows by time"),
        (lambda time: 1000 * time, "milliseconds"),
    ],
)
def test_stamps_that_run_back_or_are_of_another_unit_end_every_command_in_one_line(
    break_clock: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    import h5py

    folder = write_set(tmp_path / "set", [moving(frames=40, time=STEP * np.arange(40.0))])
    path = RecordingSet(folder).paths[0]
    with h5py.File(path, "r+") as file:
        file["time"][:] = break_clock(file["time"][:])
    for words in (["check", str(folder)], ["diagnose", str(folder), "--out", str(tmp_path / "out")]):
        assert main(words) != 0
        said = capsys.readouterr()
        line = " ".join((said.out + said.err).split())
        assert message in line
        assert path.name in line or "trajectory 0" in line
        assert "Traceback" not in line
