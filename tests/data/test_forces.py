"""Planned forces, from a file that a user writes by hand or with NumPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physid.data.forces import read_forces
from physid.scenes import find_setup

SCENE = find_setup("collide").scene


def test_columns_of_a_table_land_in_their_place_and_the_rest_is_zero(tmp_path: Path) -> None:
    path = tmp_path / "planned.csv"
    path.write_text("other.torque_z, block.force_x\n0.5, 4\n\n-1e-1, 5\n")
    expected = np.zeros((3, 2, 6))
    expected[:2, 0, 3] = 4, 5
    expected[:2, 1, 2] = 0.5, -0.1
    assert np.array_equal(read_forces(path, SCENE), expected)


def test_an_array_is_taken_as_it_is(tmp_path: Path) -> None:
    wrench = np.random.default_rng(0).normal(size=(4, 2, 6))
    np.save(tmp_path / "planned.npy", wrench)
    read = read_forces(tmp_path / "planned.npy", SCENE)
    assert np.array_equal(read[:-1], wrench)
    assert not read[-1].any()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("planned.txt", "1", "expected planned forces as .csv or .npy, found .txt"),
        ("planned.csv", "block.forcex\n1\n", 'unknown column "block.forcex"; did you mean "block.force_x"?'),
        ("planned.csv", "block.force_x\n1,2\n", "expected 1 numbers in row 0, found 1, 2"),
        ("planned.csv", "block.force_x\n1\nmuch\n", "expected 1 numbers in row 1, found much"),
        ("planned.csv", "block.force_x\n1\nnan\n", "expected finite numbers, found nan in row 1"),
        ("planned.csv", "block.force_x\n", "expected a row of forces for each time step, found none"),
        ("planned.csv", "", "expected a row of forces for each time step, found none"),
        ("planned.npy", "no array", "expected a NumPy array"),
    ],
)
def test_a_mistake_names_the_file_and_what_was_expected(name: str, content: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(ValueError, match=f"{name}: ") as error:
        read_forces(path, SCENE)
    assert message in str(error.value)


def test_an_array_of_another_shape_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "planned.npy", np.zeros((3, 1, 6)))
    with pytest.raises(ValueError, match=r"shape \(n, 2, 6\), found float64 \(3, 1, 6\)"):
        read_forces(tmp_path / "planned.npy", SCENE)


def test_columns_may_say_their_unit_and_come_once_each(tmp_path: Path) -> None:
    path = tmp_path / "forces.csv"
    path.write_text("block.force_x [mN],block.torque_z (N mm),block.force_y\n500,20,2\n")
    assert read_forces(path, SCENE)[0, 0].tolist() == pytest.approx([0, 0, 0.02, 0.5, 2, 0])
    for header, message in (
        ("block.force_x,block.force_x [N]", "expected each column once, found .block.force_x. 2 times"),
        ("t [s],block.force_x", "expected stamps that begin with 0, the first frame, and increase, found .1.0."),
        ("time_s,block.force_x", "subtract the stamp of the first frame"),
        ("t,time", 'unknown column "time"'),
        ("t [N],block.force_x", 't .N.: unknown unit "N"'),
        ("block.force_x [N m],block.force_y", 'block.force_x .N m.: unknown unit "N m"'),
    ):
        path.write_text(f"{header}\n1,2\n")
        with pytest.raises(ValueError, match=message):
            read_forces(path, SCENE)


@pytest.mark.parametrize(("header", "unit"), [("t", 1.0), ("time [ms]", 1e3), ("stamp_s", 1.0)])
def test_forces_with_a_stamp_for_each_time_step_are_those_without_stamps(
    header: str, unit: float, tmp_path: Path
) -> None:
    (tmp_path / "plain.csv").write_text("block.force_x\n4\n5\n6\n")
    rows = "".join(f"{unit * step * SCENE.time_step!r},{force}\n" for step, force in enumerate((4, 5, 6)))
    (tmp_path / "stamped.csv").write_text(f"{header},block.force_x\n{rows}")
    plain, stamped = (read_forces(tmp_path / name, SCENE) for name in ("plain.csv", "stamped.csv"))
    assert np.allclose(stamped, plain, rtol=1e-6)


def test_forces_at_any_stamps_give_the_impulse_that_is_held_from_stamp_to_stamp(tmp_path: Path) -> None:
    draw, step = np.random.default_rng(0), SCENE.time_step
    time = np.append(0.0, np.cumsum(draw.uniform(0.05, 3.0, 40) * step))
    force = draw.normal(size=41)
    rows = "".join(f"{one!r},{value!r}\n" for one, value in zip(time.tolist(), force.tolist(), strict=True))
    (tmp_path / "planned.csv").write_text(f"time,other.force_y\n{rows}")
    read = read_forces(tmp_path / "planned.csv", SCENE)[:, 1, 4]
    frames = step * np.arange(len(read))
    assert frames[-1] - step <= time[-1] < frames[-1]
    fine = np.linspace(0, frames[-1], 200_001)
    held = force[np.searchsorted(time, fine, side="right") - 1]
    impulse = np.interp(frames, fine, np.append(0.0, np.cumsum(held[:-1] * np.diff(fine))))
    assert np.allclose(np.append(0.0, np.cumsum(read[:-1] * step)), impulse, atol=2e-3 * step)
    assert read[-1] == 0


def test_stamps_of_planned_forces_beyond_any_measure_are_refused(tmp_path: Path) -> None:
    (tmp_path / "planned.csv").write_text("t,block.force_x\n0,1\n1e12,1\n")
    with pytest.raises(ValueError, match="time steps must be a whole number of at most 10000000, got"):
        read_forces(tmp_path / "planned.csv", SCENE)


@pytest.mark.parametrize("digits", [5, 6, 9])
def test_rounded_stamps_lose_no_row(digits: int, tmp_path: Path) -> None:
    for count in range(2, 40):
        force = np.arange(1.0, count + 1)
        rows = "".join(f"{step * SCENE.time_step:.{digits}f},{value}\n" for step, value in enumerate(force))
        (tmp_path / "planned.csv").write_text(f"time,block.force_x\n{rows}")
        read = read_forces(tmp_path / "planned.csv", SCENE)[:, 0, 3]
        assert len(read) == count + 1
        assert np.allclose(read[:-1], force, atol=0.05 * force.max())
