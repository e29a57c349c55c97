"""Forces that change steadily from row to row: imported along the lines, and distinguished from a clock that is off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.data.logs import write_csv

from physid.data import RecordingSet
from physid.data.importers.convert import import_logs
from physid.data.importers.reading_logs import along_lines
from physid.inspection.examination import examine

MASS, FRICTION, GRAVITY, ROWS = 1.0, 0.2, 9.81, 0.05
MAPPING = {
    "time": "t", "position": ["x", "y", "z"], "orientation": "none", "force": ["fx", "fy", "fz"],
    "forces": {"file": "{stem}_forces.csv", "time": "t"}, "size": [0.2, 0.2, 0.1], "mass": MASS,
    "unknown": ["block.friction"],
}  # fmt: skip
LINEAR = MAPPING | {"forces": {"file": "{stem}_forces.csv", "time": "t", "between": "linear"}}


def pushes(folder: Path, count: int = 6) -> list[Path]:
    """Log blocks that slide ever on, under a force whose corners alone are logged, 20 of them a second."""
    random, logs = np.random.default_rng(3), []
    fine, time = np.arange(0, 2, 1e-4), np.arange(90) / 60
    for number in range(count):
        stamps, corners = ROWS * np.arange(40), random.uniform(2.5, 7, 40)
        push = np.interp(fine, stamps, corners)
        speed = np.cumsum(push / MASS - FRICTION * GRAVITY) * 1e-4
        place = np.interp(time, fine, np.cumsum(speed) * 1e-4) + random.normal(0, 2e-4, len(time))
        level = [0 * time, 0 * time + 0.05]
        logs.append(write_csv(folder / f"run{number}.csv", ["t", "x", "y", "z"], [time, place, *level]))
        write_csv(folder / f"run{number}_forces.csv", ["t", "fx", "fy", "fz"], [stamps, corners, *np.zeros((2, 40))])
    return logs


def imported(logs: list[Path], out: Path, linear: bool) -> RecordingSet:
    return RecordingSet(import_logs(logs, LINEAR if linear else MAPPING, out).folder)


def held(time: NDArray[np.float64], stamps: NDArray[np.float64], force: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(force[np.searchsorted(stamps, time, side="right") - 1])


def test_along_lines_forces_are_near_them_and_have_their_impulse(tmp_path: Path) -> None:
    logs = pushes(tmp_path, 1)
    before, after = (imported(logs, tmp_path / str(linear), linear).read(0) for linear in (False, True))
    assert before.wrench is not None and after.wrench is not None  # noqa: PT018
    assert before.wrench_time is not None and after.wrench_time is not None  # noqa: PT018
    corners, steps = before.wrench[:, 0, 3], after.wrench[:, 0, 3]
    between = np.linspace(before.wrench_time[0], before.wrench_time[-1], 5000, endpoint=False)
    line = np.interp(between, before.wrench_time, corners)
    off = np.abs(held(between, after.wrench_time, steps) - line)
    assert off.max() <= np.abs(np.diff(corners)).max() / 16 + 1e-9
    lasting = np.diff(after.wrench_time)
    for first, last, one, other in zip(
        before.wrench_time[:-1], before.wrench_time[1:], corners[:-1], corners[1:], strict=True
    ):
        inside = (after.wrench_time[:-1] >= first - 1e-9) & (after.wrench_time[:-1] < last - 1e-9)
        assert (lasting * steps[:-1])[inside].sum() == pytest.approx((last - first) * (one + other) / 2)


def test_no_line_leads_from_a_trajectory_to_the_next_in_the_same_file(tmp_path: Path) -> None:
    time = np.tile(np.arange(30) / 60, 2)
    number, push = np.repeat([0, 1], 30), np.r_[np.full(30, 3.0), np.full(30, 5.0)]
    columns = [time, number, time, 0 * time, 0 * time + 0.05, push, 0 * time, 0 * time]
    log = write_csv(tmp_path / "log.csv", ["t", "n", "x", "y", "z", "fx", "fy", "fz"], columns)
    mapping = MAPPING | {"trajectory": "n", "forces": {"between": "linear"}}
    recordings = RecordingSet(import_logs([log], mapping, tmp_path / "out").folder)
    for index, expected in enumerate((3.0, 5.0)):
        wrench = recordings.read(index).wrench
        assert wrench is not None
        assert set(np.unique(wrench[:, 0, 3])) == {expected}


def test_check_asks_whether_forces_that_seem_half_a_row_late_change_steadily(tmp_path: Path) -> None:
    logs = pushes(tmp_path)
    found = [one for one in examine(imported(logs, tmp_path / "held", False), range(6)) if "clocks" in one.what]
    assert len(found) == 1
    assert "forces.between=linear if they change steadily; else import with forces.offset=-0.02" in found[0].mend
    assert not [one for one in examine(imported(logs, tmp_path / "lines", True), range(6)) if "clocks" in one.what]


def test_lines_need_stamps(tmp_path: Path) -> None:
    time = np.arange(30) / 60
    log = write_csv(tmp_path / "log.csv", ["x", "y", "z", "fx", "fy", "fz"], [time, time, time, time, time, time])
    mapping = {key: value for key, value in MAPPING.items() if key != "time"}
    mapping |= {"time_step": 1 / 60, "forces": {"between": "linear"}}
    with pytest.raises(ValueError, match=r"expected stamps for forces\.between=linear, found none; say time"):
        import_logs([log], mapping, tmp_path / "out")


def test_another_word_is_answered(tmp_path: Path) -> None:
    wrong = MAPPING | {"forces": {"file": "{stem}_forces.csv", "time": "t", "between": "lines"}}
    with pytest.raises(ValueError, match=r"forces\.between"):
        import_logs(pushes(tmp_path, 1), wrong, tmp_path / "out")


@pytest.mark.parametrize(("rate", "parts"), [(20, 8), (60, 8), (120, 4), (240, 2), (500, 1), (2000, 1)])
def test_rows_are_cut_as_far_as_an_eighth_of_a_frame_and_keep_the_impulse(rate: float, parts: int) -> None:
    time = np.arange(40) / rate
    wrench = np.random.default_rng(0).standard_normal((40, 2, 6))
    stamps, held = along_lines(time, wrench, 1 / 60)
    assert len(stamps) == len(held) == 39 * parts + 1
    whole = (held[:-1] * np.diff(stamps)[:, None, None]).sum(0)
    assert whole == pytest.approx(np.trapezoid(wrench, time, axis=0))
    assert stamps[::parts] == pytest.approx(time)


@pytest.mark.parametrize("between", [None, "held", "linear"])
def test_an_import_says_that_forces_are_held_unless_the_mapping_does(between: str | None, tmp_path: Path) -> None:
    forces = {"file": "{stem}_forces.csv", "time": "t"} | ({} if between is None else {"between": between})
    done = import_logs(pushes(tmp_path, 2), MAPPING | {"forces": forces}, tmp_path / "set")
    reported = [note for note in done.notes if "each row is held until the next" in note]
    assert len(reported) == (between is None)
    assert all("50 ms later" in one and "25 ms too late: forces.between=linear" in one for one in reported)
