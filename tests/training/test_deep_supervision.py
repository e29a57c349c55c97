import math

import torch

from physid.networks import Encoding, PinholeCamera, PlanarChart, SpatialChart
from physid.training.vision.deep_supervision import HARMONICS, DeepSupervision, rotation_features

CAMERA = PinholeCamera(128, 128, (0, 0, 3), (0, 0, 0), (0, 1, 0), 40.0)
CHART = PlanarChart(CAMERA, (0, 0, 1), 0.0, [0.2, 0.2])
TOLERANCE = 1e-5


def numbers(angle: float) -> torch.Tensor:
    return torch.tensor([0.3, -0.2, math.cos(angle), math.sin(angle)]).expand(2, 4)


def test_what_is_read_is_harmonics_of_the_heading_of_which_only_the_first_tells_opposite_ones_apart() -> None:
    here, opposite = (rotation_features(CHART, numbers(a)) for a in (0.7, 0.7 + math.pi))
    expected = [[math.cos(n * 0.7) for n in HARMONICS] + [math.sin(n * 0.7) for n in HARMONICS]] * 2
    assert torch.allclose(here, torch.tensor(expected), atol=TOLERANCE)
    odd = torch.tensor([n % 2 == 1 for n in HARMONICS] * 2)
    assert torch.allclose(opposite[:, odd], -here[:, odd], atol=TOLERANCE)
    assert torch.allclose(opposite[:, ~odd], here[:, ~odd], atol=TOLERANCE)


def test_in_space_it_is_the_numbers_of_the_rotation() -> None:
    chart = SpatialChart(CAMERA, 2)
    given = torch.rand(3, 2, chart.numbers)
    assert torch.equal(rotation_features(chart, given), given[..., chart.turning])


def test_features_that_show_the_heading_are_read_without_error_and_the_gradient_reaches_them() -> None:
    supervision, angles = DeepSupervision(CHART), torch.linspace(0, 6, 40)
    seen = torch.stack([numbers(float(a)) for a in angles])[:, None]
    goal = rotation_features(CHART, seen).flatten(-2)
    early, late = torch.zeros(40, 1, 256), torch.zeros(40, 1, 128)
    early[..., : goal.shape[-1]] = late[..., : goal.shape[-1]] = goal
    early.requires_grad_(True)
    encoding = Encoding(torch.zeros(40, 1, 2, 7), seen, torch.zeros(40, 1), early, late)
    before = supervision(CHART, encoding, seen).mean()
    before.backward()
    assert early.grad is not None
    assert early.grad.abs().max() > 0
    optimizer = torch.optim.Adam(supervision.parameters(), lr=0.3)
    for _ in range(200):
        optimizer.zero_grad()
        loss = supervision(CHART, encoding, seen).mean()
        loss.backward()
        optimizer.step()
    assert loss < 1e-3 * before
