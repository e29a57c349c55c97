"""The film of a motion shows what the camera's projection says."""

import dataclasses

import numpy as np
import pybullet
import pytest

from physid.scenes import Scene, find_setup
from physid.scenes.setups.placing import on_ground
from physid.simulators.bullet import camera as studio
from physid.simulators.bullet.camera import Studio
from physid.simulators.filming import film

PIXEL = 0.6  # [pixel] accepted distance of a body's middle from where the projection puts it


def pair() -> tuple[Scene, np.ndarray]:
    scene = find_setup("collide").scene
    places = [(-0.4, 0.3, 0.4), (0.5, -0.2, -0.9)]
    return scene, np.stack([on_ground(scene.ground, x, y, yaw, 0.2) for x, y, yaw in places])


def test_a_film_has_the_shapes_and_types_of_the_format() -> None:
    scene, pose = pair()
    images = film(scene, np.stack([pose] * 3))
    assert {name: (image.shape, image.dtype.name) for name, image in images.items()} == {
        "frames": ((3, 128, 128, 3), "uint8"),
        "mask": ((2, 128, 128), "bool"),
        "background": ((128, 128, 3), "uint8"),
    }


def test_each_body_is_seen_where_the_camera_projects_its_upper_face() -> None:
    scene, pose = pair()
    mask = film(scene, pose[None])["mask"]
    assert scene.camera is not None
    top = pose[:, :3] + [0, 0, 0.1]
    for shape, (column, row, _) in zip(mask, scene.camera.project(top), strict=True):
        rows, columns = np.nonzero(shape)
        assert abs(columns.mean() + 0.5 - column) < PIXEL
        assert abs(rows.mean() + 0.5 - row) < PIXEL


def test_bodies_laid_over_the_background_give_the_same_pixels_as_drawing_all_at_once() -> None:
    scene, pose = pair()
    with Studio(scene) as room:
        image, which = room.shoot(pose)
        ground = room._add(studio.ground_mesh(studio.GROUND_HALF_WIDTH), studio.ground_tile())
        together, _ = room._shoot()
        pybullet.removeBody(ground, physicsClientId=room._client)
    assert (which >= 0).sum() > 300
    assert np.array_equal(image, together)


def test_a_film_differs_from_the_background_only_where_bodies_are() -> None:
    scene, pose = pair()
    images = film(scene, pose[None])
    differs = (images["frames"][0] != images["background"]).any(-1)
    assert not (differs & ~images["mask"].any(0)).any()


def test_a_block_turned_by_half_a_turn_looks_different() -> None:
    scene, pose = pair()
    turned = pose * 1.0
    turned[:, 3:] = np.stack([on_ground(scene.ground, 0, 0, yaw + np.pi, 0.2)[3:] for yaw in (0.4, -0.9)])
    before, after = (film(scene, each[None])["frames"][0].astype(int) for each in (pose, turned))
    assert np.abs(before - after).max() > 100


@pytest.mark.parametrize("name", ["push", "slide", "collide", "toss"])
def test_every_body_covers_at_least_twelve_pixels_in_each_direction(name: str) -> None:
    scene = find_setup(name).scene
    # The worst place is the lower end of the incline, farthest from the camera.
    pose = np.stack([on_ground(scene.ground, 1.0, 0.6 * n, 0.0, body.size[2]) for n, body in enumerate(scene.bodies)])
    for shape in film(scene, pose[None])["mask"]:
        rows, columns = np.nonzero(shape)
        assert min(np.ptp(rows), np.ptp(columns)) + 1 >= 12


def test_a_scene_without_a_camera_cannot_be_filmed() -> None:
    scene, pose = pair()
    with pytest.raises(ValueError, match="collide has no camera"):
        film(dataclasses.replace(scene, camera=None), pose[None])
