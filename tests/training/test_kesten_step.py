"""Steps that turn back are shortened, others are not, and a checkpoint forgets nothing."""

import pytest
import torch
from torch import Tensor

from physid.training.refinement.kesten_step import KestenStep

CURVATURE = torch.tensor([[3.0, 0.5], [0.5, 0.2]], dtype=torch.float64)
FAR = torch.tensor([0.4, -0.3], dtype=torch.float64)


def gone(where: Tensor, share: float, noise: Tensor) -> Tensor:
    """Go by `share` of the way to zero and by noise (steps, 2) each time; returns all places."""
    calm, places = KestenStep(), [where]
    for astray in noise:
        places.append(places[-1] + calm(astray - share * places[-1], CURVATURE))
    return torch.stack(places)


@pytest.mark.parametrize("share", [0.3, 0.9, 1.0, 1.4])
def test_steps_that_converge_are_as_long_as_without_it(share: float) -> None:
    steps = torch.arange(7).double()[:, None]
    torch.testing.assert_close(gone(FAR, share, torch.zeros(6, 2)), FAR * (1 - share) ** steps)


@pytest.mark.parametrize("share", [1.9, 2.0, 2.5])
def test_steps_that_go_to_and_fro_end_in_the_middle(share: float) -> None:
    assert float((gone(FAR, share, torch.zeros(16, 2))[-1] / FAR).abs().max()) < 0.01


def test_noise_in_the_steps_is_averaged() -> None:
    """Of the places where 16 steps end, whose noise has a deviation of one; full steps would keep it."""
    noise = torch.randn(300, 16, 2, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    ends = torch.stack([gone(torch.zeros(2).double(), 1.0, one)[-1] for one in noise])
    assert float(ends.square().mean().sqrt()) < 0.45


def test_a_checkpoint_keeps_the_last_step_and_the_count() -> None:
    first, second = KestenStep(), KestenStep()
    for sign in (1, -1, 1):
        first(sign * FAR, CURVATURE)
    second.load_state_dict(first.state_dict())
    torch.testing.assert_close(second(-FAR, CURVATURE), -FAR / 4)
