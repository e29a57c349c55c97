import torch

from physid.scenes.catalogue import find_setup
from physid.training.decoder import Decoder
from physid.training.polish import Polish
from physid.training.video_model import chart_of

SCENE = find_setup("push").scene
TOLERANCE = 1e-3  # [m], [rad]; a pixel is 21 mm


def test_a_pose_that_is_off_by_a_third_of_the_body_is_found_again() -> None:
    torch.manual_seed(0)
    chart, decoder = chart_of(SCENE, "planar"), Decoder(SCENE)
    colours = torch.rand(1, 1, 6, 3, 4, 4)
    decoder.patches = torch.nn.functional.interpolate(colours.flatten(0, 2), size=32).view(1, 1, 6, 3, 32, 32)
    background = torch.full((1, 3, 128, 128), 0.7)
    numbers = torch.tensor([[0.3, -0.2, 0.8, 0.6], [-0.5, 0.4, 0.0, -1.0]])[None, :, None]
    true = chart.to_pose(numbers)
    start = chart.to_pose(numbers + torch.tensor([0.05, -0.04, 0.1, 0.1]))
    image = decoder(true, background)
    found = Polish(steps=12)(chart, decoder, start, image, background)
    assert (start - true).abs().max() > 30 * TOLERANCE
    assert (found - true).abs().max() < TOLERANCE


def test_no_steps_leave_the_poses_as_they_are() -> None:
    chart, decoder = chart_of(SCENE, "planar"), Decoder(SCENE)
    pose = chart.to_pose(chart.neutral()[None, None, None])
    image = torch.zeros(1, 1, 3, 128, 128)
    assert Polish(steps=0)(chart, decoder, pose, image, image[0]) is pose
