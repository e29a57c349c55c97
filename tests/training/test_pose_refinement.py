import math

import pytest
import torch

from physid.physics.rotations import angle_between
from physid.scenes import Scene, find_setup
from physid.training.vision import pose_refinement as pose_refinement
from physid.training.vision.drawing.decoder import Decoder
from physid.training.vision.pose_refinement import PoseRefinement
from physid.training.vision.reading import chart_of

SCENE = find_setup("push").scene
TOLERANCE = 1e-3  # [m], [rad]; a pixel is 21 mm


def painted(scene: Scene = SCENE) -> Decoder:
    """Return a decoder of blocks with faces of random colours."""
    torch.manual_seed(0)
    decoder, bodies = Decoder(scene), len(scene.bodies)
    colours = torch.rand(1, bodies, 6, 3, 4, 4)
    decoder.patches = torch.nn.functional.interpolate(colours.flatten(0, 2), size=32).view(1, bodies, 6, 3, 32, 32)
    return decoder


BACKGROUND = torch.full((1, 3, 128, 128), 0.7)
NUMBERS = torch.tensor([[0.3, -0.2, 0.8, 0.6], [-0.5, 0.4, 0.0, -1.0]])[None, :, None]


def test_a_pose_that_is_off_by_a_third_of_the_body_is_found_again() -> None:
    chart, decoder = chart_of(SCENE, "planar"), painted()
    true = chart.to_pose(NUMBERS)
    start = chart.to_pose(NUMBERS + torch.tensor([0.05, -0.04, 0.1, 0.1]))
    image = decoder(true, BACKGROUND)
    found = PoseRefinement(steps=12)(chart, decoder, start, image, BACKGROUND)
    assert (start - true).abs().max() > 30 * TOLERANCE
    assert (found - true).abs().max() < TOLERANCE


@pytest.mark.parametrize("turn", [1.57, 3.14])
def test_any_heading_is_found_if_several_are_tried(turn: float) -> None:
    chart, decoder = chart_of(SCENE, "planar"), painted()
    turned = torch.tensor([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    start = torch.cat([NUMBERS[..., :2] + 0.03, NUMBERS[..., 2:] @ turned.T], -1)
    true = chart.to_pose(NUMBERS)
    image = decoder(true, BACKGROUND)
    found = PoseRefinement(steps=12, headings=24)(chart, decoder, chart.to_pose(start), image, BACKGROUND)
    assert angle_between(found[..., 3:], true[..., 3:]).max() < TOLERANCE
    trusting = PoseRefinement(steps=12)(chart, decoder, chart.to_pose(start), image, BACKGROUND)
    assert angle_between(trusting[..., 3:], true[..., 3:]).max() > 100 * TOLERANCE


def test_no_steps_leave_the_poses_as_they_are() -> None:
    chart, decoder = chart_of(SCENE, "planar"), Decoder(SCENE)
    pose = chart.to_pose(chart.neutral()[None, None, None])
    image = torch.zeros(1, 1, 3, 128, 128)
    assert PoseRefinement(steps=0)(chart, decoder, pose, image, image[0]) is pose


def headed(place: torch.Tensor, angle: torch.Tensor) -> torch.Tensor:
    return torch.cat([place, torch.stack([angle.cos(), angle.sin()], -1)], -1)


@pytest.mark.slow
@pytest.mark.parametrize(("doubtful", "misread"), [(pose_refinement.DOUBTFUL, False), (math.inf, True)])
def test_neighbours_that_mislead_each_other_are_turned_once_more(
    doubtful: float, misread: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pose_refinement, "DOUBTFUL", doubtful)
    scene, generator, count = find_setup("collide").scene, torch.Generator().manual_seed(2), 16
    chart, decoder = chart_of(scene, "planar"), painted(scene)
    side, *turns = 2 * math.pi * torch.rand(5, count, generator=generator)
    place = (1.2 * torch.rand(count, 1, 2, generator=generator) - 0.6).repeat(1, 2, 1)
    place[:, 1] += 0.2 * torch.stack([side.cos(), side.sin()], -1)  # hardly apart
    true = chart.to_pose(headed(place, torch.stack(turns[:2], -1)))[:, None]
    astray = place + 0.06 * torch.randn(count, 2, 2, generator=generator)  # by half a block
    start = chart.to_pose(headed(astray, torch.stack(turns[2:], -1)))[:, None]
    background = BACKGROUND.expand(count, -1, -1, -1)
    found = PoseRefinement(12, headings=24)(chart, decoder, start, decoder(true, background), background)
    wrong = angle_between(found[..., 3:], true[..., 3:]) > math.radians(5)
    assert bool(wrong.any()) is misread
