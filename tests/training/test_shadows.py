"""Shadows that one lamp casts: drawn as rays of light draw them, learned from first frames, and no error of poses."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from tests.data import filmed
from torch import Tensor

from physid.data import RecordingSet
from physid.data.importers.video.convert import import_films
from physid.data.reading import ECHO
from physid.networks import PinholeCamera
from physid.physics.rotations import rotate
from physid.scenes import Ground, Scene, find_setup
from physid.training.tracking.films import Drawn, FirstSight
from physid.training.tracking.shadows import cast_shadow_of
from physid.training.tracking.track import track
from physid.training.vision import CastShadow, ground_points
from physid.training.vision.drawing.cast_shadow import axes_of

cv2 = pytest.importorskip("cv2")
LAMP, DARK = np.array([0.9, -0.5]), 0.45  # slope of the light, and the share of it that a shadow takes
TILTED = Ground((0.36, -0.48, 0.8), 0.3)
EXACT = 0.2  # [px] root mean square error of positions
SOFT = 1.2  # [px] edges of shadows
GREY = np.array([115.0, 115.0, 112.0])


def poses(count: int, above: float) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    turn = torch.nn.functional.normalize(torch.randn(1, count, 1, 4, generator=generator), dim=-1)
    place = 0.1 * torch.randn(1, count, 1, 3, generator=generator)
    return torch.cat([place + torch.tensor([0.0, 0.0, above]), turn], -1).double()


@pytest.mark.parametrize("ground", [Ground(), Ground((0.0, 1.0, 0.0)), Ground((1.0, 0.0, 0.0)), TILTED])
def test_a_point_lies_in_shadow_where_its_ray_of_light_meets_the_box(ground: Ground) -> None:
    shadow = CastShadow(ground, (0.8, -0.3), 0.5, 1e-6)
    size, normal = torch.tensor([[0.2, 0.14, 0.3]]).double(), torch.tensor(ground.normal).double()
    pose = poses(5, 0.0)
    pose[..., :3] += (ground.offset + 0.4 - pose[..., :3] @ normal)[..., None] * normal
    point = 0.5 * torch.randn(1, 4000, 2, generator=torch.Generator().manual_seed(0)).double()
    shade = shadow.shade(point, pose, size)[0]
    axes = axes_of(ground)
    towards = normal + torch.tensor(shadow.slope).double() @ axes
    start = ground.offset * normal + point[0] @ axes
    for index, one in enumerate(pose[0, :, 0]):
        back = one[3:] * torch.tensor([-1.0, -1.0, -1.0, 1.0])
        origin, ray = rotate(back, start - one[:3]), rotate(back, towards)
        near, far = ((-side * ray.sign() * size[0] / 2 - origin) / ray for side in (1, -1))
        hit = near.amax(-1) < far.amin(-1)
        assert hit.any()
        assert torch.equal(shade[index] > 0.5, hit)


def test_an_edge_is_as_soft_as_the_integral_of_a_normal_density() -> None:
    shadow = CastShadow(Ground(), (0.0, 0.0), 1.0, 0.01)
    pose = torch.tensor([[[[0.0, 0, 0.5, 0, 0, 0, 1]]]]).double()
    away = torch.linspace(-0.03, 0.03, 13).double()
    point = torch.stack([0.5 + away, torch.zeros_like(away)], -1)[None]
    shade = shadow.shade(point, pose, torch.ones(1, 3).double())[0, 0]
    assert shade.tolist() == pytest.approx([math.erfc(x / 0.01 / math.sqrt(2)) / 2 for x in away.tolist()])


def test_two_shadows_leave_what_each_leaves() -> None:
    shadow, size = (
        CastShadow(Ground(), (0.5, 0.2), 1.0, 0.05),
        torch.tensor([[0.2, 0.2, 0.2], [0.3, 0.1, 0.1]]).double(),
    )
    both = torch.cat([poses(1, 0.3), poses(2, 0.2)[:, 1:]], 2)
    point = 0.2 * torch.randn(1, 200, 2, generator=torch.Generator().manual_seed(0)).double()
    one, other = (shadow.shade(point, both[:, :, [body]], size[[body]]) for body in (0, 1))
    assert torch.allclose(1 - shadow.shade(point, both, size), (1 - one) * (1 - other))


@pytest.mark.parametrize("ground", [Ground(), TILTED])
def test_points_of_the_ground_are_seen_where_their_pixels_are(ground: Ground) -> None:
    camera = PinholeCamera(32, 24, (0.5, -2.0, 3.0), (0.4, 0.1, 0.4), (0.0, 0.0, 1.0), 40.0)
    point = ground_points(camera, ground, (10, 12), torch.tensor([[5, 7]]))[0].double()
    seen = camera.project(ground.offset * torch.tensor(ground.normal).double() + point @ axes_of(ground))
    row, column = np.mgrid[7:17, 5:17] + 0.5
    assert torch.allclose(seen.float(), torch.from_numpy(np.stack([column, row], -1)).float().view(-1, 2), atol=1e-3)


def test_there_is_no_shadow_above_the_horizon() -> None:
    camera = PinholeCamera(16, 12, (0.0, -2.0, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), 60.0)
    shadow = CastShadow(Ground(), (0.0, 50.0), 0.5, 0.01)
    pose = torch.tensor([[[[0.0, 0, 1.0, 0, 0, 0, 1]]]])
    light = shadow.light(camera, pose, torch.full((1, 3), 4.0), (12, 16), torch.zeros(1, 2, dtype=torch.long))[0, 0]
    assert (light[:6] == 1).all()
    assert (light[6:] < 0.6).any()


def shade_of(
    place: NDArray[np.float64], yaw: float, lamp: NDArray[np.float64], soft: float = 1.2
) -> NDArray[np.float64]:
    """Draw a shadow by a polygon, 1 in its middle: (H, W)."""
    c, s = np.cos(yaw), np.sin(yaw)
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)]) * filmed.EDGES
    world = corners @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [*place, 0]
    ground = np.column_stack([world[:, :2] - world[:, 2:] * lamp, np.zeros(8)])
    fine = 4
    drawn = np.zeros((fine * filmed.CAMERA.height, fine * filmed.CAMERA.width), np.float32)
    hull = cv2.convexHull((fine * filmed.CAMERA.project(ground)[:, :2] - 0.5).astype(np.float32))[:, 0]
    cv2.fillConvexPoly(drawn, (64 * hull).round().astype(np.int32), 1.0, shift=6)
    soft_one = cv2.GaussianBlur(drawn, (0, 0), fine * SOFT)
    return np.asarray(soft_one.reshape(filmed.CAMERA.height, fine, filmed.CAMERA.width, fine).mean((1, 3)), float)


def draw(place: NDArray[np.float64], yaw: float, lamps: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    light = np.prod([1 - DARK * shade_of(place, yaw, lamp) for lamp in lamps], 0) if lamps else np.ones(1)
    return filmed.draw(place, yaw, filmed.table() * light[..., None])


def first_frames(lamps: Sequence[NDArray[np.float64]]) -> tuple[Scene, list[FirstSight], Tensor]:
    """Draw first frames with some lamps, their masks and backgrounds; and where the bodies are."""
    known = find_setup("push").scene
    body = dataclasses.replace(known.bodies[0], size=tuple(filmed.EDGES.tolist()))
    scene = dataclasses.replace(known, bodies=(body,), camera=filmed.CAMERA)
    generator, background = np.random.default_rng(0), filmed.table().round().astype(np.uint8)
    drawn, pose = [], []
    for place, yaw in ((np.array([0.05, 0.0]), 0.4), (np.array([-0.08, 0.06]), -0.2)):
        image = draw(place, yaw, lamps) + 2 * generator.standard_normal(background.shape)
        mask = filmed.draw(place, yaw, np.zeros(background.shape)).max(-1) > 5
        drawn.append((image.round().clip(0, 255).astype(np.uint8), mask[None], background))
        pose.append([[*place, filmed.EDGES[2] / 2, 0, 0, math.sin(yaw / 2), math.cos(yaw / 2)]])
    return scene, drawn, torch.tensor(pose, dtype=torch.float64)


def test_first_frames_tell_where_the_lamp_stands_and_how_dark_its_shadow_is() -> None:
    shadow = cast_shadow_of(*first_frames([LAMP]))
    assert shadow is not None
    assert shadow.slope == pytest.approx(LAMP, abs=0.04)
    assert shadow.darkness == pytest.approx(DARK, abs=0.02)


@pytest.mark.parametrize("lamps", [[], [LAMP, -LAMP]], ids=["none", "two"])
def test_no_shadow_and_those_of_two_lamps_are_not_taken_for_one(lamps: list[NDArray[np.float64]]) -> None:
    assert cast_shadow_of(*first_frames(lamps)) is None


@pytest.mark.slow
def test_the_edges_of_a_grey_block_in_its_own_shadow_do_not_move_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Taken out of the frames, the shadow moved it by 0.3 and 0.5 pixels (root mean square)."""
    shares = (1.2, 0.2, 1.0, 0.6, 0.8, 0.9)
    faces = {normal: share * GREY for normal, share in zip(filmed.FACES, shares, strict=True)}
    monkeypatch.setattr(filmed, "FACES", faces)
    monkeypatch.chdir(tmp_path)
    filmed.write_camera(tmp_path / "camera.yaml")
    generator, path = np.random.default_rng(3), filmed.path_of(16)
    for number, yaw in enumerate((-0.4, -0.15)):
        frames = [draw(place, yaw, [LAMP]) + 2 * generator.standard_normal((144, 192, 3)) for place in path]
        shown = [frame.round().clip(0, 255).astype(np.uint8) for frame in frames]
        filmed.write_film(tmp_path / f"{number}.mp4", shown)
    mapping = dict(filmed.MAPPING, forces={}, force=None)
    import_films(sorted(tmp_path.glob("*.mp4")), mapping, tmp_path / "films")
    read = track(tmp_path / "films", tmp_path / "read")
    for one, again in zip(read, RecordingSet(tmp_path / "read" / ECHO), strict=True):
        assert one.pose is not None
        assert again.pose is not None
        true = np.column_stack([path, np.full(len(path), filmed.EDGES[2] / 2)])
        seen, drawn, known = (
            filmed.CAMERA.project(place)[:, :2] for place in (one.pose[:, 0, :3], again.pose[:, 0, :3], true)
        )
        assert np.sqrt(((seen - known) ** 2).mean(0)).max() < EXACT
        assert np.sqrt(((drawn - seen) ** 2).mean(0)).max() < EXACT, "films that are drawn to measure the error"


def test_films_that_are_drawn_to_measure_the_error_have_the_shadow() -> None:
    scene, sights, pose = first_frames([LAMP])
    faces = np.full((1, 6, 8, 8, 3), 200, np.uint8)
    shadow = CastShadow(scene.ground, (0.9, -0.5), DARK, 0.004)
    behind = sights[0][2]
    with Drawn(scene, faces, [pose[:1].numpy()], [behind], shadow=shadow) as drawn:
        image, mask, background = drawn.first(0)
    assert np.array_equal(background, behind)
    shade = shade_of(np.array([0.05, 0.0]), 0.4, LAMP)
    near = cv2.dilate(mask[0].astype(np.uint8), np.ones((5, 5))).astype(bool)
    inside, outside = (shade > 0.98) & ~near, (shade < 0.01) & ~near
    assert np.median(image[inside] / behind[inside]) == pytest.approx(1 - DARK, abs=0.02)
    assert np.array_equal(image[outside], behind[outside])
