"""The gradient of a contact problem's solution, attached after solving, by the implicit function theorem."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from physid.physics.contact_problem.bordered import bordered_factor
from physid.physics.contact_problem.lcp import ContactProblem, ContactSolution
from physid.physics.guards.first_derivative import only_first


def attach_gradient(problem: ContactProblem, solution: ContactSolution) -> tuple[Tensor, Tensor]:
    """Return the solution's (v, impulse) as differentiable functions of the problem.

    With lambda = Lambda(J v + c, mu) the impulse law of the smoothed contacts, c the offset of the normal and the slip
    of the tangents, and W = -dLambda/du, the solution is the root of F = M v - p - J^T Lambda - J_e^T lambda_e, so that

        A dv = dp - dM v + dJ^T lambda + J^T (-W (dJ v + dc) + dLambda/dmu dmu),   A = M + J^T W J,

    bordered by J_e dv = db_e - dJ_e v. Backward solves the *transposed* system: W is not symmetric when contacts slide.

    Args:
        problem: The problem, with gradients.
        solution: What `solve_contacts` found for it.

    Returns:
        v of shape (B, n) and the contact impulses of shape (B, C, 3).
    """
    v, impulse = _Root.apply(  # type: ignore[no-untyped-call]
        problem.mass,
        problem.momentum,
        problem.jacobian,
        problem.offset,
        problem.slip,
        problem.friction,
        problem.compliance,
        problem.joint_jacobian,
        problem.joint_velocity,
        solution,
    )
    return v, impulse


class _Root(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> tuple[Tensor, Tensor]:
        *problem, solution = inputs
        ctx.save_for_backward(
            *problem,
            solution.velocity,
            solution.impulse,
            solution.joint_impulse,
            solution.response,
            solution.friction_response,
        )
        return solution.velocity.clone(), solution.impulse.clone()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        *problem, v, impulse, joint, response, friction_response = ctx.saved_tensors
        mass, _, jacobian, *_, joint_jacobian, _ = problem
        to_v, to_impulse = gradients
        n = v.shape[1]
        matrix = mass + torch.einsum("bckn,bckl,bclm->bnm", jacobian, response, jacobian)
        pulled = torch.einsum("bclk,bcl->bck", response, to_impulse)
        right = torch.cat([to_v - torch.einsum("bckn,bck->bn", jacobian, pulled), torch.zeros_like(joint)], 1)
        factor = bordered_factor(matrix, joint_jacobian)
        y, y_joint = torch.linalg.lu_solve(*factor, right[..., None], adjoint=True)[..., 0].split(
            [n, joint.shape[1]], 1
        )
        q = torch.einsum("bckn,bn->bck", jacobian, y) + to_impulse
        to_u = -torch.einsum("bclk,bcl->bck", response, q)
        slopes = (
            -y[:, :, None] * v[:, None, :],
            y,
            impulse[..., None] * y[:, None, None, :] + to_u[..., None] * v[:, None, None, :],
            to_u[..., 0],
            to_u[..., 1:],
            (q * friction_response).sum(-1),
            to_u[..., 0] * impulse[..., 0],
            joint[..., None] * y[:, None, :] - y_joint[..., None] * v[:, None, :],
            y_joint,
        )
        return (*only_first(slopes, (*problem, *gradients)), None)
