import math

import pytest
import torch
from scipy.spatial.transform import Rotation

from physid.physics.rotations import (
    angle_between,
    conjugate,
    exponential,
    from_matrix,
    logarithm,
    multiply,
    rotate,
    to_matrix,
)

TOLERANCE = 1e-12


@pytest.fixture
def vectors() -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    sizes = torch.tensor([0.0, 1e-9, 1e-4, 0.02, 0.5, 1.5, 3.1], dtype=torch.float64)
    direction = torch.nn.functional.normalize(torch.randn(7, 3, generator=generator, dtype=torch.float64), dim=-1)
    return direction * sizes[:, None]


def test_exponential_and_matrix_agree_with_scipy(vectors: torch.Tensor) -> None:
    expected = Rotation.from_rotvec(vectors.numpy())
    torch.testing.assert_close(exponential(vectors), torch.from_numpy(expected.as_quat()), rtol=0, atol=TOLERANCE)
    torch.testing.assert_close(
        to_matrix(exponential(vectors)), torch.from_numpy(expected.as_matrix()), rtol=0, atol=TOLERANCE
    )


def test_logarithm_inverts_the_exponential_up_to_a_half_turn(vectors: torch.Tensor) -> None:
    torch.testing.assert_close(logarithm(exponential(vectors)), vectors, rtol=0, atol=TOLERANCE)
    torch.testing.assert_close(logarithm(-exponential(vectors)), vectors, rtol=0, atol=TOLERANCE)


def test_a_matrix_turns_back_into_its_quaternion_up_to_sign(vectors: torch.Tensor) -> None:
    quaternion = exponential(vectors)
    back = from_matrix(to_matrix(quaternion))
    assert angle_between(back, quaternion).max() < 1e-7


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_large_turns_about_each_axis_turn_back_whichever_component_is_largest(axis: int) -> None:
    turns = torch.zeros(40, 3, dtype=torch.float64)
    turns[:, axis] = torch.linspace(-torch.pi, torch.pi, 40, dtype=torch.float64)
    turns += 0.05 * torch.tensor([0.3, -0.8, 0.5], dtype=torch.float64)
    back = from_matrix(to_matrix(exponential(turns)))
    assert angle_between(back, exponential(turns)).max() < 1e-7


def test_rotating_composes_as_multiplying(vectors: torch.Tensor) -> None:
    first, second = exponential(vectors), exponential(vectors.flip(0))
    twice = rotate(second, rotate(first, vectors + 1))
    torch.testing.assert_close(rotate(multiply(second, first), vectors + 1), twice, rtol=0, atol=TOLERANCE)
    torch.testing.assert_close(rotate(conjugate(first), rotate(first, vectors)), vectors, rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize(
    "function", [exponential, lambda r: logarithm(exponential(r)), lambda r: to_matrix(exponential(r))]
)
def test_gradients_are_right_everywhere_and_finite_at_zero(vectors: torch.Tensor, function) -> None:  # noqa: ANN001
    inputs = vectors.clone().requires_grad_()
    assert torch.autograd.gradcheck(function, (inputs,), atol=1e-6)


def test_the_angle_of_a_known_turn() -> None:
    turn = exponential(torch.tensor([0.0, 0.0, math.pi / 3], dtype=torch.float64))
    assert float(angle_between(turn, exponential(torch.zeros(3, dtype=torch.float64)))) == pytest.approx(math.pi / 3)


@pytest.mark.parametrize("angle", [1e-8, 1e-4, 0.01, 0.05, 0.0632, 0.0633, 0.5, 3.0])
def test_small_turns_are_as_exact_as_large_ones(angle: float) -> None:
    """On both sides of where the series ends, at half angles whose square is a thousandth."""
    axis = torch.tensor([2.0, -1.0, 2.0], dtype=torch.float64) / 3
    found = exponential(angle * axis)
    expected = torch.cat([math.sin(angle / 2) * axis, torch.tensor([math.cos(angle / 2)], dtype=torch.float64)])
    assert ((found - expected).abs() <= 4e-16 * expected.abs() + 1e-300).all()
