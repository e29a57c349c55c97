"""The contact problem of one step, eq. (3) of the paper, and its solution by a primal-dual interior point method.

Velocities are in units of g h and impulses in units of m g h, so that a body at rest has numbers of order one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import torch
from torch import Tensor
from torch.nn.functional import pad

from physid.physics.compiled import compile_or_not
from physid.physics.contact_problem.bordered import bordered_factor
from physid.physics.contact_problem.cones import arrow, jordan, longest_step
from physid.physics.contact_problem.friction import NORMAL, SLIP, Cone, FrictionLaw
from physid.physics.contact_problem.rounding import allowance, largest_error


@dataclass(frozen=True)
class SolverSettings:
    """How contact problems are solved.

    Attributes:
        smoothing: tau, the product z o w at which the solution is taken [-]; float32 uses 1e-4 if that is larger.
        tolerance: Largest accepted residual of all equations, in units of tau; more where rounding is (see `rounding`).
        max_steps: Newton steps before giving up.
        compliance: Normal compliance [-]; where a solve jams it is repeated with the next one. Rigid bodies with much
            friction can have several velocities, or none (Painleve's paradox); compliance makes it one.
        compiled: Whether torch compiles the Newton step, some 300 operations that an accelerator would start one by
            one; None for where the tensors are on an accelerator.
    """

    smoothing: float = 1e-8
    tolerance: float = 1e-3
    max_steps: int = 120
    compliance: tuple[float, ...] = (1e-6, 1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0, 1000.0)
    compiled: bool | None = None

    def tau(self, dtype: torch.dtype) -> float:
        """Return the smoothing that `dtype` can resolve."""
        return max(self.smoothing, 1e-4) if dtype == torch.float32 else self.smoothing

    def residual(self, dtype: torch.dtype) -> float:
        """Return the accepted residual that `dtype` can resolve."""
        return self.tau(dtype) * (1.0 if dtype == torch.float32 else self.tolerance)


@dataclass(frozen=True)
class ContactProblem:
    """A batch of contact problems with n velocity unknowns, C contacts and E equality rows.

    Find v, joint impulses and contact impulses (lambda_c, lambda_f) with

        M v = p + J^T lambda + J_e^T lambda_e,   J_e v = b_e,   u = J v,
        0 <= u_n + c + k lambda_c  _|_  lambda_c >= 0,   friction as its law says.

    Attributes:
        mass: M, shape (B, n, n).
        momentum: p = M v + h f, shape (B, n).
        jacobian: J, rows (normal, tangent, tangent) per contact, shape (B, C, 3, n).
        offset: c, shape (B, C).
        slip: What is added to the tangential velocity that friction opposes, shape (B, C, 2).
        friction: mu, shape (B, C).
        compliance: k, what a user or an effect adds to the solver's own, shape (B, C).
        joint_jacobian: J_e, shape (B, E, n).
        joint_velocity: b_e, shape (B, E).
    """

    mass: Tensor
    momentum: Tensor
    jacobian: Tensor
    offset: Tensor
    slip: Tensor
    friction: Tensor
    compliance: Tensor
    joint_jacobian: Tensor
    joint_velocity: Tensor

    def select(self, worlds: Tensor) -> ContactProblem:
        """Return the problems of the worlds that a mask (B,) names."""
        return ContactProblem(**{f.name: getattr(self, f.name)[worlds] for f in dataclasses.fields(self)})

    def detach(self) -> ContactProblem:
        """Return the same problem without gradients."""
        return ContactProblem(**{f.name: getattr(self, f.name).detach() for f in dataclasses.fields(self)})


@dataclass(frozen=True)
class ContactSolution:
    """What the solver found, and how well.

    Attributes:
        velocity: v, shape (B, n).
        impulse: (lambda_c, lambda_t), shape (B, C, 3).
        joint_impulse: lambda_e, shape (B, E).
        response: W = -d impulse / d u, shape (B, C, 3, 3).
        friction_response: d impulse / d mu, shape (B, C, 3).
        residual: Largest violated equation, in units of tau or, where that is more, of rounding, shape (B,).
        steps: Newton steps taken, shape (B,).
        converged: Whether the residual is within the tolerance, shape (B,).
    """

    velocity: Tensor
    impulse: Tensor
    joint_impulse: Tensor
    response: Tensor
    friction_response: Tensor
    residual: Tensor
    steps: Tensor
    converged: Tensor

    def merge(self, worlds: Tensor, other: ContactSolution) -> ContactSolution:
        """Return this solution with the worlds that a mask (B,) names taken from `other`."""
        names = [field.name for field in dataclasses.fields(self)]
        return ContactSolution(**{n: getattr(self, n).index_put((worlds,), getattr(other, n)) for n in names})


def solve_contacts(
    problem: ContactProblem, law: FrictionLaw | None = None, settings: SolverSettings | None = None
) -> ContactSolution:
    """Solve a batch of contact problems, without gradient.

    Follows the central path z o w = mu with a predictor and a centred corrector (Mattingley & Boyd 2012, without
    Mehrotra's second-order term, which jams here) to z o w = tau, and stays there: the solution is a smooth function
    of the problem.

    Args:
        problem: What to solve.
        law: Friction; a circular cone unless told otherwise.
        settings: Accuracy and effort.

    Returns:
        The solutions, with `converged` of shape (B,): the caller decides what a failure means.
    """
    law, settings = law or Cone(), settings or SolverSettings()
    problem = problem.detach()
    with torch.no_grad():
        compiled = problem.mass.device.type != "cpu" if settings.compiled is None else settings.compiled
        solution = _follow_path(problem, law, settings, settings.compliance[0], _newton_step(compiled))
        for compliance in settings.compliance:  # the first once more: rounding alone may have been in the way
            jammed = ~solution.converged
            if not bool(jammed.any()):
                break
            again = _follow_path(problem.select(jammed), law, settings, compliance, partial(_Path.advance, refined=1))
            solution = solution.merge(jammed, again)
    return solution


def _follow_path(
    problem: ContactProblem,
    law: FrictionLaw,
    settings: SolverSettings,
    compliance: float,
    advance: Callable[[_Path, Tensor], None],
) -> ContactSolution:
    path = _Path(problem, law, compliance, settings)
    accepted = settings.residual(problem.mass.dtype)
    done = torch.zeros_like(problem.momentum[:, 0], dtype=torch.bool)
    steps = torch.zeros_like(done, dtype=torch.long)
    for _ in range(settings.max_steps):
        done = path.residual() <= accepted
        if bool(done.all()):
            break
        steps = steps + ~done
        advance(path, ~done)
    converged = path.residual() <= accepted
    advance(path, converged)  # one more: it doubles the digits, which gradients at the solution profit from
    residual = path.residual()
    response, friction_response = path.response()
    return ContactSolution(
        velocity=path.v,
        impulse=path.impulse(),
        joint_impulse=path.joint,
        response=response,
        friction_response=friction_response,
        residual=residual / path.tau,
        steps=steps,
        converged=converged,
    )


class _Path:
    """The iterate (v, z, w) of a batch on its way along the central path."""

    def __init__(self, problem: ContactProblem, law: FrictionLaw, compliance: float, settings: SolverSettings) -> None:
        self.problem, self.tau, self.linear = problem, settings.tau(problem.mass.dtype), law.linear
        self.rows = problem.jacobian.flatten(1, 2)  # matrix products of rows cost less than einsum of three indices
        self.g, h, self.p = law.matrices(problem.mass)
        self.h = h.expand(*problem.offset.shape, *h.shape).clone()
        self.h[..., NORMAL, NORMAL] = compliance + problem.compliance
        self.h[..., SLIP, NORMAL] = problem.friction
        self.v = torch.linalg.solve(problem.mass, problem.momentum)
        self.allowed = allowance(problem.jacobian, problem.offset, self.v, settings.residual(self.v.dtype))
        self.joint = torch.zeros_like(problem.joint_velocity)
        self.z, self.w = law.start(self._at(self.v), problem.offset, problem.friction)
        self.target = torch.full_like(self.z, self.tau)
        self.target[..., law.linear + 1 :] = 0
        self.pairs = problem.offset.shape[1] * (law.linear + (law.size > law.linear))
        self._evaluate()

    def _relative(self, v: Tensor) -> Tensor:
        return (self.rows @ v[..., None]).view(self.problem.jacobian.shape[:-1])

    def _force(self, impulse: Tensor, joint: Tensor) -> Tensor:
        """Return J^T lambda + J_e^T lambda_e, shape (B, n)."""
        return (impulse.flatten(1)[:, None] @ self.rows + joint[:, None] @ self.problem.joint_jacobian)[:, 0]

    def _at(self, v: Tensor) -> Tensor:
        return self._relative(v) + pad(self.problem.slip, (1, 0))

    def impulse(self) -> Tensor:
        """Return (lambda_c, lambda_t), shape (B, C, 3)."""
        return self.z @ self.p.T

    def _evaluate(self) -> None:
        problem = self.problem
        affine = self._at(self.v) @ self.g.T + (self.h @ self.z[..., None])[..., 0]
        affine[..., NORMAL] += problem.offset
        self.slack_error = self.w - affine
        self.product = jordan(self.z, self.w, self.linear)
        inertial = (problem.mass @ self.v[..., None])[..., 0]
        self.force_error = inertial - problem.momentum - self._force(self.impulse(), self.joint)
        self.joint_error = (problem.joint_jacobian @ self.v[..., None])[..., 0] - problem.joint_velocity

    def residual(self) -> Tensor:
        """Return the largest violated equation of each world, less where rounding allows for more, shape (B,)."""
        sums = (self.slack_error, self.force_error, self.joint_error)
        return largest_error(sums, self.product - self.target, self.allowed)

    def _gap(self, product: Tensor) -> Tensor:
        """Return the mean product of a pair, shape (B,)."""
        heads = product[..., : self.linear + 1] if product.shape[-1] > self.linear else product
        return heads.flatten(1).sum(1) / max(self.pairs, 1)

    def advance(self, active: Tensor, refined: int = 0) -> None:
        """Take one predictor-corrector step in the worlds that the mask (B,) names; refined, or not (`_direction`)."""
        blocks = self._eliminate()
        gap = self._gap(self.product)
        _, _, dz, dw = self._direction(*blocks, torch.zeros_like(gap))
        length = self._length(dz, dw).clamp_max(1)[:, None, None]
        predicted = self._gap(jordan(self.z + length * dz, self.w + length * dw, self.linear))
        sigma = ((predicted / gap).clamp(0, 1) ** 3).clamp_min(0.1)
        dv, djoint, dz, dw = self._direction(*blocks, (sigma * gap).clamp_min(self.tau), refined)
        length = (0.99 * self._length(dz, dw)).clamp_max(1) * active
        self.v = self.v + length[:, None] * dv
        self.joint = self.joint + length[:, None] * djoint
        self.z = self.z + length[:, None, None] * dz
        self.w = self.w + length[:, None, None] * dw
        self._evaluate()

    def _eliminate(self) -> tuple[Tensor, Tensor, tuple[Tensor, Tensor]]:
        """Express dz by du in every contact, and factorise what remains for (dv, d lambda_e)."""
        arrow_z, arrow_w = arrow(self.z, self.linear), arrow(self.w, self.linear)
        inverse, _ = torch.linalg.inv_ex(arrow_z @ self.h + arrow_w)
        gain = inverse @ arrow_z
        response = self.p @ gain @ self.g
        problem = self.problem
        matrix = problem.mass + self.rows.mT @ (response @ problem.jacobian).flatten(1, 2)
        return inverse, gain, bordered_factor(matrix, problem.joint_jacobian)

    def _direction(
        self, inverse: Tensor, gain: Tensor, factor: tuple[Tensor, Tensor], target: Tensor, refined: int = 0
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Solve the Newton equations for z o w = target e, from factors that do not depend on the target.

        Contacts that stick turn what rounding leaves of dv into forces; these are solved for again, `refined` times.
        """
        problem = self.problem
        wanted = self.target / self.tau * target[:, None, None] - self.product
        dz = (inverse @ wanted[..., None] + gain @ self.slack_error[..., None])[..., 0]
        dv, djoint = torch.zeros_like(self.v), torch.zeros_like(self.joint)
        for _ in range(1 + refined):
            force = self._force(dz @ self.p.T, djoint) - self.force_error - (problem.mass @ dv[..., None])[..., 0]
            apart = -self.joint_error - (problem.joint_jacobian @ dv[..., None])[..., 0]
            more = torch.linalg.lu_solve(*factor, torch.cat([force, apart], 1)[..., None])[..., 0]
            dv, djoint = dv + more[:, : dv.shape[1]], djoint + more[:, dv.shape[1] :]
            dz = dz - (gain @ (self._relative(more[:, : dv.shape[1]]) @ self.g.T)[..., None])[..., 0]
        dw = self._relative(dv) @ self.g.T + (self.h @ dz[..., None])[..., 0] - self.slack_error
        return dv, djoint, dz, dw

    def _length(self, dz: Tensor, dw: Tensor) -> Tensor:
        """Return the longest step, at most 2, that stays in the cones, shape (B,)."""
        return longest_step(torch.cat([self.z, self.w], 1), torch.cat([dz, dw], 1), self.linear).clamp_max(2.0)

    def response(self) -> tuple[Tensor, Tensor]:
        """Return W = -d impulse / d u (B, C, 3, 3) and d impulse / d mu (B, C, 3) at the solution."""
        _, gain, _ = self._eliminate()
        friction = -(self.p @ gain[..., SLIP, None])[..., 0] * self.z[..., NORMAL, None]
        return self.p @ gain @ self.g, friction


@cache
def _newton_step(compiled: bool) -> Callable[[_Path, Tensor], None]:
    """Return what takes a step of a path."""
    return compile_or_not(_Path.advance, "the contact solver") if compiled else _Path.advance
