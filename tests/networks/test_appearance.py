import dataclasses
import math

import numpy as np
import pytest
import torch

from physid.networks import PinholeCamera, PlanarChart, as_image
from physid.networks.appearance import Appearance, cut_appearance
from physid.networks.renderer import BoxRenderer
from physid.physics.rotations import exponential, multiply
from physid.scenes import Scene
from physid.scenes.camera import Camera
from physid.scenes.setups.collide import SCENE as COLLIDE
from physid.scenes.setups.push import SCENE as PUSH
from physid.scenes.setups.slide import SCENE as SLIDE
from physid.simulators.bullet.camera import Studio

COLOUR_ERROR = 0.075
"""Mean absolute colour error over blocks of 15 pixels: PyBullet's edges and arrows are jagged, ours a pixel wide; the
faces of the tossed ones also change their shade."""
PIXEL_ERROR = 0.05
"""Mean error of the pose that fits an image best [px]; its root mean square may be twice that."""
YAW_ERROR = 0.02
"""Root mean square error of the yaw that fits best [rad]: the corners of a block move by an eighth of a pixel."""
MIXING = 0.01
"""How much of the background a patch may take up at the edges."""
OBLIQUE = Camera(128, 128, (0.0, -2.0, 2.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 30.0)
TOSSED = dataclasses.replace(COLLIDE, name="tossed", camera=OBLIQUE)
POSES, SEEN = 16, 12
"""How many frames there are, and how many of them the appearance is learnt from; the others are new."""


@dataclasses.dataclass(frozen=True)
class Filmed:
    """What PyBullet shows of bodies at random poses."""

    camera: PinholeCamera
    size: torch.Tensor
    pose: torch.Tensor
    frame: torch.Tensor
    mask: torch.Tensor
    background: torch.Tensor

    @classmethod
    def of(cls, scene: Scene) -> "Filmed":
        camera = PinholeCamera(**dataclasses.asdict(scene.camera))
        pose = flying(POSES) if scene is TOSSED else lying(scene, camera, POSES)
        with Studio(scene) as studio:
            shots = [studio.shoot(p) for p in pose.double().numpy()]
            background = as_image(torch.from_numpy(studio.background))[None]
        mask = np.stack([[which == n for n in range(len(scene.bodies))] for _, which in shots])
        frame = as_image(torch.from_numpy(np.stack([image for image, _ in shots])))
        size = torch.tensor([b.size for b in scene.bodies])
        return cls(camera, size, pose, frame, torch.from_numpy(mask), background)

    def appearance(self) -> Appearance:
        return cut_appearance(
            self.camera, self.frame[:SEEN], self.mask[:SEEN], self.pose[:SEEN], self.size, shared=True
        )

    def error(self, drawn: torch.Tensor, where: torch.Tensor) -> float:
        return float((drawn - self.frame).abs().mean(1)[where].mean())


def lying(scene: Scene, camera: PinholeCamera, count: int) -> torch.Tensor:
    """Draw poses on the ground, the second body to the right of the first; or up to half a metre above an incline."""
    normal, offset = scene.ground.normal, scene.ground.offset
    hovering = scene is SLIDE
    chart = PlanarChart(camera, normal, offset, [b.size[2] for b in scene.bodies], hovering=hovering)
    generator = torch.Generator().manual_seed(0)
    raw = 1.4 * torch.rand(count, chart.bodies, chart.numbers, generator=generator) - 0.7
    if chart.bodies == 2:
        raw[..., 0] = raw[..., 0] / 2 + torch.tensor([-0.45, 0.45])
    raw[..., 4:] = raw[..., 4:].abs() / 3
    return chart.to_pose(raw)


def flying(count: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    place = 0.5 * torch.rand(count, 2, 3, generator=generator) - torch.tensor([[0.5, 0.2, -0.1], [0.0, 0.2, -0.1]])
    return torch.cat([place, exponential(0.6 * torch.randn(count, 2, 3, generator=generator))], -1)


@pytest.mark.parametrize("scene", [PUSH, SLIDE, COLLIDE, TOSSED], ids=lambda scene: scene.name)
def test_drawings_of_bodies_seen_before_agree_with_pybullet(scene: Scene) -> None:
    filmed = Filmed.of(scene)
    drawn = BoxRenderer(filmed.camera, filmed.size)(filmed.pose[None], filmed.appearance(), filmed.background)[0]
    body = filmed.mask.any(1)
    assert filmed.error(drawn, body) < COLOUR_ERROR
    assert filmed.error(drawn, ~body) < COLOUR_ERROR / 50


def test_the_first_frame_is_drawn_back_from_its_own_patches() -> None:
    filmed = Filmed.of(COLLIDE)
    appearance = cut_appearance(filmed.camera, filmed.frame, filmed.mask, filmed.pose, filmed.size)
    background = filmed.background.expand(POSES, -1, -1, -1)
    drawn = BoxRenderer(filmed.camera, filmed.size)(filmed.pose[:, None], appearance, background)[:, 0]
    assert filmed.error(drawn, filmed.mask.any(1)) < COLOUR_ERROR


@pytest.mark.parametrize("scene", [PUSH, COLLIDE], ids=lambda scene: scene.name)
@pytest.mark.slow
def test_descending_the_image_error_finds_the_pose_that_pybullet_drew(scene: Scene) -> None:
    filmed = Filmed.of(scene)
    appearance = filmed.appearance()
    shift = torch.full((POSES, len(scene.bodies), 3), 0.02, requires_grad=True)  # x and y [m], a pixel; yaw [rad]
    renderer, descent = BoxRenderer(filmed.camera, filmed.size), torch.optim.Adam([shift], lr=2e-3)
    for _ in range(50):
        descent.zero_grad()
        turn = exponential(torch.cat([torch.zeros_like(shift[..., :2]), shift[..., 2:]], -1))
        place = torch.cat([filmed.pose[..., :2] + shift[..., :2], filmed.pose[..., 2:3]], -1)
        pose = torch.cat([place, multiply(turn, filmed.pose[..., 3:])], -1)
        (renderer(pose[None], appearance, filmed.background)[0] - filmed.frame).square().sum().backward()
        descent.step()
    pixel = 2 * 6 * math.tan(math.radians(12.5)) / 128
    found = shift.detach()
    assert found[..., :2].mean((0, 1)).abs().max() < PIXEL_ERROR * pixel
    assert found[..., :2].square().mean().sqrt() < 2 * PIXEL_ERROR * pixel
    assert found[..., 2].square().mean().sqrt() < YAW_ERROR


def flat_box() -> tuple[PinholeCamera, BoxRenderer, torch.Tensor, Appearance]:
    camera = PinholeCamera(**dataclasses.asdict(OBLIQUE))
    colours = torch.rand(1, 1, 6, 3, 1, 1, generator=torch.Generator().manual_seed(2))
    pose = torch.tensor([[[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]])
    renderer = BoxRenderer(camera, torch.tensor([[0.2, 0.2, 0.2]]))
    return camera, renderer, pose, Appearance(colours.expand(-1, -1, -1, -1, 8, 8).clone())


def test_a_face_never_seen_takes_the_mean_colour_of_the_seen_sides() -> None:
    camera, renderer, pose, truth = flat_box()
    frame = renderer(pose[None], truth, torch.zeros(1, 3, 128, 128))[0]
    mask = renderer.silhouettes(pose) > 0.5
    patches = cut_appearance(camera, frame, mask, pose, renderer.size).patches.mean((-2, -1))[0, 0]
    colours, front, top, unseen = truth.patches[0, 0, :, :, 0, 0], 2, 5, [0, 1, 3, 4]
    assert torch.allclose(patches[[front, top]], colours[[front, top]], atol=MIXING)
    assert torch.allclose(patches[unseen], colours[[front]].expand(4, -1), atol=MIXING)


def test_a_body_without_mask_or_with_a_misplaced_one_is_named() -> None:
    filmed = Filmed.of(COLLIDE)
    empty, misplaced = filmed.mask.clone(), filmed.mask.clone()
    empty[1, 0] = False
    misplaced[0, 1] = filmed.mask[0, 1].roll(20, -1)
    with pytest.raises(ValueError, match="mask of body 0 in sample 1 of the batch is empty"):
        cut_appearance(filmed.camera, filmed.frame, empty, filmed.pose, filmed.size)
    with pytest.raises(ValueError, match="mask of body 1 in sample 0 of the batch does not lie where"):
        cut_appearance(filmed.camera, filmed.frame, misplaced, filmed.pose, filmed.size)
