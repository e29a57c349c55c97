"""Systems of velocities and joint impulses: a matrix with a border."""

from __future__ import annotations

import torch
from torch import Tensor


def bordered_factor(matrix: Tensor, joint_jacobian: Tensor) -> tuple[Tensor, Tensor]:
    """Factorise [[A, -J_e^T], [J_e, 0]] (LU with pivoting), for A (B, n, n) and J_e (B, E, n)."""
    if joint_jacobian.shape[1] == 0:
        return torch.linalg.lu_factor_ex(matrix)[:2]  # type: ignore[no-any-return]
    corner = matrix.new_zeros(matrix.shape[0], joint_jacobian.shape[1], joint_jacobian.shape[1])
    upper = torch.cat([matrix, -joint_jacobian.mT], 2)
    return torch.linalg.lu_factor_ex(torch.cat([upper, torch.cat([joint_jacobian, corner], 2)], 1))[:2]  # type: ignore[no-any-return]
