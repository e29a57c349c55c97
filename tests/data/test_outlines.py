"""Whether a body covers as many pixels of a film as camera and size let it."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import numpy as np
import pytest
from numpy.typing import NDArray

from physid.data.importers.video.survey import unlike_outlines
from physid.scenes import Scene, find_setup
from physid.scenes.camera import corners

cv2 = pytest.importorskip("cv2")
SCENE = find_setup("push").scene
BODY, CAMERA = SCENE.bodies[0], SCENE.camera


def outline(*places: tuple[float, float, float]) -> NDArray[np.bool_]:
    """Return where a block stands in an image, which stands at places (x, y, heading) at once, shape (1, H, W)."""
    assert CAMERA is not None
    drawn = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    for x, y, heading in places:
        pose = np.array([x, y, BODY.size[2] / 2, 0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2)])
        seen = CAMERA.project(corners(pose[None], np.array(BODY.size)[None])[0])[:, :2]
        hull = cv2.convexHull(seen.astype(np.float32)).round().astype(np.int32)
        cv2.fillConvexPoly(drawn, hull, 1)
    return drawn.astype(bool)[None]


def scaled(factor: float) -> Scene:
    return SCENE.with_bodies([dataclasses.replace(BODY, size=tuple(factor * edge for edge in BODY.size))])


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (0.4, -0.3, 0.7), (-0.5, 0.4, 2.0)])
def test_a_body_that_covers_what_it_should_is_not_spoken_of(place: tuple[float, float, float]) -> None:
    assert unlike_outlines(outline(place), SCENE) == []


def test_a_body_that_the_background_shows_too_is_said_to_cover_too_much() -> None:
    (said,) = unlike_outlines(outline((0.0, 0.0, 0.0), (0.35, 0.3, 0.4), (-0.35, 0.3, 0.2)), SCENE)
    assert "block covers" in said
    assert "does the background show the body, too (background=FILE" in said


@pytest.mark.parametrize("factor", [1e-3, 1e-2, 1e2, 1e3])
def test_sizes_in_another_unit_are_asked_for(factor: float) -> None:
    (said,) = unlike_outlines(outline((0.0, 0.0, 0.3)), scaled(factor))
    assert "are size, points and tvec of the camera in metres?" in said
    assert "background" not in said


def test_a_camera_below_the_ground_is_said_to_be() -> None:
    assert CAMERA is not None
    below = (*CAMERA.position[:2], -CAMERA.position[2])
    upside_down = dataclasses.replace(SCENE, camera=dataclasses.replace(CAMERA, position=below))
    (said,) = unlike_outlines(outline((0.0, 0.0, 0.3)), upside_down)
    assert "does its z point up?" in said


def test_what_imports_films_can_be_loaded_without_opencv_which_is_an_extra() -> None:
    code = "import sys; sys.modules['cv2'] = None; import physid.data.importers.video.convert"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False).stderr == ""
