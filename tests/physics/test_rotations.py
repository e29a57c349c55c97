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


@pytest.mark.parametrize("angle", [1e-12, 1e-8, 1e-5, 1e-3, 1.9e-3, 2.1e-3, 0.01, 1.0, 2.0, 3.1])
def test_logarithms_of_small_turns_are_as_exact_as_of_large_ones(angle: float) -> None:
    """On both sides of where the series ends, at vectors whose square is a millionth."""
    axis = torch.tensor([2.0, -1.0, 2.0], dtype=torch.float64) / 3
    quaternion = torch.cat([math.sin(angle / 2) * axis, torch.tensor([math.cos(angle / 2)], dtype=torch.float64)])
    torch.testing.assert_close(logarithm(quaternion), angle * axis, rtol=1e-15, atol=0)


def test_a_half_turn_has_an_axis_and_finite_slopes() -> None:
    half = torch.tensor([0.6, 0.0, 0.8, 0.0], dtype=torch.float64, requires_grad=True)
    turn = logarithm(half)
    torch.testing.assert_close(turn.detach(), math.pi * half.detach()[:3])
    (slope,) = torch.autograd.grad(turn.sum(), half)
    assert bool(slope.isfinite().all())


@pytest.mark.parametrize("shape", [(), (5,), (2, 3)])
def test_rotations_of_any_shape_are_those_of_each_alone(shape: tuple[int, ...]) -> None:
    generator = torch.Generator().manual_seed(1)
    turn, other = torch.randn(2, *shape, 3, generator=generator, dtype=torch.float64)
    quaternion, second = exponential(turn), exponential(other)
    whole = (to_matrix(quaternion), from_matrix(to_matrix(quaternion)), angle_between(quaternion, second))
    assert [each.shape for each in whole] == [(*shape, 3, 3), (*shape, 4), shape]
    flat = quaternion.reshape(-1, 4), second.reshape(-1, 4)
    for k, (one, two) in enumerate(zip(*flat, strict=True)):
        assert torch.equal(whole[0].reshape(-1, 3, 3)[k], to_matrix(one))
        assert torch.equal(whole[1].reshape(-1, 4)[k], from_matrix(to_matrix(one)))
        assert torch.equal(whole[2].reshape(-1)[k], angle_between(one, two))
    torch.testing.assert_close(rotate(quaternion, other), (to_matrix(quaternion) @ other[..., None])[..., 0])


def test_one_rotation_turns_many_vectors_and_many_one() -> None:
    turns = exponential(torch.randn(4, 3, generator=torch.Generator().manual_seed(2), dtype=torch.float64))
    vectors = torch.eye(3, dtype=torch.float64)
    torch.testing.assert_close(rotate(turns[0], vectors), to_matrix(turns[0]).mT)
    torch.testing.assert_close(rotate(turns, vectors[1]), to_matrix(turns)[:, :, 1])


@pytest.mark.parametrize("largest", [0, 1, 2, 3])
def test_the_quaternion_of_a_matrix_is_exact_whichever_component_is_largest(largest: int) -> None:
    generator = torch.Generator().manual_seed(3)
    quaternion = 0.3 * torch.randn(50, 4, generator=generator, dtype=torch.float64)
    quaternion[:, largest] = 1.0
    quaternion = torch.nn.functional.normalize(quaternion, dim=1)
    back = from_matrix(to_matrix(quaternion))
    torch.testing.assert_close(back * (back * quaternion).sum(1, keepdim=True).sign(), quaternion, rtol=0, atol=1e-14)
