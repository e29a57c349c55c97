"""Free changes of initial states, and derivatives along them, against closed forms of free flight."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from estimation.flights import MASS, G, flights
from physid.estimation.least_squares.jacobian import BEND, FAINT, SLOPES, Directions, differentiate, usable_slopes
from physid.estimation.least_squares.settings import DifferenceSettings, LeastSquaresSettings, PriorSettings
from physid.estimation.prediction import Prediction, Predictor, Variants
from physid.physics.rotations import exponential, logarithm, multiply

NORMALS = [
    (0.0, 0.0, 1.0),
    (0.6, 0.0, 0.8),
    (0.0, -0.8, 0.6),
    (0.95, 0.1, (1 - 0.95**2 - 0.01) ** 0.5),
    (1.0, 0.0, 0.0),
]
FLAT = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)


@pytest.mark.parametrize("normal", NORMALS)
def test_the_axes_of_any_ground_are_two_tangents_and_its_normal_right_handed(normal: tuple[float, ...]) -> None:
    up = torch.tensor(normal, dtype=torch.float64)
    frame = Directions.of(up, torch.zeros(1, 1).bool()).frame
    assert torch.allclose(frame @ frame.T, torch.eye(3).double(), atol=1e-12)
    assert torch.allclose(frame[2], up)
    assert float(torch.linalg.det(frame)) == pytest.approx(1)


def test_the_tangents_of_a_flat_ground_are_x_and_y() -> None:
    assert torch.allclose(Directions.of(FLAT, torch.zeros(1, 1).bool()).frame, torch.eye(3).double())


def test_what_lies_moves_in_the_plane_what_is_level_up_and_down_too_and_all_else_anywhere() -> None:
    resting, level = torch.tensor([[True, False, False]]), torch.tensor([[True, True, False]])
    free = Directions.of(FLAT, resting, level).free[0].int().tolist()
    assert free == [[0, 0, 1, 1, 1, 0] * 2, [0, 0, 1, 1, 1, 1] * 2, [1] * 12]
    assert Directions.of(FLAT, resting).free[0, 1].all(), "none is level unless that is said"
    still = Directions.of(FLAT, resting, level).without_speed().free[0].int().tolist()
    assert still == [[0, 0, 1, 1, 1, 0] + [0] * 6, [0, 0, 1, 1, 1, 1] + [0] * 6, [1] * 6 + [0] * 6]
    one = Directions.of(
        FLAT, torch.tensor([[True, False], [False, False]]), torch.tensor([[True, False], [True, True]])
    )
    assert one.lying.tolist() == [True, False]
    assert one.used[:6] == [(0, 2), (0, 3), (0, 4), (0, 5), (0, 8), (0, 9)]


def test_steps_and_priors_are_those_of_turns_shifts_spins_and_speeds() -> None:
    settings = DifferenceSettings(turn=1e-5, shift=2e-5, spin=3e-5, speed=4e-5)
    steps = Directions.of(FLAT, torch.zeros(1, 1).bool()).steps(settings)
    assert steps.tolist() == pytest.approx([size for size in (1e-5, 2e-5, 3e-5, 4e-5) for _ in range(3)])


@pytest.mark.parametrize("normal", NORMALS)
def test_states_turn_and_shift_along_the_axes_of_the_ground_and_other_bodies_with_the_first(
    normal: tuple[float, ...],
) -> None:
    directions = Directions.of(torch.tensor(normal, dtype=torch.float64), torch.zeros(1, 2).bool())
    pose, twist = torch.zeros(1, 2, 7).double(), torch.zeros(1, 2, 6).double()
    pose[..., 3:] = exponential(torch.tensor([0.3, -0.2, 0.5]).double())
    for column, (body, k) in enumerate(directions.used):
        change = torch.zeros(1, 24).double()
        change[0, column] = 0.1
        moved, faster = directions.move(pose, twist, change)
        axis = 0.1 * directions.frame[k % 3]
        turned = logarithm(multiply(moved[..., 3:], pose[..., 3:] * torch.tensor([-1, -1, -1, 1])))
        expected = torch.zeros(4, 2, 3).double()  # turn, shift, spin, speed
        expected[k // 3, body] = axis
        if k in (3, 4) and body == 0:
            expected[1] = axis
        found = torch.stack([turned, moved[..., :3] - pose[..., :3], faster[..., :3], faster[..., 3:]])[:, 0]
        assert torch.allclose(found, expected, atol=1e-9)
        assert torch.allclose(moved[..., 3:].norm(dim=-1), torch.ones(1, 2).double())


def test_what_is_not_free_in_a_segment_does_not_move_there() -> None:
    directions = Directions.of(FLAT, torch.tensor([[True], [False]]))
    pose, twist = torch.zeros(2, 1, 7).double(), torch.zeros(2, 1, 6).double()
    pose[..., 6] = 1.0
    moved, faster = directions.move(pose, twist, torch.ones(2, 12).double())
    assert moved[0, 0, 2] == 0 < moved[1, 0, 2]
    assert faster[0, 0].tolist() == [0, 0, 1, 1, 1, 0]
    assert faster[1, 0].tolist() == [1] * 6


def test_slopes_of_a_flight_are_those_of_its_parabola() -> None:
    made = flights(trajectories=2, sizes=(0.8, -0.3), unknown=("block.mass",))
    experiment = made.experiment
    predictor, segments = experiment.predictor, experiment.predictor.segments
    push = torch.zeros(2, *predictor.timeline.time.shape, 1, 6).double()
    push[0, ..., 4], push[1, ..., 5] = 1.0, 1.0
    found = differentiate(predictor, made.true, experiment.directions, torch.tensor([1, 0]), push)
    time = predictor.timeline.time
    since = time - time.gather(1, segments.spread(segments.start))
    half = since.square() / 2
    for column, (_, k) in enumerate(experiment.directions.used):
        slope = found.state[column, :, :, 0, 3:]
        way = {1: torch.ones_like(since), 3: since}.get(k // 3, torch.zeros_like(since))
        expected = torch.zeros_like(slope)
        expected[..., k % 3] = way
        assert torch.allclose(slope, expected, atol=2e-5), k
        if k < 3:
            assert torch.allclose(found.state[column, :, :, 0, k], torch.ones_like(since), atol=1e-3)
    force = torch.tensor([0.8, -0.3], dtype=torch.float64)
    mass, other, along, up, side = (found.shared[k, :, :, 0, 3:] for k in (0, 1, 2, 4, 3))
    assert torch.allclose(mass[..., :2], -force / MASS * half[..., None], atol=1e-6, rtol=2e-4)
    assert torch.allclose(other[..., 1], half / MASS, atol=1e-9)
    assert torch.allclose(along[..., 0], half / MASS, atol=1e-9)
    assert torch.allclose(side[..., 1], half / MASS, atol=1e-6)
    assert torch.allclose(up[..., 2], half / MASS, atol=1e-6)
    height = found.base.pose[0, :, :, 0, 2] - made.true.pose[0, segments.spread(torch.arange(len(segments))), 0, 2]
    speed = made.true.twist[0, segments.spread(torch.arange(len(segments))), 0, 5]
    assert torch.allclose(height, speed * since - G * half, atol=1e-9)


class Bent(Predictor):
    """Poses that lie at a x + b x^2 / 2 along x for an unknown parameter that is off by x, in every frame."""

    bend, slope = 0.0, 1.0

    def predict(self, variants: Variants) -> Prediction:
        found = super().predict(variants)
        off = (variants.nominal - self.model.guess)[:, 0, None, None, None]
        found.pose[..., 0] = self.slope * off + self.bend * off**2 / 2
        return found


@pytest.mark.parametrize(("factor", "usable"), [(0.97, True), (1.03, False)])
@pytest.mark.parametrize("faint", [True, False])
def test_a_slope_is_used_unless_it_bends_by_a_tenth_between_two_steps_or_is_faint(
    factor: float, usable: bool, faint: bool
) -> None:
    made = flights(trajectories=2, unknown=("block.mass",))
    old = made.experiment.predictor
    predictor = Bent(old.model, old.timeline, old.segments, old.candidates)
    coarse, fine = SLOPES
    seen = torch.ones_like(old.timeline.time)
    seen[0, ::2] = 0.0
    frames = old.segments.sum_frames(seen[None])[0].sqrt()  # of a vector of so many equal slopes the length
    if faint:
        predictor.slope, most = 0.0, FAINT / float(frames.max())
        predictor.bend = factor * 2 * most / (coarse - fine)
        expected = [True, True, usable, usable]  # where half of the frames are not seen, less bends
    else:
        predictor.bend = factor * 2 * BEND / (coarse - fine - BEND * fine)
        expected = [usable] * 4
    found, good = usable_slopes(predictor, made.start, made.experiment.directions, seen)
    assert good.tolist() == expected
    assert torch.allclose(found[0, ..., 0, 3], torch.full_like(seen, predictor.slope + predictor.bend * fine / 2))


def test_initial_states_follow_shared_parameters_to_first_order_and_leave_what_they_cannot_follow() -> None:
    made = flights()
    fit = made.experiment.linearise(made.start, torch.arange(2))
    change, none = torch.tensor([0.0, 0.7, -1.2]).double(), torch.zeros(len(fit.loss)).double()
    moved = fit.linear.state_change(change, none) - fit.linear.state_change(0 * change, none)
    assert torch.allclose(fit.linear.response() @ change, moved, atol=1e-8)
    columns = torch.randn(3, *fit.residual.shape, generator=torch.Generator().manual_seed(0)).double()
    left = fit.linear.profile(columns)
    for part in fit.linear.parts:
        across = part.state.mT @ part.batch.columns(left)
        assert float((across / part.state.norm(dim=1)[..., None]).abs().max()) < 1e-4
        whole = part.batch.columns(columns) - part.batch.columns(left)
        rest = whole - part.profiled(whole)
        assert torch.allclose(rest, whole, atol=1e-3), "what is taken out is made by initial states"


def test_segments_count_by_their_share_and_of_trajectories_the_chosen_ones() -> None:
    made = flights()
    fit = made.experiment.linearise(made.start, torch.arange(2))
    own, half = fit.linear.by_segment(), torch.tensor([1.0, 0.0, 0.5, 0.0, 0.0, 0.0, 2.0, 1.0]).double()
    found = fit.linear.normal(half)
    assert torch.allclose(found.matrix[1], 0.5 * own.matrix[2])
    assert torch.allclose(found.vector[3], 2 * own.vector[6] + own.vector[7])
    assert torch.allclose(found.square, torch.stack([own.square[0], 0.5 * own.square[2], 0 * own.square[0],
                                                     2 * own.square[6] + own.square[7]]))  # fmt: skip
    some = fit.normal().of(torch.tensor([True, False, False, True])).select(torch.tensor([2, 1]))
    assert torch.allclose(some.matrix[1], fit.normal().matrix[3][[2, 1]][:, [2, 1]])
    assert torch.allclose(some.vector[1], fit.normal().vector[3][[2, 1]])
    ridge = torch.tensor([0.1, 0.2]).double()
    solved = some.solved(ridge)
    step = torch.linalg.solve(some.matrix.sum(0) + torch.diag(ridge), some.vector.sum(0))
    assert torch.allclose(solved.vector.sum(0), ridge * step), "only the ridge still pulls"
    assert torch.allclose(solved.square, some.loss(step))
    each = some.square - 2 * some.vector @ step + torch.einsum("p,rpq,q->r", step, some.matrix, step)
    assert torch.allclose(some.loss(step.expand(2, 2)), each)


def test_priors_of_initial_states_follow_the_order_of_turns_shifts_spins_and_speeds() -> None:
    deviations: tuple[float, float, float, float] = (0.1, 0.2, 0.3, 0.4)
    made = flights(settings=LeastSquaresSettings(prior=PriorSettings(state=deviations)))
    blind = made.experiment.replace(scale=0 * made.experiment.scale)
    fit = blind.linearise(made.start, torch.zeros(0, dtype=torch.int64))
    factor = fit.linear.gather(lambda part: part.factor @ part.factor.mT).diagonal(dim1=1, dim2=2)
    assert torch.allclose(factor[0], torch.tensor(deviations).double().repeat_interleave(3) ** -2)


def turned_about(angle: float, pose: Tensor) -> Tensor:
    about = exponential(torch.tensor([0.0, 0.0, angle], dtype=torch.float64))
    return multiply(about.expand_as(pose[..., 3:]), pose[..., 3:])


def test_what_is_level_is_turned_flat_by_the_least_turn_and_does_not_tumble() -> None:
    directions = Directions.of(FLAT, torch.zeros(2, 1).bool(), torch.tensor([[True], [False]]))
    pose, twist = torch.zeros(2, 1, 7).double(), torch.arange(12.0).double().reshape(2, 1, 6)
    lean = exponential(torch.tensor([0.1, -0.05, 0.0], dtype=torch.float64))
    flat = torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=torch.float64)
    pose[..., 3:] = lean
    found, slower = directions.level(pose, twist)
    assert torch.allclose(found[0, 0, 3:], flat, atol=2e-3)
    assert torch.equal(found[1], pose[1])
    assert slower[0, 0].tolist() == [0, 0, 2, 3, 4, 5]
    assert torch.equal(slower[1], twist[1])
    heading = replace(directions).level(torch.cat([pose[..., :3], turned_about(0.7, pose)], -1), twist)[0]
    assert torch.allclose(heading[0, 0, 3:], turned_about(0.7, torch.cat([pose[0, 0, :3], flat])), atol=2e-3)


class Watched(Predictor):
    """Keeps the variants that it was asked for."""

    asked: Variants

    def predict(self, variants: Variants) -> Prediction:
        self.asked = variants
        return super().predict(variants)


@pytest.mark.parametrize(("size", "direction"), [(0.0, 1), (0.5, 1), (5.0, -1)])
def test_a_difference_goes_towards_the_typical_size_and_never_beyond_a_range(size: float, direction: int) -> None:
    made = flights(trajectories=1, cuts=1, kinds=("viscous_drag",), sizes=(size,), unknown=("block.restitution",))
    old = made.experiment.predictor
    watched = Watched(old.model, old.timeline, old.segments, old.candidates)
    settings = DifferenceSettings(effect=1e-2, nominal=1e-3)
    for value, way in ((0.3, 1), (1.0, -1)):
        point = made.true.replace(nominal=torch.tensor([[value]], dtype=torch.float64))
        found = differentiate(watched, point, made.experiment.directions, torch.tensor([0]), None, settings)
        moved = watched.asked.effects[:, 0] - size
        assert moved.tolist() == pytest.approx([0.0] * 14 + [direction * 1e-2 * 0.3])
        assert (watched.asked.nominal[:, 0] - value).tolist() == pytest.approx([0.0] * 13 + [way * 1e-3, 0.0])
        assert float(found.shared[1, 0, -1, 0, 3:] @ made.true.twist[0, 0, 0, 3:]) < 0, "a drag slows down"
