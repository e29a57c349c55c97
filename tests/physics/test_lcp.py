"""The contact problem: complementarity, robustness and the gradient at the solution."""

import dataclasses

import pytest
import torch
from torch import Tensor

from physid.physics.contact_problem.friction import Cone, FrictionLaw, Pyramid
from physid.physics.contact_problem.implicit import attach_gradient
from physid.physics.contact_problem.lcp import ContactProblem, SolverSettings, solve_contacts

LAWS = [Cone(), Pyramid(4), Pyramid(16)]
COMPLEMENTARITY = 1e-6


def random_problem(batch: int, contacts: int = 3, seed: int = 0, dtype: torch.dtype = torch.float64) -> ContactProblem:
    """Draw bodies with contacts around them; three contacts, so that the solution is unique."""
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    angles = torch.arange(contacts, dtype=torch.float64) * 2 * torch.pi / contacts
    arms = torch.stack([0.5 * angles.cos(), 0.5 * angles.sin(), -0.4 * torch.ones(contacts, dtype=torch.float64)], -1)
    arms = arms + 0.05 * normal(batch, contacts, 3)
    axes = torch.eye(3, dtype=torch.float64)[[2, 0, 1]].expand(batch, contacts, 3, 3)
    jacobian = torch.cat([torch.linalg.cross(arms[:, :, None].expand(-1, -1, 3, -1), axes), axes], -1)
    mass = torch.diag(torch.tensor([0.1, 0.1, 0.1, 1, 1, 1.0], dtype=torch.float64)).expand(batch, 6, 6)
    velocity = normal(batch, 6) * torch.tensor([2.0, 2, 5, 10, 10, 3])
    problem = ContactProblem(
        mass=mass,
        momentum=(mass @ velocity[..., None])[..., 0] - torch.tensor([0, 0, 0, 0, 0, 1.0], dtype=torch.float64),
        jacobian=jacobian,
        offset=0.3 * normal(batch, contacts),
        slip=torch.zeros(batch, contacts, 2, dtype=torch.float64),
        friction=torch.rand(batch, contacts, generator=generator, dtype=torch.float64),
        compliance=torch.zeros(batch, contacts, dtype=torch.float64),
        joint_jacobian=torch.zeros(batch, 0, 6, dtype=torch.float64),
        joint_velocity=torch.zeros(batch, 0, dtype=torch.float64),
    )
    return ContactProblem(**{f.name: getattr(problem, f.name).to(dtype) for f in dataclasses.fields(problem)})


@pytest.mark.parametrize("law", LAWS)
def test_solutions_satisfy_newton_signorini_and_coulomb(law: FrictionLaw) -> None:
    problem = random_problem(200)
    solution = solve_contacts(problem, law)
    assert bool(solution.converged.all())
    u = torch.einsum("bckn,bn->bck", problem.jacobian, solution.velocity)
    normal, tangent = solution.impulse[..., 0], solution.impulse[..., 1:]
    pull = torch.einsum("bckn,bck->bn", problem.jacobian, solution.impulse)
    force = (problem.mass @ solution.velocity[..., None])[..., 0] - problem.momentum - pull
    assert force.abs().max() < 1e-10
    gap = u[..., 0] + problem.offset
    assert gap.min() > -1e-4  # the solver's own compliance of 1e-6 times impulses of up to 100
    assert normal.min() > 0
    assert (gap * normal).abs().max() < 1e-4 * normal.max()
    bound = problem.friction * normal
    assert (tangent.norm(dim=-1) - bound).max() < COMPLEMENTARITY
    sliding = u[..., 1:].norm(dim=-1) > 1e-2
    if isinstance(law, Cone):
        along = (tangent * u[..., 1:]).sum(-1) / u[..., 1:].norm(dim=-1).clamp_min(1e-9)
        assert (along + bound)[sliding].abs().max() < 1e-5
    else:
        assert (tangent * u[..., 1:]).sum(-1).max() < COMPLEMENTARITY


@pytest.mark.parametrize("law", LAWS)
def test_a_batch_is_solved_as_its_members_alone(law: FrictionLaw) -> None:
    problem = random_problem(5)
    together = solve_contacts(problem, law)
    for k in range(5):
        alone = solve_contacts(problem.select(torch.arange(5) == k), law)
        torch.testing.assert_close(together.velocity[k : k + 1], alone.velocity, rtol=0, atol=1e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("field", ["mass", "momentum", "jacobian", "offset", "friction", "compliance"])
def test_the_gradient_at_the_solution_is_that_of_central_differences(law: FrictionLaw, field: str) -> None:
    problem, step = random_problem(32), 1e-6
    generator = torch.Generator().manual_seed(1)
    value = getattr(problem, field)
    direction = torch.randn(value.shape, generator=generator, dtype=torch.float64)
    to_v = torch.randn(problem.momentum.shape, generator=generator, dtype=torch.float64)
    to_impulse = 0.1 * torch.randn((*problem.offset.shape, 3), generator=generator, dtype=torch.float64)

    leaf = value.clone().requires_grad_()
    v, impulse = attach_gradient(
        *(lambda p: (p, solve_contacts(p, law)))(dataclasses.replace(problem, **{field: leaf}))
    )
    (gradient,) = torch.autograd.grad((v * to_v).sum() + (impulse * to_impulse).sum(), leaf)
    slope = (gradient * direction).flatten(1).sum(1)

    def shifted(sign: int) -> Tensor:
        moved = solve_contacts(dataclasses.replace(problem, **{field: value + sign * step * direction}), law)
        return (moved.velocity * to_v).sum(1) + (moved.impulse * to_impulse).sum((1, 2))

    difference = (shifted(1) - shifted(-1)) / (2 * step)
    error = (slope - difference).abs() / difference.abs().clamp_min(0.1)
    assert error.median() < 1e-6
    assert error.quantile(0.9) < 1e-3  # the rest lies within one difference of a change of contact mode


def test_the_untransposed_system_would_give_another_gradient() -> None:
    problem = random_problem(32)
    solution = solve_contacts(problem)
    matrix = problem.mass + torch.einsum("bckn,bckl,bclm->bnm", problem.jacobian, solution.response, problem.jacobian)
    asymmetry = (matrix - matrix.mT).flatten(1).norm(dim=1) / matrix.flatten(1).norm(dim=1)
    assert float(asymmetry.max()) > 0.01


@pytest.mark.slow
def test_joint_rows_hold_and_their_gradient_is_right() -> None:
    problem = random_problem(4)
    rows = torch.zeros(4, 2, 6, dtype=torch.float64)
    rows[:, 0, 0] = rows[:, 1, 3] = 1.0

    def velocity(rows: Tensor, wanted: Tensor) -> Tensor:
        joined = dataclasses.replace(problem, joint_jacobian=rows, joint_velocity=wanted)
        return attach_gradient(joined, solve_contacts(joined))[0]

    wanted = torch.full((4, 2), 0.3, dtype=torch.float64)
    torch.testing.assert_close(velocity(rows, wanted)[:, [0, 3]], wanted, rtol=0, atol=1e-10)
    assert torch.autograd.gradcheck(
        velocity, (rows.requires_grad_(), wanted.requires_grad_()), eps=1e-6, atol=1e-5, rtol=1e-3
    )


def test_single_precision_solves_to_its_own_smoothing() -> None:
    exact = solve_contacts(random_problem(50))
    rough = solve_contacts(random_problem(50, dtype=torch.float32))
    assert bool(rough.converged.all())
    assert (rough.velocity - exact.velocity).abs().median() < 1e-3


def test_an_unsolved_problem_is_reported_and_not_hidden() -> None:
    solution = solve_contacts(random_problem(8), settings=SolverSettings(max_steps=2, compliance=(1e-6,)))
    assert not bool(solution.converged.any())
    assert float(solution.residual.min()) > 1


@pytest.mark.parametrize("directions", [2, 5])
def test_a_pyramid_of_too_few_or_odd_directions_is_refused(directions: int) -> None:
    with pytest.raises(ValueError, match=f"even number of at least 4, got {directions}"):
        Pyramid(directions)
