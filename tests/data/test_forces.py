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
        ("planned.csv", "block.force_x\n1\nnan\n", "expected finite forces"),
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
        ("t [s],block.force_x", 'unknown column "t"; expected one row for each time step of .* s, held until the next'),
        ("time_s,block.force_x", "expected one row for each time step"),
        ("block.force_x [N m],block.force_y", 'block.force_x .N m.: unknown unit "N m"'),
    ):
        path.write_text(f"{header}\n1,2\n")
        with pytest.raises(ValueError, match=message):
            read_forces(path, SCENE)
