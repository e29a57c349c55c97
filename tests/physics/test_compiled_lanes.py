"""What each world of a group does next in the compiled solver: who is done, who starts again, where it aims."""

from __future__ import annotations

import math

import pytest
import torch
from tests.physics.formulas import Fields, constants, run
from torch import Tensor

from physid.physics import World
from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.contact_problem.rounding import allowance
from physid.physics.fused.formulas import lane
from physid.physics.fused.formulas.contact_problem import lift, newton
from physid.physics.fused.formulas.layouts import BODY, CONSTANTS, CONTACT, LANE, OUTCOME, PATCH
from physid.physics.schemes.integration import Midpoint

SETTINGS = SolverSettings(max_steps=10, compliance=(1e-6, 1e-3, 1e-1))
NUMBERS = constants(World(), settings=SETTINGS)
ACCEPTED, TAU = SETTINGS.residual(torch.float64), SETTINGS.smoothing


def column(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)[:, None]


def changed(formula, numbers: Fields = NUMBERS, **fields: Tensor) -> Fields:  # noqa: ANN001
    """Return a lane after a formula of it and of the constants."""
    return run(formula, {"lane": LANE, "constants": CONSTANTS}, {"lane": fields, "constants": numbers})["lane"]


def checked(**numbers: float) -> dict[str, float]:
    """Return what is decided about a world that is at work, but for what is given."""
    usual = {"rung": 0.0, "count": 3.0, "worst": 1.0, "allowed": 1.0, "length": 1.0, "lost": 0.0, "solved": 0.0}
    after = changed(lane.check, **{name: column(value) for name, value in (usual | numbers).items()})
    return {name: float(value) for name, value in after.items()}


def test_a_world_begins_with_the_first_compliance_or_from_what_it_knows() -> None:
    after = changed(lane.begin, known=column(0.0, 0.3), speed=column(7.0, 7.0), lost=column(1.0, 1.0))
    assert after["rung"].flatten().tolist() == [0.0, -1.0]
    assert after["restart"].flatten().tolist() == [1.0, 0.0]
    for name, value in (("compliance", 1e-6), ("length", 1.0), ("known", float(NUMBERS["unit"]))):
        assert after[name].flatten().tolist() == [value] * 2
    for name in ("count", "lost", "solved", "speed", "distance"):
        assert after[name].flatten().tolist() == [0.0] * 2


@pytest.mark.parametrize("rung", [0.0, 1.0, -1.0])
def test_a_world_goes_on_until_it_is_solved_and_polished(rung: float) -> None:
    for worst, solved, active in (
        (ACCEPTED * 1.01, 0.0, 1.0),
        (ACCEPTED, 0.0, 1.0),  # solved: one more
        (ACCEPTED, 1.0, 0.0),  # which it has had
        (ACCEPTED * 1.01, 1.0, 1.0),
        (ACCEPTED / 100, 0.0, 0.0),  # needs none
        (ACCEPTED / 99, 0.0, 1.0),
        (math.nan, 0.0, 1.0),
    ):
        after = checked(worst=worst, solved=solved, rung=rung)
        assert after["active"] == active
        assert after["predicts"] == active * (rung >= 0)
        assert after["solved"] == float(worst <= ACCEPTED)
        assert (after["restart"], after["rung"], after["count"]) == (0.0, rung, 3.0)


def test_an_error_is_judged_by_what_rounding_allows() -> None:
    assert checked(worst=ACCEPTED * 2, allowed=0.5, solved=1.0)["active"] == 0.0
    assert checked(worst=ACCEPTED * 2, allowed=0.5)["worst"] == ACCEPTED
    assert checked(worst=ACCEPTED * 2, allowed=0.6, solved=1.0)["active"] == 1.0


@pytest.mark.parametrize(
    ("given", "restarts"),
    [
        ({"rung": 0.0, "count": 9.0}, False),
        ({"rung": 0.0, "count": 10.0}, True),  # as many steps as it may take
        ({"rung": 0.0, "count": 10.0, "worst": ACCEPTED}, False),
        ({"rung": -1.0, "count": 7.0}, False),
        ({"rung": -1.0, "count": 8.0}, True),  # a warm start may take eight
        ({"rung": -1.0, "lost": 1.0}, True),
        ({"rung": -1.0, "length": 0.049}, True),
        ({"rung": -1.0, "length": 0.05}, False),
        ({"rung": -1.0, "length": 0.0, "count": 0.0}, False),  # has not taken one
        ({"rung": -1.0, "length": 0.0, "count": 1.0}, True),
        ({"rung": 0.0, "lost": 1.0, "length": 0.01}, False),  # what misleads a warm start only
    ],
)
def test_a_world_that_is_stuck_starts_again_with_the_next_compliance(given: dict[str, float], restarts: bool) -> None:
    after, rung = checked(**given), given["rung"]
    assert after["restart"] == float(restarts)
    assert after["rung"] == rung + restarts
    assert after["count"] == (0.0 if restarts else given.get("count", 3.0))
    assert after["active"] == 1.0
    assert after["predicts"] == float(after["rung"] >= 0)
    ladder = [1e-6, 1e-6, 1e-3, 1e-1]  # the first once more, after the warm start with it
    assert after["compliance"] == ladder[int(after["rung"]) + 1]


def test_the_last_compliance_is_the_last_try() -> None:
    last = float(len(SETTINGS.compliance) - 1)
    assert checked(rung=last - 1, count=10.0)["rung"] == last
    after = checked(rung=last, count=10.0)
    assert (after["active"], after["restart"], after["rung"], after["compliance"]) == (0.0, 0.0, last, 1e-1)
    assert after["predicts"] == 0.0


def test_a_world_aims_at_the_end_or_centres_as_much_as_the_prediction_fell_short() -> None:
    numbers = NUMBERS | {"pairs": column(12.0)}
    end = changed(lane.aim_at_end, numbers)
    zero = changed(lane.aim_at_zero, numbers)
    assert (float(end["target"]), float(zero["target"])) == (TAU, 0.0)
    for each in (end, zero):
        assert [float(each[name]) for name in ("numerator", "denominator", "slope", "curve")] == [2.0, 1.0, 0.0, 0.0]
    gap = 24.0
    for numerator, slope, curve, predicted in (
        (0.5, -12.0, 0.0, 18.0),
        (0.5, -12.0, 8.0, 20.0),
        (3.0, -12.0, -8.0, 4.0),  # no step is longer than 1
        (1.0, -40.0, 0.0, 0.0),  # nor is anything less than nothing
        (1.0, 40.0, 0.0, 24.0),
        (1.0, -18.0, 0.0, 6.0),
    ):
        given = {"gap": gap, "numerator": numerator, "denominator": 1.0, "slope": slope, "curve": curve}
        fields = {name: column(value, value) for name, value in given.items()}
        after = changed(lane.aim, numbers, **fields, rung=column(0.0, -1.0))
        sigma = max((predicted / gap) ** 3, 0.1)
        assert after["target"].flatten().tolist() == pytest.approx([sigma * gap / 12, TAU])
    small = changed(lane.aim, numbers, gap=column(1e-9), numerator=column(1.0), denominator=column(1.0))
    assert float(small["target"]) == TAU


def test_only_worlds_at_work_move_and_count() -> None:
    given = {"numerator": column(1.0, 4.0, 4.0), "denominator": column(2.0, 2.0, 2.0), "count": column(1.0, 1.0, 1.0)}

    def formula(record, _) -> None:  # noqa: ANN001
        lane.decide_length(record)

    after = changed(formula, **given, active=column(1.0, 1.0, 0.0))
    assert after["length"].flatten().tolist() == pytest.approx([0.99 * 0.5, 1.0, 0.0])
    assert after["count"].flatten().tolist() == [2.0, 2.0, 1.0]


def test_the_largest_error_of_a_frame_is_kept_and_what_is_no_number_too() -> None:
    layouts = {"lane": LANE, "outcome": OUTCOME}
    for old, new, expected in ((1.0, 2.0, 2.0), (2.0, 1.0, 2.0), (1.0, math.nan, math.nan)):
        after = run(lane.report, layouts, {"lane": {"worst": column(new)}, "outcome": {"worst": column(old)}})
        assert float(after["outcome"]["worst"]) == pytest.approx(expected, nan_ok=True)


def test_rounding_allows_as_much_as_in_the_reference_for_a_box_as_fast_as_its_corners() -> None:
    """The compiled engine bounds the speed of a point by that of a corner; distances are those of the reference."""
    free = torch.tensor([[2e3, -1e3, 5e2, 3e4, -2e4, 1e4]], dtype=torch.float64)
    size = torch.tensor([[0.2, 0.3, 0.4]], dtype=torch.float64)
    layouts = {"body": BODY, "lane": LANE}
    gauged = run(lane.gauge, layouts, {"body": {"free": free, "size": size}, "lane": {"speed": column(5.0)}})["lane"]
    speed = 6e4 + 0.5 * 3.5e3 * 0.9
    assert float(gauged["speed"]) == pytest.approx(speed)
    faster = run(lane.gauge, layouts, {"body": {"free": free, "size": size}, "lane": {"speed": column(1e9)}})["lane"]
    assert float(faster["speed"]) == 1e9
    distance = 4e5
    after = changed(lane.allow, speed=column(speed), distance=column(distance))
    jacobian = torch.tensor([[[[1.0], [0], [0]]]], dtype=torch.float64)
    sums, products = allowance(jacobian, column(distance), column(speed), ACCEPTED)
    assert float(1 / after["allowed"]) == pytest.approx(float(sums))
    assert float(after["allowed_products"] * float(sums)) != pytest.approx(1.0)
    assert float(after["allowed"] * after["allowed_products"]) == pytest.approx(1 / float(products))


@pytest.mark.parametrize(("midpoint", "expected"), [(False, 9.81 * 1e-4), (True, 9.81 * 1e-3)])
def test_the_unit_of_velocities_is_that_of_the_step_but_not_of_fine_ones_under_midpoint(
    midpoint: bool, expected: float
) -> None:
    integration = {"integration": Midpoint()} if midpoint else {}
    world = World(time_step=1e-4, **integration)
    after = run(
        lambda numbers: lane.set_unit(numbers, midpoint=midpoint),
        {"constants": CONSTANTS},
        {"constants": constants(world)},
    )["constants"]
    assert float(after["unit"]) == pytest.approx(expected) == pytest.approx(world.velocity_unit)


def test_a_known_solution_is_sorted_to_the_contacts_that_it_belongs_to() -> None:
    z, w = (torch.arange(20, dtype=torch.float64)[None] + shift for shift in (100, 200))
    exists = torch.tensor([[1.0, 1.0, 0.0, 1.0]], dtype=torch.float64)
    before = torch.tensor([[1003.0, 1001.0, 2.0, 1009.0]], dtype=torch.float64)  # a label, and 1000 if there is one
    now = torch.tensor([[1.0, 3.0, 2.0, 5.0]], dtype=torch.float64)
    layouts = {"patch": PATCH, "contact": CONTACT, "lane": LANE}
    given = {
        "patch": {"label": now, "exists": exists, "offset": torch.tensor([[1.0, -7.0, 2.0, 3.0]], dtype=torch.float64)},
        "contact": {"z": z, "w": w, "label": before, "slides": torch.ones(1, 4, dtype=torch.float64)},
        "lane": {"distance": column(4.0)},
    }
    after = run(newton.recall, layouts, given)
    contact = after["contact"]
    assert contact["fresh"].tolist() == [[0.0, 0.0, 0.0, 1.0]]
    assert contact["label"].tolist() == [[1001.0, 1003.0, 2.0, 1005.0]]
    assert contact["slides"].tolist() == [[0.0] * 4]
    assert float(after["lane"]["distance"]) == 7.0
    for field, old in (("z", z), ("w", w)):
        parts, known = contact[field].unflatten(1, (4, 5))[0], old.unflatten(1, (4, 5))[0]
        assert torch.equal(parts[:3], known[[1, 0, 2]])


def test_a_contact_that_begins_or_ends_is_a_new_one() -> None:
    layouts = {"patch": PATCH, "contact": CONTACT, "lane": LANE}
    for was, is_, fresh in ((1.0, 1.0, 0.0), (0.0, 1.0, 1.0), (1.0, 0.0, 1.0), (0.0, 0.0, 0.0)):
        four = torch.arange(4, dtype=torch.float64)[None]
        given = {
            "patch": {"label": four, "exists": four * 0 + is_},
            "contact": {"label": four + 1000 * was},
            "lane": {},
        }
        assert run(newton.recall, layouts, given)["contact"]["fresh"].tolist() == [[fresh] * 4]


def test_where_the_unit_of_velocities_changes_velocities_are_kept_and_impulses_in_proportion() -> None:
    z = torch.arange(1, 21, dtype=torch.float64)[None]
    layouts = {"contact": CONTACT, "lane": LANE, "constants": CONSTANTS}
    for known in (0.0, 3 * float(NUMBERS["unit"])):
        given = {"contact": {"z": z, "w": z, "modes": z[:, :2]}, "lane": {"known": column(known)}, "constants": NUMBERS}
        contact, ratio = run(newton.rescale, layouts, given)["contact"], 3.0 if known else 1.0
        slips = torch.tensor([1.0, ratio, 1, 1, 1], dtype=torch.float64).repeat(4)  # z = (load, slip, bound, friction)
        slacks = torch.tensor([ratio, 1.0, ratio, ratio, ratio], dtype=torch.float64).repeat(4)
        torch.testing.assert_close(contact["z"], z * slips)
        torch.testing.assert_close(contact["w"], z * slacks)
        torch.testing.assert_close(contact["modes"], z[:, :2] * ratio)
        bodies = {"body": BODY, "lane": LANE, "constants": CONSTANTS}
        given = {"body": {"v": z[:, :6]}, "lane": {"known": column(known)}, "constants": NUMBERS}
        torch.testing.assert_close(run(newton.rescale_body, bodies, given)["body"]["v"], z[:, :6] * ratio)


def test_overlaps_are_removed_where_there_is_a_contact_and_nothing_is_known_elsewhere() -> None:
    layouts = {"patch": PATCH, "lane": LANE}
    exists = torch.tensor([[0.0, 0, 0, 0], [0, 0, 0, 1], [1, 0, 0, 0]], dtype=torch.float64)
    after = run(lift.measure, layouts, {"patch": {"exists": exists}, "lane": {"touches": column(0.0, 0.0, 0.0)}})
    assert after["lane"]["touches"].flatten().tolist() == [0.0, 1.0, 1.0]
    kept = run(lift.measure, layouts, {"patch": {"exists": exists[:1]}, "lane": {"touches": column(1.0)}})
    assert float(kept["lane"]["touches"]) == 1.0
    v = torch.arange(1, 7, dtype=torch.float64).expand(2, 6)
    lanes = {"lane": LANE, "lifted": BODY, "body": BODY}
    given = {"lane": {"touches": column(0.0, 1.0)}, "lifted": {"v": v}, "body": {"shift": v}}
    assert torch.equal(run(lift.settle, lanes, given)["body"]["shift"], v * column(0.0, 1.0))
    given = {"lane": {"touches": column(0.0, 1.0)}, "lifted_bar": {"v": v}, "body_bar": {"shift": v}}
    lanes = {"lane": LANE, "lifted_bar": BODY, "body_bar": BODY}
    assert torch.equal(run(lift.settle_adjoint, lanes, given)["lifted_bar"]["v"], v * column(0.0, 1.0))
