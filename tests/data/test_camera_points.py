"""The place of a camera from points of the ground: above it, in a right-handed frame, and how far points are off."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.data import filmed

from physid.data.importers.video.cameras import POINTS_OFF, read_camera, solve_place
from physid.data.importers.video.mapping import FilmMap
from physid.yaml_files import parse_yaml

pytest.importorskip("cv2")
CAMERA = replace(filmed.CAMERA, width=640, height=480)
FOCAL = CAMERA.height / 2 / np.tan(np.radians(CAMERA.fov_y) / 2)
MATRIX = np.array([[FOCAL, 0, 319.5], [0, FOCAL, 239.5], [0, 0, 1]])
GROUND = np.array([[-0.15, -0.1, 0], [0.15, -0.1, 0], [0.15, 0.1, 0], [-0.15, 0.1, 0], [0.0, 0.02, 0]])
RAISED = GROUND + np.array([0, 0, 0.1])
TILT = np.array([[1.0, 0, 0], [0, np.cos(0.3), -np.sin(0.3)], [0, np.sin(0.3), np.cos(0.3)]])


def rows_of(world: NDArray[np.float64], said: NDArray[np.float64] | None = None) -> list[list[float]]:
    """Return where the camera sees points, and what is said of where they are."""
    image = CAMERA.project(world)[:, :2] - 0.5
    return np.concatenate([image, world if said is None else said], 1).tolist()


def write(path: Path, points: Any) -> Path:
    path.write_text(
        f"image_width: 640\nimage_height: 480\ncamera_matrix: {MATRIX.ravel().tolist()}\npoints: {points}\n"
    )
    return path


@pytest.mark.parametrize("world", [GROUND, RAISED, GROUND @ TILT.T], ids=["flat", "raised", "tilted"])
def test_a_camera_above_the_points_is_found_where_it_is(world: NDArray[np.float64]) -> None:
    rotation, translation, error = solve_place(rows_of(world), MATRIX, np.zeros(5), "camera.yaml")
    assert -rotation.T @ translation == pytest.approx(np.array(CAMERA.position), abs=1e-3)
    assert error < 0.01


@pytest.mark.parametrize("world", [GROUND, RAISED], ids=["flat", "raised"])
@pytest.mark.parametrize("mirror", [np.diag([1.0, -1, 1]), np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])])
def test_mirrored_points_are_refused_with_what_to_do(world: NDArray[np.float64], mirror: NDArray[np.float64]) -> None:
    with pytest.raises(ValueError, match=r"below it sees so: they are mirrored.*exchange x and y, or negate y"):
        solve_place(rows_of(world, world @ mirror.T), MATRIX, np.zeros(5), "camera.yaml")


def test_a_point_that_is_off_is_said_in_pixels_and_small_errors_are_not_remarked(tmp_path: Path) -> None:
    notes = []
    for shift in (0.5, 9.0):
        rows = rows_of(GROUND)
        rows[0][0] += shift
        camera = write(tmp_path / "camera.yaml", rows)
        error = read_camera(camera).points_error
        assert error is not None
        assert 0.2 * shift < error < shift
        notes.append(FilmMap.from_mapping({**filmed.MAPPING, "camera": str(camera)}).notes)
    assert not any("px off" in note for note in notes[0])
    (remark,) = [note for note in notes[1] if "px off" in note]
    assert float(re.findall(r"up to ([\d.]+) px", remark)[0]) > POINTS_OFF


@pytest.mark.parametrize("place", ["docs/films.md", "src/physid/commands/films.py"])
def test_points_in_examples_lie_on_a_table_seen_from_above(place: str) -> None:
    text = (Path(__file__).parents[2] / place).read_text(encoding="utf-8")
    found = re.findall(r'--ground "(\[\[.*?\]\])"', text)
    assert found
    for points in found:
        matrix = np.array([[600.0, 0, 319.5], [0, 600, 239.5], [0, 0, 1]])
        rotation, translation, error = solve_place(parse_yaml(points, place), matrix, np.zeros(5), place)
        assert (-rotation.T @ translation)[2] > 0
        assert error < POINTS_OFF
