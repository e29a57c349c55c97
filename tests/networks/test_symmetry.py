import math

import pytest
import torch
from tests.networks.residual import rotation_residual

from physid.networks.symmetry import Symmetry, nearest
from physid.physics.rotations import exponential, multiply, to_matrix

TOLERANCE = 1e-9


def rotations(count: int = 50, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return exponential(3 * (torch.rand(count, 1, 3, dtype=torch.float64, generator=generator) - 0.5))


def turn(angle: float) -> torch.Tensor:
    return exponential(torch.tensor([0, 0, angle], dtype=torch.float64)).expand(50, 1, 4)


@pytest.mark.parametrize("symmetry", Symmetry)
def test_turns_that_cannot_be_seen_make_no_error(symmetry: Symmetry) -> None:
    for k in range(-4, 5):
        turned = multiply(rotations(), turn(2 * math.pi * k / symmetry.order))
        assert rotation_residual(turned, rotations(), [symmetry]).norm(dim=-1).max() < TOLERANCE


@pytest.mark.parametrize("symmetry", Symmetry)
@pytest.mark.parametrize("angle", [0.1, 0.7, -0.7, 1.5])
def test_the_error_of_a_turn_is_its_distance_from_the_nearest_unseen_turn(symmetry: Symmetry, angle: float) -> None:
    period = 2 * math.pi / symmetry.order
    expected = abs((angle + period / 2) % period - period / 2)
    error = rotation_residual(multiply(rotations(), turn(angle)), rotations(), [symmetry]).norm(dim=-1)
    assert torch.allclose(error, torch.full_like(error, expected), atol=TOLERANCE)


def test_without_symmetry_the_error_is_the_geodesic_angle() -> None:
    first, second = rotations(seed=1), rotations(seed=2)
    trace = (to_matrix(first).transpose(-1, -2) @ to_matrix(second)).diagonal(dim1=-2, dim2=-1).sum(-1)
    angle = torch.acos((trace - 1) / 2)
    assert torch.allclose(rotation_residual(first, second, [Symmetry.NONE]).norm(dim=-1), angle, atol=1e-7)


def test_the_residual_is_in_the_body_frame_and_signed() -> None:
    step = torch.tensor([0.1, -0.2, 0.3], dtype=torch.float64)
    turned = multiply(rotations(), exponential(step).expand(50, 1, 4))
    assert torch.allclose(rotation_residual(turned, rotations(), [Symmetry.SQUARE]), step, atol=TOLERANCE)


def test_the_nearest_rotation_has_the_sign_of_the_reference() -> None:
    chosen = nearest(-multiply(rotations(), turn(math.pi)), rotations(), [Symmetry.RECTANGLE])
    assert torch.allclose(chosen, rotations(), atol=TOLERANCE)


def test_each_body_has_its_own_symmetry() -> None:
    quarter = multiply(rotations(), turn(math.pi / 2)).expand(-1, 2, -1)
    error = rotation_residual(quarter, rotations().expand(-1, 2, -1), [Symmetry.SQUARE, Symmetry.NONE]).norm(dim=-1)
    assert torch.allclose(error[:, 0], torch.zeros(50, dtype=torch.float64), atol=TOLERANCE)
    assert torch.allclose(error[:, 1], torch.full((50,), math.pi / 2, dtype=torch.float64), atol=TOLERANCE)


def test_its_gradient_is_finite_at_zero_error() -> None:
    q = rotations().requires_grad_()
    rotation_residual(q, rotations(), [Symmetry.SQUARE]).square().sum().backward()
    assert torch.isfinite(q.grad).all()
