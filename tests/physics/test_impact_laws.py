"""What contacts demand under `Midpoint`, what impacts add to a step, and how friction turns, against closed forms."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from physics.worlds import state
from physid.physics.contact import FLATNESS, Patch
from physid.physics.schemes.impact import (
    BRIEF,
    FAINT,
    LARGEST,
    LOADS,
    PUSH,
    SLIDING,
    SLOWEST,
    Impact,
    bending,
    damping_time,
    demand,
    late,
    stuck,
)  # fmt: skip
from physid.physics.schemes.turning import SPINNING, STEADY, Turning, friction_before_impact, turning
from physid.physics.schemes.units import STANDARD_GRAVITY

DTYPE = torch.float64
H = 1 / 60
FALL = STANDARD_GRAVITY * H


def one(value: float) -> Tensor:
    return torch.tensor([value], dtype=DTYPE)


def face(gap: float | list[float], *, scale: float = 0.2, rolling: bool = False, first: int | None = None) -> Patch:
    corners = torch.tensor([[[-0.1, -0.1, 0], [0.1, -0.1, 0], [0.1, 0.1, 0], [-0.1, 0.1, 0]]], dtype=DTYPE)
    frame = torch.eye(3, dtype=DTYPE)[[2, 0, 1]][None]
    gaps = torch.tensor([gap if isinstance(gap, list) else [gap] * 4], dtype=DTYPE)
    return Patch(first, 0, corners, gaps, frame, torch.ones(1, 4, dtype=torch.bool), one(scale), None, rolling)


def wanted(gap: float | list[float], before: float, after: float, e: float = 0.0, give: float = 0.0, time: float = 0.0,
           bend: float = 0.0) -> Impact:  # fmt: skip
    """Return what a face demands whose corners have one velocity before the step and one after it without contact."""
    velocity = torch.zeros(1, 4, 3, dtype=DTYPE)
    velocity[..., 0] = before
    bends = torch.zeros(1, 4, 3, dtype=DTYPE)
    bends[..., 0] = bend
    free_ = torch.full((1, 4), after, dtype=DTYPE)
    there = torch.ones(1, 4, dtype=torch.bool)
    return demand(
        face(gap), (velocity, free_), bends, (one(e), one(give), one(time)), one(H)[:, None], there, ~there[:, 0]
    )


@pytest.mark.parametrize("a", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("e", [0.0, 0.3, 1.0])
def test_an_impact_falls_where_the_parabola_reaches_the_ground_and_leaves_with_its_share_of_the_speed(
    a: float, e: float
) -> None:
    """Fall g from a height that is reached at the fraction a of the step, seen from the gap at its middle."""
    before, after = -2.0, -2.0 - FALL
    speed = -before + a * FALL
    begin = (-before * a + FALL * a**2 / 2) * H
    found = wanted(begin + H * before / 2, before, after, e)
    leaving = e * speed - (1 - a) * FALL
    assert bool(found.hit)
    if leaving > 0:
        assert float(found.share) == pytest.approx(1 - a)
        torch.testing.assert_close(found.offset, torch.full((1, 4), -leaving, dtype=DTYPE))
    else:
        end = begin + H * (before + after) / 2
        assert float(found.share) == pytest.approx(end / (H * after))
        torch.testing.assert_close(found.offset, torch.zeros(1, 4, dtype=DTYPE), rtol=0, atol=1e-12)


def test_an_approach_as_slow_as_that_of_a_body_at_rest_is_no_impact() -> None:
    for factor, impact in ((1.01, True), (1.0, False), (0.99, False)):
        assert bool(wanted(-1e-2, -SLOWEST * FALL * factor, -5 * FALL).hit) is impact
    assert float(wanted(-1e-4, 0.0, -FALL).share) == 0.5
    assert not bool(wanted(1.0, -9.0, -9.0).hit), "what is not reached is not hit"


def test_without_an_impact_a_gap_closes_once_and_may_close_faster_where_it_is_not_reached() -> None:
    gap = 1e-3
    torch.testing.assert_close(wanted(gap, 0.0, -FALL / 10).offset, torch.full((1, 4), 2 * gap / H, dtype=DTYPE))
    near = FALL * H / 64  # from rest, a fall to it ends at 0.18 g h
    found = wanted(near, 0.0, -FALL)
    assert not bool(found.hit)
    torch.testing.assert_close(found.offset, torch.full((1, 4), near / H, dtype=DTYPE))
    resting = wanted(0.0, 0.0, -FALL)
    assert not bool(resting.hit)
    torch.testing.assert_close(resting.offset, torch.zeros(1, 4, dtype=DTYPE))


@pytest.mark.parametrize("time", [0.0, 0.01])
@pytest.mark.parametrize("give", [0.0, 1e-4])
def test_an_overlap_opens_in_its_time_but_no_faster_than_a_push_beyond_what_the_load_presses_in(
    give: float, time: float
) -> None:
    small, large = -1e-6, -0.5
    found = wanted(small, 0.0, -FALL, give=give, time=time).offset
    torch.testing.assert_close(found, torch.full((1, 4), small / (H + time), dtype=DTYPE))
    found = wanted(large, 0.0, -FALL, give=give, time=time).offset
    most = PUSH * FALL + LOADS * give / (H + time)
    torch.testing.assert_close(found, torch.full((1, 4), -most, dtype=DTYPE))


def test_a_compliant_contact_in_overlap_is_a_spring_and_never_hit() -> None:
    assert bool(wanted(-1e-4, -2.0, -2.0, give=0.0).hit)
    assert not bool(wanted(-1e-2, -0.1, -0.2, give=1e-4).hit)
    assert bool(wanted(1e-4, -2.0, -2.0, 0.4, give=1e-4).hit), "what bounces off it does where it is reached"
    assert not bool(wanted(-1.0, -2.0, -2.0, 0.4, give=1e-4).hit), "and in overlap nothing does"
    assert not bool(wanted(1e-4, -2.0, -2.0, 0.0, give=1e-4).hit), "the spring takes up all other blows"


def test_a_point_on_a_curve_is_judged_by_gap_and_speeds_at_the_ends_of_the_step() -> None:
    bend = 30.0
    straight = wanted(-0.01 - H**2 * bend / 8, -1.0 - H * bend / 2, -1.5 + H * bend / 2, 0.4)
    curved = wanted(-0.01, -1.0, -1.5, 0.4, bend=bend)
    assert torch.equal(straight.share, curved.share)
    torch.testing.assert_close(curved.offset, straight.offset + H * bend / 2)


def test_a_face_that_lands_at_once_stops_as_one_and_one_that_lands_on_a_corner_does_not() -> None:
    def weight(ends: list[float]) -> float:
        return float(wanted([end + H for end in ends], -2.0, -2.0).together)

    scale = FLATNESS * 0.2
    assert weight([-scale] * 4) == pytest.approx(1 - math.exp(-1))
    assert weight([-3 * scale, -scale, -2 * scale, -3 * scale]) == pytest.approx(1 - math.exp(-1))
    assert weight([-scale, -scale, -scale, scale]) == 0.0


def test_a_damper_takes_the_root_of_compliance_and_mass_and_none_without_compliance() -> None:
    assert float(damping_time(one(0.0), one(3.0))) == 0.0
    assert float(damping_time(one(4e-2), one(1.0))) == pytest.approx(0.2, abs=2 * BRIEF)
    assert float(damping_time(one(3 * BRIEF**2), one(1.0))) == pytest.approx(BRIEF)


def test_points_bend_towards_the_axis_of_the_spin_and_not_between_two_bodies_or_below_a_ball() -> None:
    patch, centre = face(0.0), torch.tensor([[[0.0, 0, 0.1]]], dtype=DTYPE)
    twist = torch.tensor([[[0, 0, 3.0, 1, 2, 3]]], dtype=DTYPE)
    found = bending(patch, centre, twist)
    torch.testing.assert_close(found[..., 0], torch.zeros(1, 4, dtype=DTYPE))
    torch.testing.assert_close(found[..., 1:], -9.0 * patch.point[..., :2])
    torch.testing.assert_close(stuck(found, one(H)[:, None]), -9.0 * H / 2 * patch.point[..., :2])
    rolled = bending(patch, centre, torch.tensor([[[0, 5.0, 0, 0, 0, 0]]], dtype=DTYPE))
    torch.testing.assert_close(rolled[..., 0], torch.full((1, 4), 25 * 0.1, dtype=DTYPE))
    for other in (face(0.0, rolling=True), face(0.0, first=0)):
        assert not bool(bending(other, centre, twist).any())


@pytest.mark.parametrize("struck", [False, True])
@pytest.mark.parametrize(("speed", "share"), [(0.5, 0.0), (1.0, 0.0), (1.25, 0.5625), (math.sqrt(2), 1.0), (5.0, 1.0)])
def test_friction_opposes_the_mean_slip_from_a_slip_on_that_goes_on_through_the_step_unless_another_body_strikes(
    speed: float, share: float, struck: bool
) -> None:
    share = 0.0 if struck else share
    velocity = torch.zeros(1, 4, 3, dtype=DTYPE)
    velocity[..., 1] = speed * SLIDING * FALL
    bends = torch.zeros(1, 4, 3, dtype=DTYPE)
    bends[..., 2] = 7.0
    there = torch.ones(1, 4, dtype=torch.bool)
    free_ = torch.full((1, 4), -FALL, dtype=DTYPE)
    found = demand(
        face(0.0), (velocity, free_), bends, (one(0.0),) * 3, one(H)[:, None], there, torch.tensor([struck])
    ).slip
    expected = torch.tensor([share * speed * SLIDING * FALL, (1 - share) * 7.0 * H / 2], dtype=DTYPE)
    torch.testing.assert_close(found, expected.expand(1, 4, 2))


def pressed(share: list[float], impulse: list[float], mass: Tensor | None = None) -> Tensor:
    """Return how far vertical impulses above and below move a body of mass 2, (6,)."""
    jacobian = torch.zeros(1, len(share), 3, 6, dtype=DTYPE)
    jacobian[..., 0, 5] = 1.0
    matrix = torch.diag(torch.tensor([1.0, 1, 1, 2, 2, 2], dtype=DTYPE))[None] if mass is None else mass
    push = torch.zeros(1, len(share), 3, dtype=DTYPE)
    push[..., 0] = torch.tensor(impulse, dtype=DTYPE)
    return late(matrix, jacobian, push, torch.tensor([share], dtype=DTYPE), 1)[0, 0]


def test_an_impact_moves_a_body_by_its_share_of_the_step_beyond_the_mean_velocity() -> None:
    for share in (0.0, 0.25, 0.5, 1.0, 2.0):
        assert float(pressed([share], [3.0])[5]) == pytest.approx((share - 0.5) * 3.0 / 2)
    assert float(pressed([1.0, 0.5], [3.0, -3.0])[5]) == pytest.approx(0.5 * 3.0 / 2 * 0.0, abs=1e-12)
    assert float(pressed([1.0, 0.5], [3.0, -1.0])[5]) == pytest.approx(0.5 * 3.0 / 2)


def test_impulses_that_balance_move_a_body_no_further_than_the_largest_share_times_its_change() -> None:
    change = (3.0 - 2.9) / 2
    far = float(pressed([2.0, 0.5], [3.0, -2.9])[5])
    assert far == pytest.approx((LARGEST - 0.5) * change)
    down = float(pressed([0.0, 2.0], [3.0, -2.9])[5])
    assert down == pytest.approx(-(LARGEST - 0.5) * change)
    edge = float(pressed([2.0, 2.0], [3.0, -2.9])[5])
    assert edge == pytest.approx((LARGEST - 0.5) * change)
    turning_ = torch.zeros(1, 6, 6, dtype=DTYPE) + torch.diag(torch.tensor([0.1, 0.2, 0.3, 2, 2, 2], dtype=DTYPE))
    assert float(pressed([2.0, 0.5], [3.0, -2.9], turning_)[5]) == pytest.approx((LARGEST - 0.5) * change)


def known(speed: float, spin: float = 0.0, lies: bool = True, mu: float = 0.3) -> Turning:
    """Return how friction turns under a face that slides at a speed and turns about its normal, in units of g h."""
    twist = torch.tensor([[[0, 0, spin * FALL / 0.2, speed * FALL, 0, 0]]], dtype=DTYPE)
    after = twist - torch.tensor([0, 0, 0, 0, 0, FALL], dtype=DTYPE)
    there = torch.full((1, 4), lies)
    return turning(face(0.0), twist, after, one(mu), one(H)[:, None], there)


def test_friction_turns_where_a_face_slides_slowly_without_spinning_and_nothing_else() -> None:
    for speed, weight in (
        (1.0, 1.0),
        (STEADY, 1.0),
        (STEADY * 1.25, 0.4375),
        (STEADY * math.sqrt(2), 0.0),
        (50.0, 0.0),
    ):
        assert float(known(speed).known) == pytest.approx(weight, abs=1e-12)
    for spin, weight in ((SPINNING, 1.0), (-1.25 * SPINNING, 0.4375), (SPINNING * math.sqrt(2), 0.0)):
        assert float(known(1.0, spin).known) == pytest.approx(weight, abs=1e-12)
    assert float(known(FAINT / 2).known) == 0.0
    assert float(known(1.0, lies=False).known) == 0.0
    assert float(known(1.0, mu=0.0).known) == 0.0
    assert float(known(1.0).turns) == 0.0, "along a line it keeps its direction"
    assert float(known(0.15).turns) == 1.0, "it stops in the step, so that less than all of it is needed"


def test_friction_does_not_turn_between_bodies_nor_below_a_ball() -> None:
    twist = state([[0, 0, 0.1]], [[FALL, 0, 0]]).twist
    there, h = torch.ones(1, 4, dtype=torch.bool), one(H)[:, None]
    for patch in (face(0.0, first=0), face(0.0, rolling=True)):
        found = turning(patch, twist, twist - 0.1, one(0.3), h, there)
        for value in (found.before, found.end, found.turns, found.known):
            assert not bool(value.any())


@pytest.mark.parametrize(
    ("slip", "push", "expected"),
    [
        ((0.7, 0.0), (0.0, 0.0), (-0.3, 0.0)),
        ((-0.7, 0.0), (0.3, 0.0), (0.3, 0.0)),
        ((-0.7, 0.0), (0.5, 0.0), (0.2, 0.0)),
        ((0.3, 0.4), (0.0, 0.0), (-0.18, -0.24)),
        ((0.0, 0.0), (0.2, 0.1), (-0.2, -0.1)),
        ((0.0, 0.0), (0.6, 0.8), (-0.18, -0.24)),
    ],
    ids=["slides", "is slowed", "is stopped", "slides askew", "rests", "sets off"],
)
def test_before_it_is_struck_a_body_rubs_as_its_slip_wants_and_one_that_rests_stays(
    slip: tuple[float, float], push: tuple[float, float], expected: tuple[float, float]
) -> None:
    """Of a friction that takes 0.3 m/s by the time of the impact, a quarter in each contact; `push` is a F."""
    before, fall = 0.5, 2.0
    twist = torch.zeros(1, 1, 6, dtype=DTYPE)
    free = torch.tensor([[[0, 0, 0, push[0] / before, push[1] / before, -fall]]], dtype=DTYPE)
    slips = torch.tensor(slip, dtype=DTYPE).expand(1, 4, 2)
    patch = face(0.0)
    rotated = torch.einsum("bki,i->bk", patch.frame[:, 1:], torch.tensor([*slip, 0.0], dtype=DTYPE))
    gives = friction_before_impact(
        patch, rotated[:, None].expand_as(slips), (twist, free), one(0.3 / (before * fall)), one(before)
    )
    found = (gives @ patch.frame[:, 1:]).sum(1)[0]
    torch.testing.assert_close(found, torch.tensor([*expected, 0.0], dtype=DTYPE), rtol=0, atol=1e-12)
    never = friction_before_impact(patch, slips, (twist, free), one(0.3), one(0.0))
    assert not bool(never.any()), "nothing strikes"


@pytest.mark.parametrize("slide", [0.0, 0.01, 0.1, 3.0])
@pytest.mark.parametrize("spin", [0.0, 0.1, 1.0, 30.0])
def test_what_rubs_before_an_impact_takes_energy_and_turns_no_spin_around(slide: float, spin: float) -> None:
    """Of a cube of 0.2 m and 1 kg that slides and spins, I = m s^2 / 6, with friction for 0.3 m/s."""
    arms = torch.tensor([[0.1, 0.1], [0.1, -0.1], [-0.1, -0.1], [-0.1, 0.1]], dtype=DTYPE)
    slips = torch.stack([slide - spin * arms[:, 1], spin * arms[:, 0]], -1)[None]
    twist = torch.tensor([[[0, 0, spin, 0, 0, 0]]], dtype=DTYPE)
    free = twist - torch.tensor([0, 0, 0, 0, 0, 2.0], dtype=DTYPE)
    gives = friction_before_impact(face(0.0), slips, (twist, free), one(0.3), one(0.5))[0]
    moment, inertia = (arms[:, 0] * gives[:, 1] - arms[:, 1] * gives[:, 0]).sum(), 0.04 / 6
    after, turned = torch.tensor([slide, 0.0], dtype=DTYPE) + gives.sum(0), spin + float(moment) / inertia
    before = slide**2 + inertia * spin**2
    assert float(after.square().sum()) + inertia * turned**2 <= before * (1 + 1e-12)
    assert turned >= -spin / 8 - 1e-12
    if spin == 0:
        assert float(after[0]) == pytest.approx(max(slide - 0.3, 0.0), abs=1e-12)
    if slide == 0 and spin == 1.0:
        assert turned == pytest.approx(0.0, abs=1e-12), "slow enough to stop"
