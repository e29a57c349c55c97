"""The compiled contact solver, formula by formula: what Newton's method solves, and where it ends."""

from __future__ import annotations

import pytest
import torch
from tests.physics.compiled_step import WORLDS, Compiled, Solving, placed, uniform
from tests.physics.formulas import evaluate
from tests.physics.test_compiled_contacts import assert_close, formulated
from torch import Tensor

from physid.compiler.graph import Value
from physid.physics.contact_problem.cones import arrow, jordan, longest_step
from physid.physics.contact_problem.friction import SLACK_COMPLIANCE, Cone
from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.fused.formulas.contact_problem import cone

LINEAR = Cone.linear
COMPLIANCE = SolverSettings().compliance[0]
PROBLEMS = pytest.mark.parametrize(
    ("name", "bodies"), [("speculative", 1), ("speculative", 2), ("midpoint", 1), ("midpoint", 2)]
)


def inside(batch: int, seed: int) -> Tensor:
    """Draw unknowns or slacks inside the cones, (B, 5)."""
    numbers, tangent = uniform(batch, 3, low=0.1, high=2, seed=seed), uniform(batch, 2, low=-1, high=1, seed=seed + 1)
    tangent = tangent * (0.6 * numbers[:, 2:])
    return torch.cat([numbers, tangent], 1)


def contact(x: list[Value]) -> cone.Contact:
    return cone.Contact(x[:5], x[5:10], x[10], x[11])


Z, W = inside(30, 1), inside(30, 3)
W[:, 2] = Z[:, 1]  # of every contact: the slack of the bound is the slip
W[:, 3:] *= 0.5 * (W[:, 2:3] / W[:, 3:].norm(dim=1, keepdim=True)).clamp_max(1)
FRICTION, GIVE = uniform(30, 1, low=0.1, high=1, seed=5), uniform(30, 1, low=0, high=0.1, seed=6)
STATE = torch.cat([Z, W, FRICTION, GIVE], 1)


def law() -> tuple[Tensor, Tensor, Tensor]:
    """Return G, H and P of contacts with friction and compliance."""
    g, h, p = Cone().matrices(Z)
    h = h.expand(len(Z), 5, 5).clone()
    h[:, 0, 0], h[:, 1, 0] = GIVE[:, 0], FRICTION[:, 0]
    return g, h, p


def times(matrix: Tensor, vector: Tensor) -> Tensor:
    return (matrix @ vector[..., None])[..., 0]


def test_errors_and_products_of_a_contact_are_those_of_its_law() -> None:
    u, offset = uniform(30, 3, low=-1, high=1, seed=7), uniform(30, 1, low=-1, high=1, seed=8)
    g, h, _ = law()
    expected = W - (u @ g.T + times(h, Z)) - torch.nn.functional.pad(offset, (0, 4))
    found = evaluate(lambda x: contact(x).slack_error(x[12:15], x[15]), torch.cat([STATE, u, offset], 1))
    assert_close(found, expected)
    assert_close(evaluate(lambda x: [v for part in contact(x).products() for v in part], STATE), jordan(Z, W, LINEAR))


def test_a_direction_solves_the_linearised_equations_of_a_contact() -> None:
    slack, du = uniform(30, 5, low=-1, high=1, seed=9), uniform(30, 3, low=-1, high=1, seed=10)
    target = uniform(30, 1, high=0.5, seed=11)
    slack[:, 2] = 0  # the slip is its own slack

    def formula(x: list[Value]) -> list[Value]:
        return [v for part in contact(x).direction(x[12:17], x[20], x[17:20]) for v in part]

    dz, dw = evaluate(formula, torch.cat([STATE, slack, du, target], 1)).split(5, 1)
    g, h, _ = law()
    assert_close(slack + dw - du @ g.T - times(h, dz), torch.zeros_like(dz))
    wanted = target * torch.tensor([1.0, 1, 1, 0, 0], dtype=torch.float64)
    assert_close(jordan(Z, W, LINEAR) + jordan(dz, W, LINEAR) + jordan(Z, dw, LINEAR), wanted.expand_as(dz))


def test_the_response_of_a_contact_is_the_slope_of_its_impulse() -> None:
    g, h, p = law()
    gain = torch.linalg.solve(arrow(Z, LINEAR) @ h + arrow(W, LINEAR), arrow(Z, LINEAR))
    by_friction = -(p @ gain[:, :, 1, None])[..., 0] * Z[:, :1]

    def formula(x: list[Value]) -> list[Value]:
        response, slope = contact(x).response()
        return [*(value for row in response for value in row), *slope]

    assert_close(evaluate(formula, STATE), torch.cat([(p @ gain @ g).flatten(1), by_friction], 1))


def test_a_contact_starts_as_in_the_reference() -> None:
    u, offset = uniform(60, 3, low=-3, high=3, seed=12), uniform(60, 1, low=-3, high=3, seed=13)
    friction = uniform(60, 1, seed=14)
    found = evaluate(
        lambda x: [v for part in cone.begin(x[:3], x[3], x[4]) for v in part], torch.cat([u, offset, friction], 1)
    )
    assert_close(found, torch.cat(Cone().start(u[:, None], offset, friction), -1)[:, 0])


@pytest.mark.parametrize("speed", [0.02, 1.0, 300.0])
def test_friction_of_a_sliding_contact_is_solved_by_itself(speed: float) -> None:
    tau = 1e-8
    heading = torch.linspace(0, 6, 30, dtype=torch.float64)
    tangent = speed * torch.stack([heading.cos(), heading.sin()], 1)

    def solved(x: list[Value]) -> list[Value]:
        z, w, _ = cone.slide(contact(x), x[12:15], x[0].like(tau))
        return [*z, *w]

    u = torch.cat([torch.zeros(30, 1, dtype=torch.float64), tangent], 1)
    z, w = evaluate(solved, torch.cat([STATE, u], 1)).split(5, 1)
    bound = FRICTION[:, 0] * Z[:, 0] - z[:, 2] + SLACK_COMPLIANCE * z[:, 1]
    assert_close(w[:, 1], bound, 1e-15)
    assert_close(w[:, 2], z[:, 1], 0.0)
    assert_close(w[:, 3:], tangent, 0.0)
    products = jordan(z, w, LINEAR)
    tolerance = 1e-15 * max(1.0, speed**2)
    assert_close(products[:, 1:], tau * torch.tensor([1.0, 1, 0, 0], dtype=torch.float64).expand(30, 4), tolerance)
    assert_close(z[:, 0], Z[:, 0], 0.0)
    assert_close(w[:, 0], W[:, 0], 0.0)
    assert bool((z[:, 2] >= z[:, 3:].norm(dim=1)).all())


def solving(name: str, bodies: int) -> tuple[Solving, object]:
    state, inputs = placed(bodies, WORLDS[name], seed=40)
    return Solving(Compiled.of(state, inputs, WORLDS[name])), formulated(state, inputs, WORLDS[name])


@PROBLEMS
@pytest.mark.slow
def test_an_undamped_step_leaves_no_error_of_a_sum_and_the_product_of_changes_beyond_the_target(
    name: str, bodies: int
) -> None:
    found, _ = solving(name, bodies)
    found.iterate()
    found.factorise()
    found.direction("aim_at_end")
    dz, dw = found.of_contacts("dz"), found.of_contacts("dw")
    found.records.of["lane"]["length"] = torch.ones(len(dz), 1, dtype=torch.float64)
    found.records.of["lane"]["rung"] = torch.zeros(len(dz), 1, dtype=torch.float64)
    found.move()
    zero = torch.zeros(1, dtype=torch.float64)
    assert_close(found.of_contacts("r"), zero, 1e-10)
    for n in range(bodies):
        assert_close(found.records.of[f"motion{n}"]["force"], zero, 1e-9)
    for p in range(found.shape.patches):
        assert_close(found.records.of[f"contact{p}"]["mode_force"], zero, 1e-9)
    tau = SolverSettings().smoothing * torch.tensor([1.0, 1, 1, 0, 0], dtype=torch.float64)
    products = jordan(found.of_contacts("z"), found.of_contacts("w"), LINEAR)
    assert_close(products - tau, jordan(dz, dw, LINEAR), 1e-9)


@PROBLEMS
def test_the_errors_of_a_start_are_those_of_the_contact_problem(name: str, bodies: int) -> None:
    found, wanted = solving(name, bodies)
    problem = wanted.problem
    v, z = found.unknown, found.of_contacts("z")
    impulse = z[..., [0, 3, 4]]
    force = times(problem.mass, v) - problem.momentum - torch.einsum("bckn,bck->bn", problem.jacobian, impulse)
    forces = [found.records.of[f"motion{n}"]["force"] for n in range(bodies)]
    modes = [found.records.of[f"contact{p}"]["mode_force"][:, : len(own)] for p, own in found.shape.touching]
    assert_close(torch.cat([*forces, *modes], 1), force)
    assert_close(
        found.records.of["lane"]["gap"][:, 0],
        (z[..., :3] * found.of_contacts("w")[..., :3]).sum((1, 2))
        + (z[..., 3:] * found.of_contacts("w")[..., 3:]).sum((1, 2)),
    )


@PROBLEMS
@pytest.mark.slow
def test_a_step_goes_to_99_hundredths_of_where_it_would_leave_the_cones(name: str, bodies: int) -> None:
    found, _ = solving(name, bodies)
    found.factorise()
    found.direction("aim_at_end")
    found.records.of["lane"]["active"] = torch.ones(len(found.unknown), 1, dtype=torch.float64)
    before = found.records.of["lane"]["count"]
    found.call("decide_length", "lane")
    values = [torch.cat([found.of_contacts(a), found.of_contacts(b)], 1) for a, b in (("z", "w"), ("dz", "dw"))]
    longest = longest_step(*values, LINEAR)
    assert_close(found.records.of["lane"]["length"][:, 0], (0.99 * longest.clamp_max(2)).clamp_max(1))
    assert_close(found.records.of["lane"]["count"], before + 1, 0.0)
