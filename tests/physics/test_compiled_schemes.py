"""Impacts, turning friction and free motion: the compiled formulas against those of the reference, branch by branch."""

from __future__ import annotations

import itertools

import pytest
import torch
from tests.physics.compiled_step import uniform
from tests.physics.formulas import constants, evaluate, run
from torch import Tensor

from physid.compiler.graph import Value
from physid.compiler.section import Layout
from physid.physics import World
from physid.physics.contact import FLATNESS, Patch
from physid.physics.fused.formulas import algebra
from physid.physics.fused.formulas.layouts import CONSTANTS
from physid.physics.fused.formulas.schemes import impact as compiled_impact
from physid.physics.fused.formulas.schemes import midpoint as compiled_midpoint
from physid.physics.fused.formulas.schemes import turning as compiled_turning
from physid.physics.rotations import conjugate, exponential, normalize, rotate
from physid.physics.schemes import impact, turning
from physid.physics.schemes.integration import Midpoint
from physid.physics.schemes.motion import drift
from physid.physics.schemes.units import STANDARD_GRAVITY

EXACT = 1e-12
H = 1 / 60
FALL = STANDARD_GRAVITY * H
NUMBERS = constants(World(time_step=H, integration=Midpoint()))


def assert_close(found: Tensor, expected: Tensor, tolerance: float = EXACT) -> None:
    torch.testing.assert_close(found, expected, rtol=0, atol=tolerance * max(float(expected.abs().max()), 1.0))


def patch_of(gap: Tensor, scale: Tensor) -> Patch:
    batch = len(gap)
    frame = torch.eye(3, dtype=torch.float64)[[2, 0, 1]].expand(batch, 3, 3)
    point, active = torch.zeros(batch, 4, 3, dtype=torch.float64), torch.ones(batch, 4, dtype=torch.bool)
    return Patch(None, 0, point, gap, frame, active, scale)


def drawn(kind: str) -> dict[str, Tensor]:
    """Return contacts of many patches: random ones, or ones of few values that meet each limit of the rule exactly."""
    if kind == "random":
        batch = 4000
        fast = 10 ** uniform(batch, 1, low=-2, high=1.5, seed=1)
        speed = uniform(batch, 4, low=-1, high=0.6, seed=2) * fast * FALL
        change = uniform(batch, 4, low=-2, high=2, seed=3) * FALL
        gap = uniform(batch, 4, low=-0.6, high=1, seed=4) * (fast * FALL * H)
        same = (torch.arange(batch) % 3 == 0)[:, None]  # a face that lands flat
        speed, change, gap = (torch.where(same, each[:, :1], each) for each in (speed, change, gap))
        return {
            "gap": gap, "speed": speed, "free": speed + change,
            "slip": uniform(batch, 8, low=-4, high=4, seed=5) * FALL,
            "bend": uniform(batch, 12, low=-1, high=1, seed=6) * STANDARD_GRAVITY * (torch.arange(batch) % 2)[:, None],
            "exists": (uniform(batch, 4, seed=7) > 0.1).double(),
            "restitution": uniform(batch, 1, seed=8) * (torch.arange(batch) % 4 > 0)[:, None],
            "compliance": uniform(batch, 1, low=-1, high=1, seed=9).clamp_min(0),
            "time": uniform(batch, 1, high=H, seed=10), "scale": uniform(batch, 1, low=0.1, high=1, seed=11),
        }  # fmt: skip
    speeds = [-8.0, -0.5, -0.25, 0.0, 0.25]
    free = [-1.0, -0.25, 0.0, 0.5]
    gaps = [-2.0, -0.5, -0.125, 0.0, 0.125, 0.25, 4.0]
    rows = torch.tensor(list(itertools.product(gaps, speeds, free, [0.0, 0.5, 1.0], [0.0, 0.5])), dtype=torch.float64)
    of_patch = rows.repeat(2, 1)
    corners = of_patch[:, :3, None].repeat(1, 1, 4)
    for c in range(1, 4):  # a face that lands flat, and then faces whose corners are at different limits
        corners[len(rows) :, :, c] = rows[:, :3].roll(101 * c, 0)
    batch, one = len(of_patch), torch.ones(1, 4, dtype=torch.float64)
    gap, speed, after = corners.unbind(1)
    return {
        "gap": gap * (FALL * H), "speed": speed * FALL, "free": (speed + after) * FALL,
        "slip": 2 * FALL * one.repeat(batch, 2), "bend": torch.zeros(batch, 12, dtype=torch.float64),
        "exists": one.expand(batch, 4), "restitution": of_patch[:, 3:4], "compliance": of_patch[:, 4:],
        "time": of_patch[:, 4:] * H, "scale": torch.ones(batch, 1, dtype=torch.float64),
    }  # fmt: skip


@pytest.mark.parametrize("kind", ["random", "at each limit"])
def test_what_contacts_of_a_patch_demand_is_the_same_in_both_engines(kind: str) -> None:
    given = drawn(kind)
    batch, h = len(given["gap"]), torch.full((1, 1), H, dtype=torch.float64)
    slip, bend = given["slip"].unflatten(1, (4, 2)), given["bend"].unflatten(1, (4, 3))
    velocity = torch.cat([given["speed"][..., None], slip], -1)
    time, exists = given["time"], given["exists"] > 0.5
    correction = H / (H + time)
    give = given["compliance"] / correction * STANDARD_GRAVITY * H**2  # C g of the mean mass, from units of the solver
    wanted = impact.demand(
        patch_of(given["gap"], given["scale"][:, 0]), (velocity, given["free"]), bend,
        (given["restitution"][:, 0], give[:, 0], time[:, 0]), h, exists, torch.zeros(batch, dtype=torch.bool),
    )  # fmt: skip

    def formula(record, numbers, out) -> None:  # noqa: ANN001
        contacts = [
            compiled_impact.Contact(
                record["gap"][c], [record["speed"][c], *record["slip"][2 * c : 2 * c + 2]], record["free"][c],
                record["bend"][3 * c : 3 * c + 3], record["exists"][c] > 0.5,
            )
            for c in range(4)
        ]  # fmt: skip
        yielding = record.one("compliance"), record.one("correction")
        width = FLATNESS * record.one("scale")
        found = compiled_impact.demand(contacts, record.one("restitution"), yielding, numbers, width)
        out["offset"], (out["share"], out["hit"], out["together"]) = found[0], ([value] for value in found[1:])
        out["slip"] = [x for each in contacts for x in compiled_impact.slip(each, found[2], numbers)]

    fields = {name: value.expand(batch, -1) for name, value in given.items()} | {"correction": correction}
    layouts = {
        "record": Layout(**{name: value.shape[1] for name, value in fields.items()}), "numbers": CONSTANTS,
        "out": Layout(offset=4, share=1, hit=1, together=1, slip=8),
    }  # fmt: skip
    out = run(formula, layouts, {"record": fields, "numbers": NUMBERS})["out"]
    assert torch.equal(out["hit"][:, 0] > 0.5, wanted.hit)
    assert 0.1 < float(wanted.hit.double().mean()) < 0.9
    assert_close(out["share"][:, 0], wanted.share)
    assert_close(out["together"][:, 0], wanted.together)
    assert_close(out["offset"], wanted.offset)
    assert_close(out["slip"], wanted.slip.flatten(1))


@pytest.mark.parametrize("scale", [1e-16, 1e-3, 1.0, 30.0])
def test_friction_that_turns_ends_at_the_same_slip_in_both_engines(scale: float) -> None:
    slip, change = scale * uniform(500, 2, low=-1, high=1, seed=1), uniform(500, 2, low=-1, high=1, seed=2)
    slip[::5], change[1::5], slip[2::5, 1], change[2::5, 1] = 0.0, 0.0, 0.0, 0.0
    most = uniform(500, 1, high=2, seed=3) * (torch.arange(500) % 7 > 0)[:, None]
    found = evaluate(lambda x: compiled_turning.slip_after(x[:2], x[2:4], x[4]), torch.cat([slip, change, most], 1))
    assert_close(found, turning.slip_after(slip, change, most[:, 0]))


def test_friction_turns_within_the_step_alike_in_both_engines() -> None:
    batch = 3000
    size = 10 ** uniform(batch, 1, low=-4, high=1.2, seed=1)
    before = torch.cat(
        [0.1 * uniform(batch, 1, low=-1, high=1, seed=2), size * uniform(batch, 2, low=-1, high=1, seed=3)], 1
    )
    after = before + uniform(batch, 3, low=-2, high=2, seed=4)
    spin, friction = uniform(batch, 1, low=-3, high=3, seed=5), uniform(batch, 1, seed=6)
    before, after = before * FALL, after * FALL
    lies = (uniform(batch, 4, seed=7) > 0.05).all(1, keepdim=True).double()
    hit = (uniform(batch, 1, seed=8) > 0.8).double()
    usual, stuck = uniform(batch, 8, low=-1, high=1, seed=9), uniform(batch, 8, low=-1, high=1, seed=10)
    scale = torch.full((batch,), 0.5, dtype=torch.float64)
    frame = torch.eye(3, dtype=torch.float64)[[2, 0, 1]]
    twists = [torch.cat([torch.zeros(batch, 2), 2 * spin * FALL, v @ frame], 1)[:, None] for v in (before, after)]
    h = torch.full((1, 1), H, dtype=torch.float64)
    patch = patch_of(torch.zeros(batch, 4, dtype=torch.float64), scale)
    wanted = turning.turning(patch, *twists, friction[:, 0], h, lies.expand(-1, 4) > 0.5)
    total = turning.turned(usual.unflatten(1, (4, 2)), stuck.unflatten(1, (4, 2)), wanted, hit[:, 0] > 0.5)

    def formula(record, numbers, out) -> None:  # noqa: ANN001
        velocities = record["before"], record["after"]
        lies = record.one("lies") > 0.5
        found = compiled_turning.turning(velocities, record.one("spin"), record.one("friction"), lies, numbers)
        out["end"], out["turns"], out["known"] = found.end, [found.turns], [found.known]
        parts = zip(algebra.rows(record["usual"], 2), algebra.rows(record["stuck"], 2), strict=True)
        out["total"] = [x for u, s in parts for x in compiled_turning.turned(u, s, found, record.one("hit"))]

    fields = {
        "before": before, "after": after, "spin": spin * FALL, "friction": friction, "lies": lies, "hit": hit,
        "usual": usual, "stuck": stuck,
    }  # fmt: skip
    layouts = {
        "record": Layout(**{name: value.shape[1] for name, value in fields.items()}), "numbers": CONSTANTS,
        "out": Layout(end=2, turns=1, known=1, total=8),
    }  # fmt: skip
    out = run(formula, layouts, {"record": fields, "numbers": NUMBERS})["out"]
    assert_close(out["end"], wanted.end)
    assert_close(out["turns"][:, 0], wanted.turns)
    assert_close(out["known"][:, 0], wanted.known)
    assert_close(out["total"], total.flatten(1))
    for weight in (wanted.turns, wanted.known):
        assert bool((weight == 0).any() & (weight == 1).any() & ((weight > 0) & (weight < 1)).any())


@pytest.mark.parametrize("gyroscopic", [True, False])
@pytest.mark.parametrize("speed", [0.0, 1.0, 20.0, 400.0])
def test_free_bodies_turn_alike_in_both_engines_however_fast(speed: float, gyroscopic: bool) -> None:
    batch = 60
    quaternion = normalize(uniform(batch, 4, low=-1, high=1, seed=1))
    spin, moments = speed * uniform(batch, 3, low=-1, high=1, seed=2), uniform(batch, 3, low=0.5, high=1.2, seed=3)
    time = torch.full((1,), H / 2, dtype=torch.float64)

    def formula(x: list[Value]) -> list[Value]:
        turns = x[0].like(float(gyroscopic))
        found = compiled_midpoint.drift(x[:4], x[4:7], x[7:10], x[0].like(H / 2), turns)
        return [value for part in found for value in part]

    found = evaluate(formula, torch.cat([quaternion, spin, moments], 1))
    place, twist = torch.zeros(batch, 1, 3, dtype=torch.float64), torch.nn.functional.pad(spin, (0, 3))[:, None]
    _, turned, after = drift(place, quaternion[:, None], twist, moments[:, None], time, gyroscopic=gyroscopic)
    assert_close(found, torch.cat([turned[:, 0], after[:, 0, :3]], 1), 1e-11)


@pytest.mark.parametrize("size", [1, 2, 3])
def test_small_matrices_are_inverted(size: int) -> None:
    matrices = uniform(40, size, size, low=-1, high=1) + 2 * torch.eye(size, dtype=torch.float64)
    found = evaluate(
        lambda x: [value for row in algebra.invert(algebra.rows(x, size)) for value in row], matrices.flatten(1)
    )
    assert_close(found, torch.linalg.inv(matrices).flatten(1))


def test_vectors_and_rotations_are_those_of_torch() -> None:
    q, (a, b) = normalize(uniform(40, 4, low=-1, high=1)), uniform(2, 40, 3, low=-1, high=1, seed=1)

    def formula(x: list[Value]) -> list[Value]:
        q, a, b = x[:4], x[4:7], x[7:]
        parts = (
            algebra.rotate(q, a), algebra.conjugate(q), algebra.cross(a, b), [algebra.dot(a, b)], algebra.unit(a),
            algebra.add(a, b), algebra.subtract(a, b), algebra.scale(3.0, a),
            algebra.apply(algebra.to_matrix(q), a), algebra.apply(algebra.transpose(algebra.to_matrix(q)), a),
        )  # fmt: skip
        return [value for part in parts for value in part]

    parts = (
        rotate(q, a), conjugate(q), torch.linalg.cross(a, b), (a * b).sum(1, keepdim=True),
        a / a.norm(dim=1, keepdim=True), a + b, a - b, 3 * a, rotate(q, a), rotate(conjugate(q), a),
    )  # fmt: skip
    assert_close(evaluate(formula, torch.cat([q, a, b], 1)), torch.cat(parts, 1))


@pytest.mark.parametrize("doublings", [0, 2, 4, algebra.DOUBLINGS])
def test_a_rotation_is_exact_up_to_a_turn_of_two_to_the_number_of_doublings(doublings: int) -> None:
    turn = torch.nn.functional.normalize(uniform(40, 3, low=-1, high=1), dim=1) * 2.0**doublings
    found = evaluate(lambda x: algebra.exponential(x, doublings), turn)
    assert_close(found, exponential(turn), 1e-13)


def test_the_decay_falls_to_rounding_and_stays_there() -> None:
    x = torch.tensor([0.0, 1e-9, 0.5, 7.0, 30.0, 63.0, 64.0, 65.0, 1e6], dtype=torch.float64)[:, None]
    found = evaluate(lambda value: [algebra.decay(value[0])], x)
    torch.testing.assert_close(found, torch.exp(-x.clamp_max(64)), rtol=1e-13, atol=0)
