"""An encoder whose places vote."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn

from physid.networks import Encoding, PinholeCamera, PlanarChart, PoseChart, SpatialChart
from physid.networks.appearance import Appearance
from physid.networks.encoder import Layers
from physid.networks.renderer import BoxRenderer
from physid.networks.voting import VotingPoseEncoder

CAMERA = PinholeCamera(128, 96, (0, 0, 3), (0, 0, 0), (0, 1, 0), 40.0)
CHART = PlanarChart(CAMERA, (0, 0, 1), 0.0, [0.2, 0.2])
BACKGROUND = torch.full((1, 3, 96, 128), 0.7)
STRIDE = 8  # [px] between places


def shown(*places: tuple[int, int]) -> Tensor:
    """Draw one speckled square of 20 pixels at places (row, column)."""
    frames, patch = (
        BACKGROUND.repeat(len(places), 1, 1, 1),
        torch.rand(3, 20, 20, generator=torch.Generator().manual_seed(1)),
    )
    for frame, (row, column) in zip(frames, places, strict=True):
        frame[:, row : row + 20, column : column + 20] = patch
    return frames


def test_what_is_read_beside_a_body_moves_with_it() -> None:
    torch.manual_seed(0)
    encoder = VotingPoseEncoder(CHART, 96, 128, Layers(fast=False))
    with torch.no_grad():
        for value in encoder.correction.parameters():
            value.zero_()
    here, right, down = encoder(shown((24, 24), (24, 24 + 2 * STRIDE), (24 + 3 * STRIDE, 24)), BACKGROUND).numbers
    torch.testing.assert_close(right[:, 2:], here[:, 2:], rtol=0, atol=1e-5)
    torch.testing.assert_close(down[:, 2:], here[:, 2:], rtol=0, atol=1e-5)
    assert right[:, 1].tolist() == pytest.approx(here[:, 1].tolist(), abs=1e-5)
    assert down[:, 0].tolist() == pytest.approx(here[:, 0].tolist(), abs=1e-5)
    # Two places of 128 pixels, three of 96: the same share of both in units of half the view.
    across, along = (right - here)[:, 0] / (2 * STRIDE / 64), (down - here)[:, 1] / (3 * STRIDE / 48)
    torch.testing.assert_close(across, along, rtol=1e-3, atol=1e-6)


def test_where_one_place_has_all_weight_its_own_position_is_read() -> None:
    encoder = VotingPoseEncoder(CHART, 96, 128)
    image = shown((32, 48))
    with torch.no_grad():
        for value in (*encoder.correction.parameters(), *encoder.votes.parameters()):
            value.zero_()
        middle = encoder(image, BACKGROUND).numbers
    # All places alike: their mean, and the neutral pose.
    torch.testing.assert_close(middle[0, :, 2:], CHART.neutral()[2:].expand(2, -1))
    torch.testing.assert_close(middle[0, 0, :2], encoder.grid.flatten(1).mean(1))
    rows, columns = encoder.grid.shape[1:]
    assert (rows, columns) == ((96 - 29) // STRIDE + 1, (128 - 29) // STRIDE + 1)
    # The first place sees pixels 0 to 28: its middle is that of pixel 14.
    torch.testing.assert_close(encoder.grid[:, 0, 0], torch.tensor([14.5 / 64 - 1, 14.5 / 48 - 1]))


def test_no_body_is_read_far_below_the_ground_and_the_rest_is_read_as_before() -> None:
    """A height of -0.2 becomes -0.01; above the ground, and in all other numbers, nothing changes."""
    chart = PlanarChart(CAMERA, (0, 0, 1), 0.0, [0.2], hovering=True)
    encoder, image = VotingPoseEncoder(chart, 96, 128), shown((32, 48))
    with torch.no_grad():
        for value in (*encoder.correction.parameters(), *encoder.votes.parameters()):
            value.zero_()
        read = []
        for height in (-0.2, 0.0, 0.2):
            encoder.correction[-1].bias[:] = torch.tensor([-0.3, 0.1, -0.4, -0.5, height])
            read.append(encoder(image, BACKGROUND).numbers[0, 0])
    assert [float(one[4]) for one in read] == pytest.approx([-0.01, 0.0, 0.2])
    middle = torch.cat([encoder.grid.flatten(1).mean(1), chart.neutral()[2:4]])
    for one in read:
        torch.testing.assert_close(one[:4], middle + torch.tensor([-0.3, 0.1, -0.4, -0.5]))


HOVERING = PlanarChart(CAMERA, (0, 0, 1), 0.0, [0.2, 0.2], hovering=True)


@pytest.mark.parametrize("chart", [CHART, HOVERING, SpatialChart(CAMERA, 2)], ids=["planar", "hovering", "spatial"])
def test_gradients_reach_every_weight_and_features_have_the_widths_of_the_paper(chart: PoseChart) -> None:
    encoder = VotingPoseEncoder(chart, 96, 128)
    encoding: Encoding = encoder(shown((30, 40), (40, 70)), BACKGROUND)
    (encoding.pose.square().sum() + encoding.pose.sum()).backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in encoder.parameters())
    assert (encoding.early.shape, encoding.late.shape) == ((2, 256), (2, 128))
    assert encoding.divergence.tolist() == [0.0, 0.0]


def test_images_smaller_than_what_a_place_sees_are_refused() -> None:
    with pytest.raises(
        ValueError, match="frames of 28 x 128 px are too small for the encoder; use at least 29 x 29 px"
    ):
        VotingPoseEncoder(CHART, 28, 128)
    assert VotingPoseEncoder(CHART, 29, 128).grid.shape == (2, 1, 13)


@pytest.mark.slow
def test_a_few_hundred_images_teach_where_a_body_is() -> None:
    torch.manual_seed(0)
    chart = PlanarChart(CAMERA, (0, 0, 1), 0.0, [0.2])
    renderer = BoxRenderer(CAMERA, torch.tensor([[0.3, 0.2, 0.2]]))
    look = Appearance(torch.rand(1, 1, 6, 3, 8, 8))
    encoder = VotingPoseEncoder(chart, 96, 128)
    optimizer = torch.optim.AdamW(encoder.parameters(), 2e-3)

    def draw(count: int) -> tuple[Tensor, Tensor]:
        numbers = torch.cat(
            [1.4 * torch.rand(count, 1, 2) - 0.7, nn.functional.normalize(torch.randn(count, 1, 2), dim=-1)], -1
        )
        pose = chart.to_pose(numbers)
        return renderer(pose[None], look, BACKGROUND)[0], pose

    for _ in range(40):
        image, pose = draw(8)
        error = (encoder(image, BACKGROUND).pose - pose)[..., :3].square().sum(-1).mean()
        optimizer.zero_grad()
        error.backward()
        optimizer.step()
    image, pose = draw(64)
    with torch.no_grad():
        distance = (encoder(image, BACKGROUND).pose - pose)[..., :3].norm(dim=-1)
    assert float(distance.median()) < 0.1  # [m], of a view of 2 m
