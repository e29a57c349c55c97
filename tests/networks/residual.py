"""The rotation error modulo what cannot be seen."""

from collections.abc import Sequence

from torch import Tensor

from physid.networks.symmetry import Symmetry, nearest
from physid.physics.rotations import conjugate, logarithm, multiply


def rotation_residual(quaternion: Tensor, target: Tensor, symmetries: Sequence[Symmetry]) -> Tensor:
    """Return ln(target^-1 q), the smallest among the turns of each body, in the target's body frame."""
    return logarithm(multiply(conjugate(target), nearest(quaternion, target, symmetries)))
