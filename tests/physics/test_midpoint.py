"""The scheme of second order: exact between events, impacts where they fall, nothing that hovers, jitters or gains."""

from __future__ import annotations

import itertools
import math

import pytest
import torch
from torch import Tensor

from physics.worlds import boxes, forces, state
from physid.effects.contact.contact_compliance import ContactCompliance
from physid.effects.dynamics.tether import Tether
from physid.physics import Parameters, PhysicsLayer, Plane, Rollout, State, World
from physid.physics.contact import Split
from physid.physics.rotations import exponential, rotate, to_matrix
from physid.physics.schemes.integration import Midpoint, SemiImplicit
from physid.physics.schemes.turning import slip_after

G = 9.81
BACKENDS = [pytest.param("reference", marks=pytest.mark.slow), "fused"]
SMOOTHING = 1e-6  # what the smoothing of contacts leaves over a second [m]
FLAT = torch.tensor([[[0.3, 0.2, 0.05]]], dtype=torch.float64)
ONE = torch.ones(1, 1, dtype=torch.float64)


def world(rate: float, **more) -> World:  # noqa: ANN003
    return World(time_step=1 / rate, integration=Midpoint(), **more)


def roll(world: World, start: State, steps: int, parameters: Parameters, backend: str = "fused") -> Rollout:
    push = forces(steps, [[0.0, 0, 0]]).expand(start.pose.shape[0], -1, -1, -1)
    return PhysicsLayer(world, backend=backend).rollout(start, push, parameters)  # type: ignore[arg-type]


def energy(rollout: Rollout, parameters: Parameters, gravity: float = G) -> Tensor:
    """Return kinetic and potential energy of one body, shape (B, T + 1)."""
    spin = rotate_back(rollout.pose[:, :, 0], rollout.twist[:, :, 0, :3])
    turning = (parameters.inertia[:, None, 0] * spin.square()).sum(-1)
    mass = parameters.mass[:, None, 0]
    moving = mass * rollout.twist[:, :, 0, 3:].square().sum(-1)
    return (turning + moving) / 2 + mass * gravity * rollout.pose[:, :, 0, 2]


def rotate_back(pose: Tensor, vector: Tensor) -> Tensor:
    return (to_matrix(pose[..., 3:]).mT @ vector[..., None])[..., 0]


def lowest(pose: Tensor, size: Tensor) -> Tensor:
    """Return the height of the lowest corner of boxes, poses (..., 7)."""
    return pose[..., 2] - (to_matrix(pose[..., 3:])[..., 2, :].abs() * size).sum(-1) / 2


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_flight_is_the_parabola_and_a_spin_about_an_axis_is_uniform(backend: str) -> None:
    start = state([[0, 0, 1.0]], [[1.0, -0.5, 3.0]], [[0, 0, 7.0]])
    rollout = roll(world(30, ground=None), start, 15, Parameters.of_boxes(FLAT, ONE, ONE), backend)
    t = torch.arange(16, dtype=torch.float64) / 30
    torch.testing.assert_close(rollout.pose[0, :, 0, 2], 1 + 3 * t - G * t**2 / 2, rtol=0, atol=1e-12)
    turn = torch.stack([0 * t, 0 * t, 7 * t], -1)
    torch.testing.assert_close(to_matrix(rollout.pose[0, :, 0, 3:]), to_matrix(exponential(turn)), rtol=0, atol=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("rate", [30, 240])
def test_sliding_under_a_force_is_exact_at_any_rate(rate: int, backend: str) -> None:
    steps = rate // 3
    push = forces(steps, [[1.0, 0, 0]])
    layer = PhysicsLayer(world(rate), backend=backend)  # type: ignore[arg-type]
    rollout = layer.rollout(state([[0, 0, 0.1]], [[2.0, 0, 0]]), push, boxes(mass=0.7, friction=0.3))
    t = torch.arange(steps + 1, dtype=torch.float64) / rate
    expected = 2 * t + (1 / 0.7 - 0.3 * G) * t**2 / 2
    torch.testing.assert_close(rollout.pose[0, :, 0, 0], expected, rtol=0, atol=SMOOTHING)
    assert float((rollout.pose[0, :, 0, 2] - 0.1).abs().max()) < 1e-8


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("phase", [0.05, pytest.param(0.5, marks=pytest.mark.slow), 0.95])
@pytest.mark.parametrize("turn", [pytest.param(0.0, marks=pytest.mark.slow), 0.4])
@pytest.mark.parametrize("beside", [None, 0.011])
def test_a_block_that_turns_around_within_a_step_goes_on_as_the_closed_form_says(
    phase: float, turn: float, beside: float | None, backend: str
) -> None:
    # A push of 5 m/s^2 against the motion and friction of 2 stop it at the given phase of a step; then 3 are left.
    rate, steps, push, friction = 30, 12, 5.0, 2.0
    start = (3 + phase) / rate * (push + friction)
    layer = PhysicsLayer(world(rate), backend=backend)  # type: ignore[arg-type]
    along = torch.tensor([math.cos(turn), math.sin(turn), 0.0], dtype=torch.float64)
    places, speeds, pushes = [[0.0, 0, 0.1]], [(start * along).tolist()], [(-push * along).tolist()]
    if beside is not None:  # another block rests so near to its side, and is not reached
        places, speeds, pushes = (
            [*places, [0, 0.2 + beside + 0.2 * turn, 0.1]],
            [*speeds, [0.0] * 3],
            [*pushes, [0.0] * 3],
        )
    count = len(places)
    begin, parameters = state(places, speeds), boxes(mass=[1.0] * count, friction=friction / G)
    rollout = layer.rollout(begin, forces(steps, pushes), parameters)
    left = (steps - 3 - phase) / rate
    torch.testing.assert_close(
        rollout.twist[0, -1, 0, 3:], -(push - friction) * left * along, rtol=0, atol=10 * SMOOTHING
    )
    # The mean of both velocities of a step is not the mean velocity, where it turns around: once, and h^2.
    exact = start**2 / (2 * (push + friction)) - (push - friction) * left**2 / 2
    assert float(rollout.pose[0, -1, 0, :3] @ along) == pytest.approx(exact, abs=G / (8 * rate**2))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("friction", [0.1, 0.5])
def test_on_an_incline_a_block_slides_as_the_closed_form_says_or_stays_where_it_is(
    friction: float, backend: str
) -> None:
    slope, steps = math.radians(15), 30 if backend == "reference" else 600
    normal = (math.sin(slope), 0.0, math.cos(slope))
    turn = exponential(torch.tensor([0, slope, 0], dtype=torch.float64))
    pose = torch.cat([0.1 * torch.tensor(normal, dtype=torch.float64), turn])[None, None]
    rollout = roll(world(60, ground=Plane(normal, 0.0)), State.at_rest(pose), steps, boxes(friction=friction), backend)
    way = (rollout.pose[0, :, 0, :3] - pose[0, 0, :3]).norm(dim=-1)
    t = torch.arange(steps + 1, dtype=torch.float64) / 60
    slides = max(math.sin(slope) - friction * math.cos(slope), 0.0)
    torch.testing.assert_close(way, G * slides * t**2 / 2, rtol=1e-5, atol=5 * SMOOTHING)


@pytest.mark.parametrize("restitution", [0.1, 0.3, 0.5, 0.7, 0.9])
@pytest.mark.parametrize("rate", [60, 148, 240, 1000])
def test_three_bounces_reach_the_height_of_the_closed_form(restitution: float, rate: int) -> None:
    # A flight that is shorter than a step cannot be seen: there frames are split until it is three steps long.
    speed = math.sqrt(2 * G * 0.5)
    flights = [2 * speed * restitution**k / G for k in (1, 2, 3)]
    substeps = max(1, math.ceil(3 / (rate * flights[-1])))
    landings = list(itertools.accumulate([speed / G, *flights]))
    steps = math.ceil(landings[-1] * rate) * substeps
    rollout = roll(world(rate * substeps), state([[0, 0, 0.6]]), steps, boxes(restitution=restitution))
    height, up = rollout.pose[0, :, 0, 2] - 0.1, rollout.twist[0, :, 0, 5]
    for k, (begin, end) in enumerate(itertools.pairwise(landings), 1):
        during = slice(math.ceil(begin * rate * substeps) + 1, math.floor(end * rate * substeps))
        apex = (height + up**2 / (2 * G))[during]
        assert len(apex) > 0
        torch.testing.assert_close(apex, torch.full_like(apex, 0.5 * restitution ** (2 * k)), rtol=0.01, atol=0)
    assert float(height.min()) > -1e-8


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("height", [0.05, 0.0511, 0.0527, 0.0542])
def test_an_inelastic_landing_ends_on_the_ground_at_once_without_rebound(height: float, backend: str) -> None:
    rollout = roll(world(60), state([[0.0, 0, 0.1 + height]], [[0.3, 0, 0]]), 9, boxes(friction=0.0), backend)
    gap, up = rollout.pose[0, :, 0, 2] - 0.1, rollout.twist[0, :, 0, 5]
    landed = math.ceil(math.sqrt(2 * height / G) * 60)
    t = torch.arange(landed, dtype=torch.float64) / 60
    torch.testing.assert_close(gap[:landed], height - G * t**2 / 2, rtol=0, atol=1e-8)
    torch.testing.assert_close(gap[landed:], torch.zeros_like(gap[landed:]), rtol=0, atol=1e-8)
    torch.testing.assert_close(up[landed:], torch.zeros_like(up[landed:]), rtol=0, atol=1e-6)


def test_friction_of_a_landing_acts_from_the_time_of_the_impact() -> None:
    # mu (1 + e) u_c less speed from the impact on; e = 1 keeps gravity out of it.
    for fraction in (0.1, 0.5, 0.9):
        rollout = roll(
            world(60, gravity=(0, 0, 0)), state([[0, 0, 0.1 + fraction / 60]], [[1.0, 0, -1]]), 1,
            boxes(friction=0.1, restitution=1.0).replace(inertia=1e6 * torch.ones(1, 1, 3, dtype=torch.float64)),
        )  # fmt: skip
        x, z = rollout.pose[0, 1, 0, 0], rollout.pose[0, 1, 0, 2]
        assert float(x) == pytest.approx((fraction + (1 - fraction) * (1 - 0.2)) / 60, abs=1e-7)
        assert float(z) == pytest.approx(0.1 + (1 - fraction) / 60, abs=1e-7)


@pytest.mark.parametrize("rate", [60, 240])
def test_a_box_at_rest_is_at_rest_after_ten_thousand_steps(rate: int) -> None:
    rollout = roll(world(rate), state([[0, 0, 0.1]]), 10_000, boxes())
    torch.testing.assert_close(rollout.pose[:, -1], rollout.pose[:, 0], rtol=0, atol=1e-8)
    assert float(rollout.twist.abs().max()) < 1e-6


def tossed(batch: int) -> State:
    generator = torch.Generator().manual_seed(3)
    turn = torch.nn.functional.normalize(torch.randn(batch, 1, 4, generator=generator, dtype=torch.float64), dim=-1)
    place = torch.tensor([0, 0, 0.25], dtype=torch.float64).expand(batch, 1, 3)
    twist = torch.randn(batch, 1, 6, generator=generator, dtype=torch.float64)
    return State(torch.cat([place, turn], -1), twist * torch.tensor([4, 4, 4, 1, 1, 0.5]))


@pytest.mark.parametrize("restitution", [0.0, 0.6])
@pytest.mark.parametrize("rate", [60, 240, 1000])
def test_tumbling_boxes_never_gain_energy_and_come_to_rest_on_the_ground(rate: int, restitution: float) -> None:
    size = torch.tensor([[[0.2, 0.15, 0.1]]], dtype=torch.float64)
    parameters = Parameters.of_boxes(size, ONE, 0.4 * ONE, restitution * ONE)
    rollout = roll(world(rate), tossed(32), 3 * rate, parameters)
    total = energy(rollout, parameters)
    assert float((total - total[:, :1]).max()) < 1e-9
    # What a step may add: a push out of an overlap, (g h / 2)^2 / 2, and the curved way of a corner that carries load.
    assert float((total[:, 1:] - total[:, :-1]).max()) < (G / rate) ** 2
    gap = lowest(rollout.pose[:, :, 0], size[0, 0])
    assert float(gap.min()) > -0.5 * G / rate**2
    assert float(gap[:, -1].abs().max()) < 1e-6
    assert float(rollout.twist[:, -1].abs().max()) < 1e-4


@pytest.mark.parametrize("step", [1e-4, 1e-3, 1 / 240, 1 / 60])
def test_an_overlap_opens_without_a_kick(step: float) -> None:
    rollout = roll(world(1 / step), state([[0, 0, 0.09]]), 300, boxes())
    height, up = rollout.pose[0, :, 0, 2] - 0.1, rollout.twist[0, :, 0, 5]
    assert float(up.max()) < G * step / 2 * (1 + 1e-4)
    above_ground = up**2 / 2 + G * height.clamp_min(0)
    assert float(above_ground.max()) < (G * step / 2) ** 2 / 2 * (1 + 1e-4)
    assert bool((height[1:] >= height[:-1] - 1e-9).all())
    assert float(height.max()) < 1e-8


@pytest.mark.parametrize(("rate", "compliance"), [(60, 1e-5), (60, 1e-3), (240, 1e-4), (1000, 1e-5)])
def test_a_box_comes_to_rest_as_deep_in_a_compliant_ground_as_its_weight_presses_it(
    rate: int, compliance: float
) -> None:
    soft = ContactCompliance(torch.tensor([compliance], dtype=torch.float64))
    for height in (0.1, 0.15):
        with torch.no_grad():
            rollout = PhysicsLayer(world(rate), [soft]).rollout(
                state([[0, 0, height]]), forces(3 * rate, [[0.0, 0, 0]]), boxes()
            )
        assert float(rollout.pose[0, -1, 0, 2] - 0.1) == pytest.approx(-compliance * G / 4, rel=1e-3)
        assert float(rollout.twist[0, -1].abs().max()) < 1e-6


@pytest.mark.parametrize(
    ("compliance", "mass", "backend"),
    [(6e-4, 2.0, "fused"), (1e-4, 0.5, "fused"), pytest.param(6e-4, 2.0, "reference", marks=pytest.mark.slow)],
)
def test_a_box_sinks_into_a_compliant_ground_as_a_critically_damped_spring(
    compliance: float, mass: float, backend: str
) -> None:
    """z = -s (1 - (1 + w t) exp(-w t)) with s = m g C / 4 and w = 2 / sqrt(C m), to the first order of the step."""
    soft = ContactCompliance(torch.tensor([compliance], dtype=torch.float64))
    rate, deep, off = 2 / (compliance * mass) ** 0.5, compliance * mass * G / 4, []
    for count in (30, 60):
        time = torch.linspace(0, 6 / rate, count + 1, dtype=torch.float64)
        layer = PhysicsLayer(world(1 / float(time[1])), [soft], backend=backend)  # type: ignore[arg-type]
        with torch.no_grad():
            rollout = layer.rollout(state([[0, 0, 0.1]]), forces(count, [[0.0, 0, 0]]), boxes(mass=[mass]))
        sunk = 0.1 - rollout.pose[0, :, 0, 2]
        known = deep * (1 - (1 + rate * time) * torch.exp(-rate * time))
        off.append(float((sunk - known).abs().max()) / deep)
        assert bool((sunk.diff() > -1e-9).all()), "it never comes back up"
    assert off[1] < 0.06
    assert off[1] < 0.6 * off[0]


@pytest.mark.parametrize("rate", [60, 240])
def test_a_box_on_a_box_stays_where_it_is(rate: int) -> None:
    start = state([[0, 0, 0.1], [0.02, 0.01, 0.3]])
    with torch.no_grad():
        rollout = PhysicsLayer(world(rate)).rollout(start, forces(1000, [[0.0, 0, 0]] * 2), boxes(mass=[1.0, 2.0]))
    torch.testing.assert_close(rollout.pose[:, -1], rollout.pose[:, 0], rtol=0, atol=1e-7)
    assert float(rollout.twist[:, -1].abs().max()) < 1e-6


@pytest.mark.parametrize("spin", [(20.0, 40.0, 20.0), (0.1, 50.0, 0.1), (3.0, 2.0, 1.0)])
@pytest.mark.parametrize("rate", [60, 240])
def test_a_free_box_keeps_energy_and_angular_momentum_for_twenty_seconds(spin: tuple[float, ...], rate: int) -> None:
    parameters = Parameters.of_boxes(FLAT, ONE, ONE)
    free = world(rate, gravity=(0, 0, 0), ground=None)
    rollout = roll(free, state([[0, 0, 0]], spin=[list(spin)]), 20 * rate, parameters)
    total = energy(rollout, parameters, 0.0)
    torch.testing.assert_close(total, total[:, :1].expand_as(total), rtol=1e-5, atol=0)
    axes = to_matrix(rollout.pose[0, :, 0, 3:])
    momentum = (axes * parameters.inertia[0, 0]) @ rotate_back(rollout.pose[0, :, 0], rollout.twist[0, :, 0, :3])[
        ..., None
    ]
    drift = (momentum - momentum[0]).norm(dim=(1, 2)) / momentum[0].norm()
    assert float(drift.max()) < 1e-9


def top(rate: int, backend: str = "fused") -> float:
    """Return the error of the axis of a symmetric top after 1 s: it turns about the angular momentum with |L| / I_1."""
    inertia = torch.tensor([[[0.004, 0.004, 0.007]]], dtype=torch.float64)
    parameters = Parameters.of_boxes(FLAT, ONE, ONE, inertia=inertia)
    spin = torch.tensor([4.0, 0, 9.0], dtype=torch.float64)
    free = world(rate, gravity=(0, 0, 0), ground=None)
    rollout = roll(free, state([[0, 0, 0]], spin=[spin.tolist()]), rate, parameters, backend)
    momentum = inertia[0, 0] * spin
    expected = rotate(exponential(momentum / 0.004), torch.tensor([0, 0, 1.0], dtype=torch.float64))
    return float((to_matrix(rollout.pose[0, -1, 0, 3:])[:, 2] - expected).norm())


def orders(errors: list[float]) -> list[float]:
    """Return the orders that errors of halved steps show."""
    return [math.log2(a / b) for a, b in itertools.pairwise(errors)]


def test_a_symmetric_top_precesses_as_the_closed_form_says_with_order_two() -> None:
    errors = [top(rate) for rate in (60, 120, 240, 480)]
    assert all(abs(order - 2) < 0.1 for order in orders(errors))
    assert errors[-1] < 1e-3
    assert top(60, "reference") == pytest.approx(errors[0], rel=1e-6)


def test_a_spring_keeps_its_swing_with_order_two() -> None:
    # An effect sees the pose at the midpoint: kick and drift, which neither damps nor drives a swing.
    errors = []
    for rate in (60, 120, 240, 480):
        spring = Tether(torch.tensor([20.0], dtype=torch.float64))
        layer = PhysicsLayer(world(rate, gravity=(0, 0, 0), ground=None), [spring])
        with torch.no_grad():
            rollout = layer.rollout(state([[0.3, 0, 0]]), forces(2 * rate, [[0.0, 0, 0]]), boxes())
        errors.append(abs(float(rollout.pose[0, -1, 0, 0]) - 0.3 * math.cos(2 * math.sqrt(20.0))))
    assert all(abs(order - 2) < 0.1 for order in orders(errors))


def refined(start: State, seconds: float, parameters: Parameters, rates: tuple[int, ...]) -> list[float]:
    """Return the orders by which the last pose changes less and less as steps are halved."""
    with torch.no_grad():
        ends = [roll(world(rate), start, round(seconds * rate), parameters).pose[0, -1] for rate in rates]
    return orders([float((a - b).norm()) for a, b in itertools.pairwise(ends)])


def test_a_block_that_slides_and_turns_converges_with_order_two() -> None:
    start = state([[0, 0, 0.1]], [[2.0, 0.4, 0]], [[0, 0, 3.0]])
    assert min(refined(start, 0.3, boxes(friction=0.2), (15, 30, 60, 120))) > 1.9


@pytest.mark.parametrize(("across", "aside"), [(0.0, 0.0), (0.002, 0.0), (0.02, 0.0), (0.2, 0.0), (0.02, 1.0)])
def test_a_block_that_turns_around_beside_its_line_ends_near_the_limit_of_short_steps(
    across: float, aside: float
) -> None:
    # With friction opposed to the slip at the end it was 30 to 37 mm off at 30 steps a second, at 240 still 1 to 4 mm.
    speed = torch.linspace(0.55, 0.75, 16, dtype=torch.float64)
    twist = torch.zeros(16, 1, 6, dtype=torch.float64)
    twist[:, 0, 3], twist[:, 0, 4] = speed, across
    start = State(state([[0, 0, 0.1]]).pose.expand(16, -1, -1), twist)

    def end(rate: int) -> Tensor:
        push = forces(rate, [[-5.0, aside, 0]]).expand(16, -1, -1, -1)
        with torch.no_grad():
            return PhysicsLayer(world(rate)).rollout(start, push, boxes(friction=0.2)).pose[:, -1, 0, :3]

    limit = end(7680)
    for rate, allowed in ((30, 2e-3), (60, 1e-3), (240, 5e-4)):
        assert float((end(rate) - limit).norm(dim=-1).square().mean().sqrt()) < allowed


def test_the_impulse_of_friction_that_turns_is_no_larger_than_friction_and_has_a_bounded_derivative() -> None:
    generator = torch.Generator().manual_seed(0)
    for size in (1.0, 1e-3, 1e-8, 1e-14):
        slip, change = (torch.randn(4000, 2, generator=generator, dtype=torch.float64) for _ in range(2))
        slip = (slip * size).requires_grad_()
        most = torch.rand(4000, generator=generator, dtype=torch.float64)
        end = slip_after(slip, change, most)
        assert bool(((end - slip - change).norm(dim=1) <= most * (1 + 1e-9)).all())
        (slope,) = torch.autograd.grad(end.sum(), slip)
        assert float(slope.norm(dim=1).max()) < 100


def test_friction_that_turns_is_exact_along_a_line_and_of_second_order_off_it() -> None:
    def one(slip: tuple[float, float], change: tuple[float, float], most: float) -> Tensor:
        values = (torch.tensor([each], dtype=torch.float64) for each in (slip, change))
        return slip_after(*values, torch.tensor([most], dtype=torch.float64))[0]

    # Stops at a = 1 / 4 of the step, stays; is driven on; goes on.
    assert one((0.5, 0.0), (-1.0, 0.0), 1.0).tolist() == pytest.approx([0.0, 0.0], abs=1e-15)
    assert one((1.0, 0.0), (-3.0, 0.0), 1.0).tolist() == pytest.approx([-2.0 * 0.75, 0.0], abs=1e-14)
    assert one((5.0, 0.0), (-3.0, 0.0), 1.0).tolist() == pytest.approx([1.0, 0.0], abs=1e-14)

    def end(steps: int) -> Tensor:
        slip = torch.tensor([[0.8, 0.3]], dtype=torch.float64)
        for _ in range(steps):
            change = torch.tensor([[-1.0, 0.7]], dtype=torch.float64) / steps
            slip = slip_after(slip, change, torch.tensor([0.5], dtype=torch.float64) / steps)
        return slip[0]

    limit = end(512)
    assert min(orders([float((end(steps) - limit).norm()) for steps in (1, 2, 4, 8)])) > 1.7


def test_a_box_that_tips_over_its_edge_converges_with_order_two() -> None:
    turn = exponential(torch.tensor([0, 0.5, 0], dtype=torch.float64))
    pose = torch.cat([torch.zeros(3, dtype=torch.float64), turn])[None, None]
    pose[..., 2] -= lowest(pose, torch.full((3,), 0.2, dtype=torch.float64))
    assert min(refined(State.at_rest(pose), 0.1, boxes(friction=5.0), (120, 240, 480, 960))) > 1.9


@pytest.mark.parametrize("restitution", [0.5, 0.8])
def test_a_corner_that_hits_the_ground_sends_the_box_the_same_way_at_any_rate(restitution: float) -> None:
    turn = exponential(torch.tensor([0.3, 0.4, 0], dtype=torch.float64))
    pose = torch.cat([torch.tensor([0, 0, 0.25], dtype=torch.float64), turn])[None, None]
    start = State(pose, torch.tensor([[[0.2, 0.5, 0.1, 0.3, 0, 0]]], dtype=torch.float64))
    parameters = boxes(friction=0.3, restitution=restitution)
    ends = [roll(world(rate), start, round(0.2 * rate), parameters).pose[0, -1, 0] for rate in (60, 240, 960, 7680)]
    errors = [float((end - ends[-1]).norm()) for end in ends[:-1]]
    assert errors[0] < 5e-3
    assert errors[1] < 1e-3
    assert errors[2] < 3e-4


def test_a_landing_with_friction_ends_where_the_closed_form_says_at_any_rate() -> None:
    # Until the landing the speed is 1.5, there friction takes mu u_c of it, and then mu g.
    fall = math.sqrt(2 * 0.037 / G)
    for rate in (30, 60, 240):
        rollout = roll(world(rate), state([[0, 0, 0.137]], [[1.5, 0, 0]]), round(0.3 * rate), boxes(friction=0.3))
        speed, t = 1.5 - 0.3 * G * fall, 0.3 - fall
        expected = 1.5 * fall + speed * t - 0.3 * G * t**2 / 2
        assert float(rollout.pose[0, -1, 0, 0]) == pytest.approx(expected, abs=2e-3 * (60 / rate) ** 2)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_two_blocks_collide_head_on_where_and_when_the_closed_form_says(restitution: float) -> None:
    masses, gap = [1.0, 2.0], 0.037
    start = state([[0, 0, 0], [0.2 + gap, 0, 0]], [[1.0, 0, 0], [0, 0, 0]])
    push = forces(12, [[0.0, 0, 0]] * 2)
    parameters = boxes(mass=masses, restitution=math.sqrt(restitution))
    rollout = PhysicsLayer(world(60, gravity=(0, 0, 0), ground=None)).rollout(start, push, parameters)
    after = [(1 - 2 * restitution) / 3, (1 + restitution) / 3]
    t = torch.arange(13, dtype=torch.float64) / 60
    late = (t - gap).clamp_min(0)
    expected = torch.stack([t - late + after[0] * late, 0.2 + gap + after[1] * late], -1)
    torch.testing.assert_close(rollout.pose[0, :, :, 0], expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("heading", [0.0, 0.7])
@pytest.mark.parametrize("masses", [[1.0, 2.5], [2.5, 1.0]])
@pytest.mark.parametrize("phase", [0.1, 0.5, 0.9])
def test_friction_acts_before_an_impact_on_the_old_slip_and_after_it_on_the_new(
    phase: float, masses: list[float], heading: float, backend: str
) -> None:
    """The struck block rests until then: what is left of the step alone brakes it, by up to mu g h = 0.05 m/s."""
    friction, rate, fast, steps = 0.3, 60, 1.0, 3
    brake, time = friction * G, (2 + phase) / rate
    gap, speed, left = fast * time - brake * time**2 / 2, fast - brake * time, steps / rate - time
    after = speed * masses[0] / sum(masses)
    turn = exponential(torch.tensor([0, 0, heading], dtype=torch.float64))
    axis, upright = to_matrix(turn)[:, 0], state([[0, 0, 0.1], [0, 0, 0.1]])
    place = upright.position + torch.tensor([0.0, 0.2 + gap], dtype=torch.float64)[:, None] * axis
    begin = State(torch.cat([place, turn.expand(1, 2, 4)], -1), upright.twist.clone())
    begin.twist[0, 0, 3:] = fast * axis
    layer = PhysicsLayer(world(rate), backend=backend)  # type: ignore[arg-type]
    rollout = layer.rollout(begin, forces(steps, [[0.0, 0, 0]] * 2), boxes(mass=masses, friction=friction))
    along, way = (value[0, -1] @ axis for value in (rollout.twist[..., 3:], rollout.pose[..., :3]))
    torch.testing.assert_close(along, torch.full_like(along, after - brake * left), rtol=0, atol=1.2e-3)
    moved = gap + after * left - brake * left**2 / 2
    torch.testing.assert_close(
        way, torch.tensor([moved, 0.2 + moved], dtype=torch.float64), rtol=0, atol=brake / (2 * rate**2)
    )


def test_a_midpoint_world_has_a_contact_rule_of_its_own() -> None:
    with pytest.raises(ValueError, match=r"contact must be left out with integration=Midpoint\(\)"):
        World(contact=Split(), integration=Midpoint())
    assert World().integration == SemiImplicit()
