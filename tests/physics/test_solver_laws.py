"""Parts of the contact solver: cones against bisection, laws of friction, rounding, and what a batch is made of."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch
from tests.physics.test_lcp import random_problem
from torch import Tensor

from physid.physics.contact_problem.bordered import bordered_factor
from physid.physics.contact_problem.cones import arrow, cone_length, jordan, longest_step
from physid.physics.contact_problem.friction import SLACK_COMPLIANCE, Cone, FrictionLaw, Pyramid
from physid.physics.contact_problem.lcp import ContactProblem, SolverSettings, solve_contacts
from physid.physics.contact_problem.rounding import ROUNDING, allowance, largest_error

LAWS = pytest.mark.parametrize("law", [Cone(), Pyramid(4), Pyramid(6)], ids=["cone", "four", "six"])
DTYPE = torch.float64


def normal(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=DTYPE)


def inside(value: Tensor, linear: int) -> Tensor:
    """Return which vectors (..., m) lie in the product of half lines and cones."""
    fits = (value[..., :linear] >= 0).all(-1)
    if value.shape[-1] > linear:
        fits = fits & (value[..., linear] >= value[..., linear + 1 :].norm(dim=-1))
    return fits


def bisected(value: Tensor, change: Tensor, linear: int, far: float = 1e6) -> Tensor:
    """Return the largest step that keeps vectors (B, m) in the cones, `far` for any."""
    low, high = torch.zeros(len(value), dtype=DTYPE), torch.full((len(value),), far, dtype=DTYPE)
    for _ in range(120):
        middle = (low + high) / 2
        fits = inside(value + middle[:, None] * change, linear)
        low, high = torch.where(fits, middle, low), torch.where(fits, high, middle)
    return low


@pytest.mark.parametrize(("size", "linear"), [(5, 2), (6, 6), (3, 0)])
def test_the_longest_step_is_that_of_bisection(size: int, linear: int) -> None:
    value, change = normal(300, size).abs() + 0.1, normal(300, size, seed=1)
    if size > linear:
        value[:, linear + 1 :] *= 0.5 * value[:, linear, None] / value[:, linear + 1 :].norm(dim=1, keepdim=True)
    change[::7] = change[::7].abs() * torch.tensor([1.0] * linear + [9.0, 1, 1][: size - linear])
    change[::11] = 0.0
    found, expected = longest_step(value[:, None], change[:, None], linear), bisected(value, change, linear)
    assert bool(torch.equal(found.isinf(), expected > 9e5))
    ends = ~found.isinf()
    torch.testing.assert_close(found[ends], expected[ends], rtol=1e-9, atol=0)
    assert 20 < int(ends.sum()) < 290


def test_the_longest_step_of_several_contacts_is_the_shortest_of_theirs() -> None:
    value, change = normal(20, 4, 5).abs() + 2.0, normal(20, 4, 5, seed=1)
    value[..., 2] += value[..., 3:].norm(dim=-1)
    each = torch.stack([longest_step(value[:, k : k + 1], change[:, k : k + 1], 2) for k in range(4)])
    assert torch.equal(longest_step(value, change, 2), each.amin(0))
    nothing = torch.zeros(3, 0, 5, dtype=DTYPE)
    assert longest_step(nothing, nothing, 2).tolist() == [math.inf] * 3


def test_a_step_along_the_surface_of_the_cone_or_into_it_is_endless_and_out_of_it_has_an_end() -> None:
    x = torch.tensor([1.0, 0.6, 0.8], dtype=DTYPE)
    for change, expected in (
        ([1.0, 0.6, 0.8], math.inf),
        ([1.0, -0.6, -0.8], math.inf),
        ([2.0, 0.0, 1.0], math.inf),
        ([-1.0, 0.6, 0.8], 0.0),
        ([0.0, 0.6, 0.8], 0.0),
    ):
        assert float(cone_length(x, torch.tensor(change, dtype=DTYPE))) == pytest.approx(expected, abs=1e-12)
    within = torch.tensor([2.0, 0.6, 0.8], dtype=DTYPE)
    assert float(cone_length(within, -within)) == pytest.approx(1.0), "to the tip"


def test_jordan_products_have_an_identity_commute_and_are_numbers_for_half_lines() -> None:
    x, y = normal(3, 4, 5), normal(3, 4, 5, seed=1)
    one = torch.tensor([1.0, 1, 1, 0, 0], dtype=DTYPE)
    torch.testing.assert_close(jordan(x, one.expand_as(x), 2), x)
    torch.testing.assert_close(jordan(x, y, 2), jordan(y, x, 2))
    torch.testing.assert_close(jordan(x, y, 2)[..., 2], (x * y)[..., 2:].sum(-1))
    assert torch.equal(jordan(x, y, 5), x * y)
    assert torch.equal(arrow(x, 2), arrow(x, 2).mT)


@LAWS
def test_a_law_pairs_impulses_with_the_velocities_that_they_act_on(law: FrictionLaw) -> None:
    """Power is z.w but for bounds: P^T is G, and what H adds is skew but for a tiny viscosity."""
    g, h, p = law.matrices(torch.zeros(1, dtype=DTYPE))
    assert g.shape == (law.size, 3)
    impulse_rows = [0, *range(law.size - (2 if isinstance(law, Cone) else law.directions), law.size)]  # type: ignore[attr-defined]
    for row in impulse_rows:
        assert torch.equal(g[row], p[:, row])
    assert float(h[1, 1]) == SLACK_COMPLIANCE
    rest = h.clone()
    rest[1, 1] = 0
    assert torch.equal(rest, -rest.mT)
    assert rest.abs().sum(1)[0] == 0, "the bound by the load, mu, comes with the problem"
    assert float(rest[1].sum()) == -(1.0 if isinstance(law, Cone) else law.directions)  # type: ignore[attr-defined]


@pytest.mark.parametrize("directions", [4, 6, 8])
def test_the_directions_of_a_pyramid_are_unit_vectors_evenly_around_and_begin_along_the_first_tangent(
    directions: int,
) -> None:
    around = Pyramid(directions).matrices(torch.zeros(1, dtype=DTYPE))[0][2:, 1:]
    torch.testing.assert_close(around.norm(dim=1), torch.ones(directions, dtype=DTYPE))
    turned = (around * around.roll(-1, 0)).sum(1)
    torch.testing.assert_close(turned, torch.full_like(turned, math.cos(2 * math.pi / directions)))
    assert around[0].tolist() == [1.0, 0.0]
    assert float(around[1, 1]) > 0


@LAWS
def test_a_start_is_strictly_inside_with_the_free_slip_and_friction_half_as_large_as_it_may_be(
    law: FrictionLaw,
) -> None:
    velocity, offset = 3 * normal(7, 4, 3), normal(7, 4, seed=1)
    velocity[0, 0, 1:] = 0.0
    friction = normal(7, 4, seed=2).abs()
    friction[1] = 0.0
    z, w = law.start(velocity, offset, friction)
    assert z.shape == w.shape == (7, 4, law.size)
    assert bool(inside(z - 1e-12, law.linear).all() & inside(w - 1e-12, law.linear).all())
    separation, slip = velocity[..., 0] + offset, velocity[..., 1:].norm(dim=-1)
    assert bool((z[..., 0] > (-separation).clamp_min(0)).all() & (w[..., 0] > separation.abs()).all())
    bound, size = w[..., 1], z[..., 1]
    assert bool((size > slip).all())
    torch.testing.assert_close(bound - 0.5 * friction * z[..., 0], torch.full_like(bound, 0.1))
    if isinstance(law, Cone):
        assert torch.equal(z[..., 2], bound)
        torch.testing.assert_close(z[..., 3:] * size[..., None], -bound[..., None] * velocity[..., 1:])
        assert torch.equal(w[..., 3:], velocity[..., 1:])
        torch.testing.assert_close(jordan(z, w, law.linear)[..., 3:], torch.zeros(7, 4, 2, dtype=DTYPE))
    else:
        g, h, _ = law.matrices(z)
        rows = velocity @ g.T + z @ h.T
        torch.testing.assert_close(w[..., 2:], rows[..., 2:])
        products = (z * w)[..., 2:]
        even = (bound * size / law.directions)[..., None]  # type: ignore[attr-defined]
        torch.testing.assert_close(products, even.expand_as(products))


def test_rounding_allows_sums_as_large_as_speeds_and_distances_and_products_as_speeds_squared() -> None:
    accepted, eps = 1e-11, torch.finfo(DTYPE).eps
    jacobian = torch.zeros(2, 2, 3, 4, dtype=DTYPE)
    jacobian[0, 0, 0], jacobian[0, 1, 2] = torch.tensor([1.0, -2, 0, 0]), torch.tensor([0, 0, -3.0, 0])
    free = torch.tensor([[100.0, -50.0, 40.0, 1e9], [1.0, 1, 1, 1]], dtype=DTYPE)
    offset = torch.tensor([[-700.0, 5.0], [0.0, 0.0]], dtype=DTYPE)
    sums, products = allowance(jacobian, offset, free, accepted)
    share = ROUNDING * eps / accepted
    assert sums.tolist() == pytest.approx([1 + share * (200 + 700), 1.0])
    assert products.shape == (2, 1, 1)
    assert products.flatten().tolist() == pytest.approx([1 + share * 200**2, 1.0])
    slow = allowance(jacobian, 1e9 * offset, free, accepted)
    assert slow[1].flatten().tolist() == pytest.approx(slow[0].tolist()), "products are sums too"
    none = allowance(jacobian[:, :0], offset[:, :0], free, accepted)
    assert none[0].tolist() == [1.0, 1.0]


def test_the_largest_error_is_that_of_sums_or_of_products_each_less_by_what_is_allowed() -> None:
    sums = [torch.tensor([[1.0, -6.0], [0.0, 0.5]]), torch.tensor([[[2.0]], [[-0.25]]])]
    product = torch.tensor([[[3.0, -4.0]], [[-9.0, 1.0]]])
    allowed = torch.tensor([2.0, 1.0]), torch.tensor([[[1.0]], [[3.0]]])
    assert largest_error(sums, product, allowed).tolist() == [4.0, 3.0]
    assert largest_error(sums, product / 10, allowed).tolist() == pytest.approx([3.0, 0.5])
    assert largest_error([], product, allowed).tolist() == [4.0, 3.0]


@pytest.mark.parametrize("rows", [0, 1, 2])
def test_a_bordered_system_gives_velocities_that_obey_its_rows(rows: int) -> None:
    matrix, border = normal(3, 4, 4) + 4 * torch.eye(4, dtype=DTYPE), normal(3, rows, 4, seed=1)
    force, wanted = normal(3, 4, seed=2), normal(3, rows, seed=3)
    right = torch.cat([force, wanted], 1)[..., None]
    v, joint = torch.linalg.lu_solve(*bordered_factor(matrix, border), right)[..., 0].split([4, rows], 1)
    torch.testing.assert_close((border @ v[..., None])[..., 0], wanted)
    torch.testing.assert_close((matrix @ v[..., None])[..., 0] - (border.mT @ joint[..., None])[..., 0], force)


@pytest.mark.parametrize(("dtype", "tau", "residual"), [(torch.float64, 1e-8, 1e-11), (torch.float32, 1e-4, 1e-4)])
def test_single_precision_is_solved_no_finer_than_it_resolves(dtype: torch.dtype, tau: float, residual: float) -> None:
    settings = SolverSettings()
    assert settings.tau(dtype) == tau
    assert settings.residual(dtype) == pytest.approx(residual)
    assert SolverSettings(smoothing=1e-2).tau(dtype) == 1e-2
    assert SolverSettings(smoothing=1e-2, tolerance=0.5).residual(torch.float64) == pytest.approx(5e-3)


def twice(problem: ContactProblem) -> ContactProblem:
    """Return two copies of the bodies of each world, side by side in one."""

    def diagonal(value: Tensor) -> Tensor:
        return torch.cat([torch.cat([value, 0 * value], -1), torch.cat([0 * value, value], -1)], 1)

    wide = ("mass", "jacobian", "joint_jacobian")
    fields = {each.name: getattr(problem, each.name) for each in dataclasses.fields(problem)}
    return ContactProblem(**{k: diagonal(v) if k in wide else torch.cat([v, v], 1) for k, v in fields.items()})


@LAWS
def test_two_copies_of_a_problem_in_one_world_are_solved_as_one_in_as_many_steps(law: FrictionLaw) -> None:
    problem = random_problem(60)
    one, two = solve_contacts(problem, law), solve_contacts(twice(problem), law)
    assert torch.equal(one.steps, two.steps)
    torch.testing.assert_close(two.velocity, torch.cat([one.velocity] * 2, 1), rtol=0, atol=1e-9)
    torch.testing.assert_close(two.impulse, torch.cat([one.impulse] * 2, 1), rtol=0, atol=1e-8)


@LAWS
def test_without_contacts_bodies_keep_their_momentum_and_joints_hold(law: FrictionLaw) -> None:
    problem = random_problem(3)
    names = ("jacobian", "offset", "slip", "friction", "compliance")
    free = dataclasses.replace(problem, **{name: getattr(problem, name)[:, :0] for name in names})
    solution = solve_contacts(free, law)
    torch.testing.assert_close(solution.velocity, torch.linalg.solve(problem.mass, problem.momentum))
    assert bool(solution.converged.all())
    assert solution.steps.tolist() == [0, 0, 0]
    rows = torch.eye(6, dtype=DTYPE)[:2].expand(3, 2, 6)
    held = dataclasses.replace(free, joint_jacobian=rows, joint_velocity=torch.full((3, 2), 0.5, dtype=DTYPE))
    solution = solve_contacts(held, law)
    assert bool(solution.converged.all())
    torch.testing.assert_close(solution.velocity[:, :2], torch.full((3, 2), 0.5, dtype=DTYPE))
    torch.testing.assert_close(solution.joint_impulse, 0.1 * (0.5 - 10 * problem.momentum[:, :2]))


def test_a_solver_gives_up_after_as_many_steps_as_it_may_take() -> None:
    for most in (1, 2, 5):
        settings = SolverSettings(max_steps=most, compliance=(1e-6,))
        solution = solve_contacts(random_problem(8), settings=settings)
        assert solution.steps.tolist() == [most] * 8
        assert not bool(solution.converged.any())


def test_worlds_that_are_solved_again_leave_the_others_alone() -> None:
    problem = random_problem(6)
    solution = solve_contacts(problem)
    some = torch.tensor([False, True, False, False, True, False])
    other = solve_contacts(dataclasses.replace(problem, momentum=2 * problem.momentum).select(some))
    merged = solution.merge(some, other)
    for field in dataclasses.fields(solution):
        before, now = getattr(solution, field.name), getattr(merged, field.name)
        assert torch.equal(now[~some], before[~some])
        assert torch.equal(now[some], getattr(other, field.name))
