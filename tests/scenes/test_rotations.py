"""Quaternions in NumPy against SciPy."""

import numpy as np
from scipy.spatial.transform import Rotation

from physid.scenes.rotations import between, conjugate, from_vector, multiply, rotate, to_vector

TOLERANCE = 1e-12
A = Rotation.random(50, random_state=1)
B = Rotation.random(50, random_state=2)
POINTS = np.random.default_rng(0).normal(size=(50, 3))


def test_products_inverses_and_rotated_vectors_are_those_of_scipy() -> None:
    product = multiply(A.as_quat(), B.as_quat())
    assert np.abs(rotate(product, POINTS) - (A * B).apply(POINTS)).max() < TOLERANCE
    assert np.abs(rotate(conjugate(A.as_quat()), POINTS) - A.inv().apply(POINTS)).max() < TOLERANCE


def test_rotation_vectors_and_quaternions_turn_into_each_other() -> None:
    assert np.abs(to_vector(A.as_quat()) - A.as_rotvec()).max() < TOLERANCE
    assert np.abs(rotate(from_vector(A.as_rotvec()), POINTS) - A.apply(POINTS)).max() < TOLERANCE
    assert np.array_equal(from_vector(np.zeros(3)), [0, 0, 0, 1])
    assert not to_vector([0, 0, 0, 1]).any()


def test_the_shortest_rotation_between_two_directions_takes_one_to_the_other() -> None:
    end = np.array([0.6, 0.0, 0.8])
    assert np.abs(rotate(between([0, 0, 1], end), [0, 0, 1]) - end).max() < TOLERANCE
