"""The pinhole camera."""

import dataclasses
import math

import numpy as np
import pytest

from physid.scenes.camera import Camera, corners

TOLERANCE = 1e-9
TOP = Camera(128, 128, (0.0, 0.0, 6.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 25.0)


def test_the_target_is_in_the_middle_and_x_points_right_and_y_up() -> None:
    column, row, depth = TOP.project(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])).T
    assert (column[0], row[0], depth[0]) == pytest.approx((64, 64, 6), abs=TOLERANCE)
    assert column[1] > 64
    assert row[1] == pytest.approx(64, abs=TOLERANCE)
    assert row[2] < 64


def test_the_opening_angle_reaches_from_the_upper_to_the_lower_border() -> None:
    edge = 6 * math.tan(math.radians(12.5))
    assert TOP.project(np.array([[0, edge, 0], [0, -edge, 0.0]]))[:, 1] == pytest.approx([0, 128], abs=TOLERANCE)


@pytest.mark.parametrize("height", [128, 480])
def test_a_pixel_at_the_target_is_as_large_as_what_it_shows(height: int) -> None:
    camera = dataclasses.replace(TOP, height=height, position=(0.0, -2.0, 3.0), target=(0.0, 0.5, 0.0))
    right = np.array([camera.pixel, 0.0, 0.0])
    columns = camera.project(np.array([camera.target, camera.target + right]))[:, 0]
    assert columns[1] - columns[0] == pytest.approx(1, abs=TOLERANCE)


def test_a_box_is_seen_only_if_all_its_corners_are() -> None:
    size, turned = np.array([[0.2, 0.2, 0.2]]), [0, 0, math.sin(math.pi / 8), math.cos(math.pi / 8)]
    pose = np.array([[[0, 0, 0.1, *turned]], [[1.25, 0, 0.1, *turned]], [[0, 0, 7.0, *turned]]])
    assert TOP.sees(pose, size)[:, 0].tolist() == [True, False, False]
    assert corners(pose, size).shape == (3, 1, 8, 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fov_y": 180.0}, "fov_y must be below 180"),
        ({"up": (0.0, 0.0, 1.0)}, "up must not be parallel"),
        ({"width": 12.5}, "camera.width must be a whole number"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(TOP, **change)  # type: ignore[arg-type]
