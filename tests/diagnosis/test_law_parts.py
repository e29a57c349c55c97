"""Of what residual laws are made: directions and variables of a motion that is known, regions, knots, and fits."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from diagnosis.flown import QUICK, examined, hypothesis, random
from estimation.flights import MASS, NOISE, flights
from physid.diagnosis.residual_law import find_residual_laws
from physid.diagnosis.residual_law.laws import Law, _combined, knots_of, over_pieces
from physid.diagnosis.residual_law.motion import Direction, Variable, directions_of, variables_of
from physid.diagnosis.residual_law.regression import Regression
from physid.diagnosis.settings.testing import ResidualLawSettings
from physid.diagnosis.testing import find_lack_of_fit
from physid.estimation.prediction import Prediction, Timeline
from physid.physics.rotations import exponential

STILL = 0.01
TIMES: Any = {"force": 0.25, "torque": 0.25, "shift": 0.1}


def moved() -> tuple[Any, Timeline]:
    """Return one body that moves along y, is pushed along -x and turns about z; in the last frame it is at rest."""
    pose, twist = torch.zeros(1, 1, 4, 1, 7).double(), torch.zeros(1, 1, 4, 1, 6).double()
    pose[..., :3] = torch.tensor([0.1, 0.2, 0.3]).double()
    pose[..., 3:] = exponential(torch.tensor([0.0, 0.0, math.pi / 6]).double())
    twist[0, 0, :3, 0, 4], twist[0, 0, :3, 0, 2], twist[0, 0, 3, 0, 4] = 2.0, -3.0, 0.5 * STILL
    wrench = torch.zeros(1, 4, 1, 6).double()
    wrench[0, :2, 0, 3] = -5.0
    made = Prediction(pose, pose, twist, torch.zeros(1, 1, 4, 1).double())
    timeline = Timeline.regular(wrench, 0.5)
    return made, Timeline(timeline.time + 7.0, timeline.grid)


@pytest.mark.parametrize("planar", [True, False])
def test_directions_are_unit_vectors_of_the_ground_the_velocity_the_command_and_the_spin(planar: bool) -> None:
    found = {(one.kind, one.name): one for one in directions_of(*moved(), torch.eye(3).double(), planar, STILL)}
    x, y, z = torch.eye(3).double()
    none = torch.zeros(3).double()
    expected = {
        ("force", "along x"): [x] * 4,
        ("force", "along the velocity"): [y, y, y, none],
        ("force", "across the velocity"): [-x, -x, -x, none],
        ("force", "along the command"): [-x, -x, none, none],
        ("force", "across the command"): [-y, -y, none, none],
        ("torque", "about the vertical"): [z] * 4,
        ("torque", "along the spin"): [-z, -z, -z, none],
        ("shift", "along y"): [y] * 4,
    }
    for (kind, name), values in expected.items():
        one = found[kind, name]
        part = one.value[0, :, 0, :3] if kind == "torque" else one.value[0, :, 0, 3:]
        other = one.value[0, :, 0, 3:] if kind == "torque" else one.value[0, :, 0, :3]
        assert torch.allclose(part, torch.stack(values)), name
        assert not other.any()
        assert one.commanded is ("command" in name)
        assert one.rubs is (planar and name in ("along the velocity", "along the spin"))
    assert (("force", "along z") in found, ("shift", "along z") in found) == (not planar, not planar)


@pytest.mark.parametrize("planar", [True, False])
def test_variables_have_their_values_in_the_axes_of_the_ground_and_where_they_are_defined(planar: bool) -> None:
    frame = torch.tensor([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]).double()
    found = {one.name: one for one in variables_of(*moved(), frame, planar, STILL)}
    expected = {
        "x": ([0.2] * 4, "m"),
        "y": ([-0.1] * 4, "m"),
        "speed": ([2.0] * 3 + [0.5 * STILL], "m/s"),
        "course": ([0.0] * 4, "deg"),
        "course seen from the body": ([60.0] * 4, "deg"),
        "commanded force": ([5.0, 5.0, 0.0, 0.0], "N"),
        "spin": ([3.0] * 3 + [0.0], "rad/s"),
        "time": ([0.0, 0.5, 1.0, 1.5], "s"),
    } | ({} if planar else {"height": ([0.3] * 4, "m")})
    assert found.keys() == expected.keys()
    for name, (values, unit) in expected.items():
        one = found[name]
        assert one.value[0, :, 0].tolist() == pytest.approx(values, abs=1e-6), name
        assert one.unit == unit
        assert one.defined[0, :, 0].tolist() == ([True] * 3 + [False] if "course" in name else [True] * 4)
        assert one.commanded is (name == "commanded force")
        assert one.swings is (name == "time")


@pytest.mark.parametrize(
    ("velocity", "moves"), [((0.0, 0.0, -2.0), False), ((STILL, 0.0, 0.0), False), ((2 * STILL, 0.0, 0.0), True)]
)
def test_a_body_that_falls_straight_or_hardly_moves_has_no_course(velocity: tuple[float, ...], moves: bool) -> None:
    made, timeline = moved()
    made.twist[..., 3:] = torch.tensor(velocity).double()
    found = {one.name: one for one in variables_of(made, timeline, torch.eye(3).double(), False, STILL)}
    for name in ("course", "course seen from the body"):
        assert bool(found[name].defined.any()) is moves
    assert found["speed"].value[0, :, 0].tolist() == pytest.approx([math.hypot(*velocity)] * 4)


def direction(kind: Any = "force", share: float = 1.0, **more: Any) -> Direction:
    value = torch.zeros(1, 100, 1, 6).double()
    value[0, : round(100 * share), 0, 3] = 1.0
    return Direction("along", kind, value, **more)


def variable(values: Tensor, defined: int = 100, **more: Any) -> Variable:
    there = torch.zeros(1, 100, 1, dtype=torch.bool)
    there[0, :defined] = True
    return Variable("it", "m", values.double().reshape(1, 100, 1), there, **more)


def combined(directions: list[Direction], variables: list[Variable], flying: int = 0, **changes: Any) -> list[Law]:
    fly = torch.zeros(1, 100, 1, dtype=torch.bool)
    fly[0, 100 - flying :] = True
    seen = torch.ones(1, 100, 1, dtype=torch.bool)
    return _combined(directions, variables, fly, seen, ResidualLawSettings(**changes), TIMES, 0.1)


def test_laws_hold_everywhere_or_in_contact_or_flight_where_both_are_frequent_enough() -> None:
    regions = ["everywhere", "in contact", "in flight"]
    for flying, some in ((11, regions), (10, regions[:1]), (89, regions), (90, regions[:1]), (0, regions[:1])):
        found = combined([direction()], [], flying)
        assert [law.region for law in found] == some
        assert [int(law.active.sum()) for law in found] == [100, 100 - flying, flying][: len(some)]
    assert [law.region for law in combined([direction("shift")], [], 50)] == ["everywhere"]
    assert len(combined([direction(share=0.11)], [])) == 1
    assert not combined([direction(share=0.1)], [])


def test_knots_lie_in_the_middles_of_equal_parts_of_the_frames_and_not_nearer_than_they_tell() -> None:
    ramp = torch.arange(100.0)
    (_, law) = combined([direction()], [variable(ramp)], knots=5)
    assert law.knots.tolist() == [10.0, 30.0, 50.0, 70.0, 90.0]
    assert torch.allclose(law.basis().sum(-1), torch.ones(1, 100, 1).double())
    skew = torch.where(ramp < 60, 0.001 * ramp, ramp)
    (_, bent) = combined([direction()], [variable(skew)], knots=5)
    assert bent.knots.tolist() == pytest.approx([0.01, 70.0, 90.0]), "three of them within a 25th of the span"
    assert len(combined([direction()], [variable(0 * ramp)])) == 1, "what does not change tells nothing"
    assert len(combined([direction()], [variable(ramp, 11)])) == 2
    assert len(combined([direction()], [variable(ramp, 10)])) == 1
    constant = combined([direction(share=0.5)], [])[0]
    assert constant.basis()[0, :, 0, 0].tolist() == [1.0] * 50 + [0.0] * 50


def test_functions_of_time_bend_at_equal_times_as_often_as_a_piece_of_force_lets_them() -> None:
    time = variable(0.01 * torch.arange(100), swings=True)
    for kind, count in (("force", 5), ("shift", 11)):
        (_, law) = combined([direction(kind)], [time])
        assert law.knots.tolist() == pytest.approx([0.99 * k / (count - 1) for k in range(count)])
    (_, few) = combined([direction("shift")], [time], most_knots=4)
    assert len(few.knots) == 4
    (_, short) = combined([direction()], [variable(1e-4 * torch.arange(100), swings=True)])
    assert len(short.knots) == 2


def test_a_site_follows_from_what_a_law_acts_along_and_depends_on() -> None:
    commanded, plain = variable(torch.arange(100.0), commanded=True), variable(torch.arange(100.0))
    for one, of, region, site in (
        (direction("shift"), plain, "everywhere", "perception"),
        (direction(commanded=True), plain, "in contact", "actuation"),
        (direction(), commanded, "everywhere", "actuation"),
        (direction(rubs=True), None, "everywhere", "contact"),
        (direction(), plain, "in contact", "contact"),
        (direction(), None, "in flight", "dynamics"),
    ):
        where: Any = region
        assert Law(one, of, where, torch.ones(1, 100, 1).bool(), torch.zeros(1)).site == site


def test_a_pattern_is_a_mean_over_each_piece_of_each_segment_in_the_axes_of_the_ground() -> None:
    one = direction()
    law = Law(
        one,
        variable(torch.arange(100.0)),
        "everywhere",
        torch.ones(1, 100, 1).bool(),
        torch.tensor([0.0, 99.0]).double(),
    )
    piece = torch.arange(100)[None] % 50 // 25
    owner = torch.where(torch.arange(100) < 50, 0, torch.where(torch.arange(100) < 75, 1, -1))[None]
    frame = torch.tensor([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]).double()
    mean = over_pieces(law, piece, 2, owner, 2, frame)
    assert mean.shape == (2, 2, 1, 6, 2)
    middle = [12.0 / 99, 37.0 / 99, 62.0 / 99]
    assert mean[0, 0, 0, 4].tolist() == pytest.approx([-(1 - middle[0]), -middle[0]])
    assert mean[0, 1, 0, 4].tolist() == pytest.approx([-(1 - middle[1]), -middle[1]])
    assert mean[1, 0, 0, 4].tolist() == pytest.approx([-(1 - middle[2]), -middle[2]])
    assert not mean[1, 1].any()
    assert not mean[..., [0, 1, 2, 3, 5], :].any()
    laws: list[Any] = [SimpleNamespace(knots=torch.zeros(count)) for count in (2, 1, 3)]
    assert [place for _, place in knots_of(laws)] == [slice(0, 2), slice(2, 3), slice(3, 6)]


@pytest.mark.slow
@pytest.mark.parametrize("size", [2.0, 0.0])
def test_a_wind_is_found_as_a_force_along_x_with_its_size_and_what_it_moves(size: float) -> None:
    """Places are moved by what initial states cannot take up of F t^2 / (2 m), in each segment."""
    made = flights(sizes=(size, 0.0), trajectories=6)
    nominal = hypothesis(made)
    fit = examined(made)
    lack = find_lack_of_fit(fit, nominal, random())
    found = find_residual_laws(fit, nominal, lack)
    if not size:
        assert found.described == ()
        assert found.gains == {}
        return
    law = found.described[0]
    assert (law.kind, law.direction, law.variable, law.region, law.unit) == (
        "force",
        "along x",
        None,
        "everywhere",
        "N",
    )
    assert law.low[0] < 2.0 < law.high[0]
    assert law.size[0] == pytest.approx((law.low[0] + law.high[0]) / 2)
    assert max(found.gains, key=lambda one: found.gains[one]) == "dynamics"
    assert law.gain == pytest.approx(max(found.gains.values()))
    assert 0.8 < law.explains <= 1
    time = torch.arange(12).double() / 60
    basis = torch.stack([torch.ones_like(time), time], 1)
    bent = law.size[0] / MASS * time.square() / 2
    left = bent - basis @ torch.linalg.lstsq(basis, bent[:, None]).solution[:, 0]
    assert law.moves == pytest.approx(float(left.square().mean().sqrt()), rel=0.03)
    force = direction()
    wide = Direction("along x", "force", force.value[:, :24].expand(6, 24, 1, 6))
    one = Law(wide, None, "everywhere", torch.ones(6, 24, 1).bool(), torch.zeros(1).double())
    regression = Regression(nominal, lack, [one])
    assert regression.frames == 144
    assert regression.expected == 12 * (72 - 12)
    fitted, nothing = regression.solve([one]), regression.solve([])
    assert float(fitted.sizes) == pytest.approx(law.size[0])
    assert nothing.score - fitted.score == pytest.approx(law.gain)
    assert nothing.loss - fitted.loss == pytest.approx(law.explains * (nothing.loss - regression.expected), rel=0.01)


def test_a_shift_of_the_picture_with_time_is_found_with_its_size() -> None:
    made = flights(sizes=(0.0, 0.0), trajectories=6, cuts=1)
    sway = 10 * NOISE[1] * torch.sin(2 * math.pi * torch.arange(24).double() / 16)
    pose = made.experiment.pose.clone()
    pose[..., 0, 1] += sway
    made = type(made)(made.experiment.replace(pose=pose), made.true, made.start)
    settings = QUICK.changed({"residual_law.time": 2 / 60})
    fit = examined(made, settings)
    nominal = hypothesis(made, (), settings)
    law = find_residual_laws(fit, nominal, find_lack_of_fit(fit, nominal, random())).described[0]
    assert (law.kind, law.direction, law.variable, law.unit) == ("shift", "along y", "time", "m")
    assert law.at == pytest.approx([k * (23 / 60) / (len(law.at) - 1) for k in range(len(law.at))])
    assert law.explains > 0.9
