"""Where fits begin: first guesses of states, coordinates of parameters, and new states that explain more."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from estimation.blocks import two_blocks
from estimation.flights import FORCE, Flights, G, flights
from physid.effects import find
from physid.estimation.least_squares.experiment import Experiment
from physid.estimation.least_squares.initial_states import InitialStates, guess_initial_states
from physid.estimation.least_squares.levenberg_marquardt import NONE, at_rest
from physid.estimation.least_squares.multi_start import best_guess, choose, search, try_new_states, varied
from physid.estimation.least_squares.settings import GuessSettings, LeastSquaresSettings, MultiStartSettings
from physid.estimation.prediction import NominalModel, Prediction, Predictor, Segmentation, Timeline, Variants
from physid.estimation.prediction.coordinates import (
    FARTHEST,
    SMALLEST,
    Coordinates,
    Unknown,
    is_effect,
    sorted_out,
    with_first_sizes,
)
from physid.physics.rotations import exponential, multiply
from physid.scenes import find_setup

PUSH = find_setup("push").scene
HALF = PUSH.bodies[0].size[2] / 2


def test_a_logarithm_is_that_of_a_positive_value_and_has_ends_that_are_told_from_others() -> None:
    mass = Unknown.of("block.mass")
    assert (mass.kind, mass.low, mass.scale, mass.null) == ("logarithm", 0.0, 1.0, 0.0)
    assert mass.coordinate(1.0) == 0.0
    assert mass.coordinate(0.0) == -torch.inf
    space = Coordinates((mass,))
    assert float(space.to_coordinates(torch.zeros(1).double())) == pytest.approx(float(torch.tensor(SMALLEST).log()))
    far = space.to_values(torch.tensor([[-99.0], [99.0]]).double())
    assert far[:, 0].log().tolist() == pytest.approx([-FARTHEST, min(FARTHEST, float(torch.tensor(mass.high).log()))])
    assert float(space.slopes(torch.tensor([0.7]).double())) == pytest.approx(float(torch.tensor(0.7).exp()), rel=1e-6)


def test_a_restitution_is_a_logarithm_unless_it_may_be_zero() -> None:
    bounce = "block.restitution"
    assert Unknown.of(bounce).kind == "logarithm"
    assert Unknown.of(bounce, logarithmic=True) == Unknown.of(bounce)
    linear = Unknown.of(bounce, logarithmic=False)
    assert (linear.kind, linear.low, linear.high, linear.unit) == ("linear", 0.0, 1.0, "")
    assert Unknown.of("block.friction", logarithmic=False).kind == "logarithm"
    assert [one.kind for one in Coordinates.of([bounce, "block.mass"]).unknowns] == ["logarithm"] * 2
    assert [one.kind for one in Coordinates.of([bounce, "block.mass"], logarithmic=False).unknowns] == [
        "linear",
        "logarithm",
    ]
    ends = Coordinates((linear,)).ends
    assert [float(end) for end in ends] == [0.0, 1.0]
    assert Coordinates((linear,)).within(torch.tensor([[-0.5], [0.5], [1.5]]).double())[:, 0].tolist() == [0, 0.5, 1]


def test_sizes_of_an_effect_have_its_range_and_its_typical_size_as_their_unit() -> None:
    wind = find("constant_force").quantities()["x"]
    one = Unknown.of("constant_force.x")
    assert (one.low, one.high, one.scale, one.null, one.unit) == (
        wind.low,
        wind.high,
        wind.typical - wind.null,
        0.0,
        "N",
    )
    assert one.coordinate(2 * wind.typical) == pytest.approx(2)
    assert Unknown.of("force_gain.gain").unit == ""
    assert is_effect("force_gain.gain")
    assert not is_effect("block.mass")
    assert sorted_out(["force_gain.gain", "block.mass"], PUSH) == (("block.mass",), ("force_gain.gain",))


def test_effects_begin_at_what_is_given_then_at_what_is_known_then_at_a_tenth_of_what_is_typical() -> None:
    known = {"constant_force": {"x": 0.7, "y": 0.0}}
    learned = ["constant_force.x", "constant_force.y", "viscous_drag.coefficient"]
    first, drag = with_first_sizes(known, learned, {"constant_force.y": -0.4})
    assert {name: float(value) for name, value in first.values().items()} == pytest.approx({"x": 0.7, "y": -0.4})
    assert float(drag.values()["coefficient"]) == pytest.approx(0.03)
    assert known == {"constant_force": {"x": 0.7, "y": 0.0}}, "what was given is left alone"


def seen(pose: Tensor, weight: Tensor | None = None, step: float = 1 / 60) -> InitialStates:
    """Guess the states of whole trajectories (R, T, N, 7)."""
    rows, frames = pose.shape[:2]
    there = torch.ones(pose.shape[:3]).double() if weight is None else weight
    time = (step * torch.arange(frames).double()).expand(rows, -1)
    scene = replace(find_setup("toss").scene, time_step=step)
    segments = Segmentation.equal(rows, frames, frames)
    return guess_initial_states(pose, there, time, segments, scene)


def thrown(step: float, frames: int = 20) -> tuple[Tensor, Tensor, Tensor]:
    """Return poses of a spinning box in flight, and its first pose and twist."""
    time = step * torch.arange(frames).double()
    spin, speed = torch.tensor([1.0, -2.0, 0.5]).double(), torch.tensor([0.7, -0.4, 1.5]).double()
    first = torch.tensor([0.3, -1.0, 5.0]).double()
    attitude = exponential(torch.tensor([0.2, 0.1, -0.4]).double())
    pose = torch.zeros(1, frames, 1, 7).double()
    pose[0, :, 0, :3] = first + speed * time[:, None] - torch.tensor([0, 0, G]) / 2 * time[:, None] ** 2
    pose[0, :, 0, 3:] = multiply(exponential(spin * time[:, None]), attitude.expand(frames, 4))
    return pose, torch.cat([first, attitude]), torch.cat([spin, speed])


@pytest.mark.parametrize("step", [1 / 240, 1 / 60])
def test_a_thrown_box_has_the_state_it_was_thrown_with_in_each_guess(step: float) -> None:
    pose, first, twist = thrown(step)
    found = seen(pose, step=step)
    assert found.pose.shape[0] == len(GuessSettings().spans) + 1
    assert torch.allclose(found.pose, first.expand_as(found.pose), atol=1e-6)
    assert torch.allclose(found.twist, twist.expand_as(found.twist), atol=1e-5)
    assert not found.resting.any()


def test_frames_that_do_not_count_do_not_move_a_guess_and_short_spans_see_fewer_frames() -> None:
    pose, _, twist = thrown(1 / 240)
    weight = torch.ones(1, 20, 1).double()
    bad = pose.clone()
    bad[0, 2, 0, :3], weight[0, 2] = 99.0, 0.0
    found = seen(bad, weight, 1 / 240)
    assert torch.allclose(found.twist, twist.expand_as(found.twist), atol=1e-5)
    settings = GuessSettings()
    kinked = pose.clone()
    kinked[0, 7:, 0, 0] += 5.0 * torch.arange(13).double() / 240  # an impact between the spans
    off = (seen(kinked, step=1 / 240).twist[:, 0, 0, 3] - twist[3]).abs()
    counts = [max(settings.fewest, round(span * 240)) for span in settings.spans]
    assert [bool(one > 1e-4) for one in off[:-1]] == [count > 8 for count in counts]
    assert off[-1] == off[-2], "the last is the shortest, unless the body may be at rest"


def lying(places: Tensor) -> Flights:
    """Put blocks on the ground at places (R, T, 2), each trajectory a segment; states are at rest."""
    rows, frames = places.shape[:2]
    timeline = Timeline.regular(torch.zeros(rows, frames, 1, 6).double(), PUSH.time_step)
    segments = Segmentation.equal(rows, frames, frames)
    predictor = Predictor(NominalModel(replace(PUSH, unknown=())), timeline, segments)
    pose = torch.zeros(rows, frames, 1, 7).double()
    pose[..., 0, :2], pose[..., 2], pose[..., 6] = places, HALF, 1.0
    made = flights(trajectories=rows, frames=frames, cuts=1)
    lies = torch.ones(rows, 1, dtype=torch.bool)
    directions = type(made.experiment.directions).of(torch.tensor([0.0, 0, 1]).double(), lies, lies)
    scale = torch.full((rows, frames, 1, 6), 1e3).double()
    experiment = made.experiment.replace(predictor=predictor, pose=pose, directions=directions, scale=scale)
    point = Variants.of_states(pose[:, 0][None], torch.zeros(1, rows, 1, 6).double(), predictor.model.guess[None],
                               predictor.null[None])  # fmt: skip
    return Flights(experiment, point, point)


def test_bodies_that_lie_and_hardly_move_are_at_rest_where_that_explains_more() -> None:
    time = PUSH.time_step * torch.arange(12).double()
    slides = 0.09 * time - PUSH.bodies[0].friction * G * time**2 / 2
    places = torch.zeros(3, 12, 2).double()
    places[1, :, 0] = torch.where(slides.diff(append=slides[-1:]) > 0, slides, slides.max())
    made = lying(places)
    twist = torch.zeros_like(made.start.twist)
    twist[0, :, 0, 3] = torch.tensor([0.09, 0.09, 0.11]).double()  # the third is too fast to be inspected
    found = at_rest(made.experiment, made.start.replace(twist=twist))
    assert found.twist[0, :, 0, 3].tolist() == pytest.approx([0.0, 0.09, 0.11])
    fast = made.start.replace(twist=twist + 0.2)
    assert at_rest(made.experiment, fast) is fast
    flying = flights()
    assert at_rest(flying.experiment, flying.start) is flying.start


def asking(experiment: Experiment, worth: float) -> Experiment:
    """Ask of velocities to be worth so many noise variances."""
    settings = experiment.settings
    line_search = settings.line_search.model_copy(update={"worth": worth})
    return experiment.replace(settings=settings.model_copy(update={"line_search": line_search}))


def test_of_two_bodies_the_one_that_hardly_moves_is_at_rest_however_fast_the_other_one_is() -> None:
    time = torch.arange(24).double() / 240
    places = torch.zeros(1, 24, 2).double()
    places[0, :, 0] = 1.3 * time - 0.12 * G * time**2 / 2
    made = two_blocks(places)
    twist = torch.zeros_like(made.start.twist)
    twist[0, 0, :, 3] = torch.tensor([1.3, 0.05]).double()
    found = at_rest(made.experiment, made.start.replace(twist=twist))
    assert found.twist[0, 0, :, 3].tolist() == pytest.approx([1.3, 0.0])
    assert torch.equal(found.pose, made.start.pose)


def test_a_body_that_stops_at_once_may_have_been_at_rest_where_it_stops() -> None:
    made = two_blocks(torch.zeros(1, 24, 2).double())
    speed, friction = 0.03, 0.12
    way = speed**2 / (2 * friction * G)
    twist, pose = torch.zeros_like(made.start.twist), made.start.pose.clone()
    twist[0, 0, 1, 3] = speed
    pose[0, 0, 1, 0] -= way
    assert at_rest(made.experiment, made.start.replace(twist=twist, pose=pose)).twist.any(), "it explains more"
    found = at_rest(asking(made.experiment, 6.0), made.start.replace(twist=twist, pose=pose))
    assert not bool(found.twist.any())
    assert float(found.pose[0, 0, 1, 0] - pose[0, 0, 1, 0]) == pytest.approx(way, rel=0.02)
    assert torch.equal(found.pose[..., 2], pose[..., 2]), "it lies as high as before"


@pytest.mark.parametrize(("worth", "rests"), [(0.0, False), (6.0, True)])
def test_velocities_that_explain_no_more_than_noise_are_kept_only_if_nothing_is_asked_of_them(
    worth: float, rests: bool
) -> None:
    speed, frames = 0.03, 24
    time = 1 / 240 * torch.arange(frames).double()
    stop = speed / (0.12 * G)
    moved = torch.where(time < stop, speed * time - 0.12 * G * time**2 / 2, speed * stop / 2)
    made = two_blocks(torch.stack([torch.zeros(frames).double(), moved], -1)[None])
    twist = torch.zeros_like(made.start.twist)
    twist[0, 0, 1, 3] = speed
    found = at_rest(asking(made.experiment, worth), made.start.replace(twist=twist))
    assert bool(found.twist.any()) is not rests


@pytest.mark.parametrize(("friction", "push", "held"), [(0.12, 0.0, True), (0.0, 0.0, False), (0.12, 5.0, False)])
def test_a_velocity_at_rest_has_no_slope_exactly_where_friction_holds(friction: float, push: float, held: bool) -> None:
    made = two_blocks(torch.zeros(1, 24, 2).double(), friction, push)
    directions = made.experiment.directions
    fit = made.experiment.linearise(made.start, NONE).jacobian
    speeds = [column for column, (body, k) in enumerate(directions.used) if body == 0 and k in (8, 9)]
    shifts = [column for column, (body, k) in enumerate(directions.used) if k == 3]
    for column in speeds:
        assert bool(fit.state[column].any()) is not held
    assert all(bool(fit.state[column].any()) for column in shifts)


def test_each_segment_keeps_the_state_that_explains_it_best_and_all_stay_if_none_is_better() -> None:
    made = flights()
    wrong = made.true.replace(pose=made.true.pose.clone(), twist=made.true.twist.clone())
    wrong.pose[0, ::2, 0, 0] += 0.1
    other = made.true.replace(twist=made.true.twist.clone())
    other.twist[0, 1::2, 0, 3] += 5.0
    both = Variants.join([wrong, other])
    found = choose(made.experiment, both)
    assert torch.equal(found.pose, made.true.pose)
    assert torch.equal(found.twist, made.true.twist)
    assert choose(made.experiment, Variants.join([made.true, wrong, other]), made.true) is made.true


def test_the_best_guess_is_the_best_of_the_guesses_and_of_what_was_predicted_before() -> None:
    made = flights(noise=(0.0, 0.0))
    experiment = made.experiment
    segments, time = experiment.predictor.segments, experiment.predictor.timeline.time
    there = torch.ones(experiment.pose.shape[:3]).double()
    initial = guess_initial_states(experiment.pose, there, time, segments, experiment.predictor.model.scene)
    alone = best_guess(experiment, initial)
    aside = torch.tensor([1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]).double()
    shifted = replace(initial, pose=initial.pose + aside)
    known = experiment.predictor.predict(made.true)
    found = best_guess(experiment, shifted, None, known)
    assert torch.allclose(found.pose, made.true.pose, atol=1e-9)
    assert torch.allclose(found.twist, made.true.twist, atol=1e-9)
    assert float((alone.pose - made.true.pose)[..., :3].abs().max()) < 1e-3
    assert alone.effects.tolist() == [[0.0, 0.0]]
    again = try_new_states(experiment, made.true.replace(pose=made.true.pose + aside))
    assert torch.allclose(again.pose[..., :3], made.true.pose[..., :3], atol=1e-2)
    assert again.effects[0].tolist() == pytest.approx(FORCE)


def spoiled(made: Flights, which: list[int], misfit: float) -> Variants:
    """Shift the initial states of some segments so far that their mean squared residual is this (without noise)."""
    pose = made.true.pose.clone()
    pose[0, which, 0, 0] += (6 * misfit) ** 0.5 * 1e-3  # one of six coordinates, in units of its noise
    return made.true.replace(pose=pose)


@pytest.mark.parametrize(("misfit", "searched"), [(1.35, False), (1.45, True)])
def test_segments_are_searched_from_a_misfit_of_1_4_on(misfit: float, searched: bool) -> None:
    settings = LeastSquaresSettings(multi_start=MultiStartSettings(draws=0))
    made = flights(noise=(0.0, 0.0), settings=settings)
    fit = made.experiment.linearise(spoiled(made, [2], misfit), NONE)
    assert float(fit.loss[2]) / 72 == pytest.approx(misfit, rel=1e-6)
    found = search(made.experiment, fit)
    assert (float(made.experiment.losses(found)[0, 2]) < 1.0) is searched
    assert torch.equal(found.pose[0, 3:], fit.point.pose[0, 3:])


@pytest.mark.parametrize(("count", "searched"), [(4, True), (5, False)])
def test_where_more_than_half_of_the_segments_fit_badly_nothing_is_searched(count: int, searched: bool) -> None:
    settings = LeastSquaresSettings(multi_start=MultiStartSettings(draws=0))
    made = flights(noise=(0.0, 0.0), settings=settings)
    fit = made.experiment.linearise(spoiled(made, list(range(count)), 9.0), NONE)
    found = search(made.experiment, fit)
    assert (float(made.experiment.losses(found).sum()) < 1.0) is searched
    assert (found is fit.point) is not searched


class Watched(Predictor):
    """Keeps the last variants that it was asked for."""

    asked: Variants

    def predict(self, variants: Variants) -> Prediction:
        self.asked = variants
        return super().predict(variants)


def test_states_are_varied_as_far_as_the_fit_leaves_them_open_times_each_scale() -> None:
    scales = (0.5, 4.0)
    settings = LeastSquaresSettings(multi_start=MultiStartSettings(draws=400, scales=scales))
    made = flights(trajectories=1, cuts=1, settings=settings)
    old = made.experiment.predictor
    watched = Watched(old.model, old.timeline, old.segments, old.candidates)
    experiment = made.experiment.replace(predictor=watched)
    fit = experiment.linearise(made.true, NONE)
    varied(experiment, fit, made.true)
    assert len(watched.asked) == 1 + 2 * 400
    assert torch.equal(watched.asked.pose[0], made.true.pose[0])
    factor = fit.linear.parts[0].factor[0]
    known = torch.linalg.inv(factor @ factor.mT)
    shift = watched.asked.pose[1:, 0, 0, :3] - made.true.pose[0, 0, 0, :3]
    speed = watched.asked.twist[1:, 0, 0, 3:] - made.true.twist[0, 0, 0, 3:]
    found = torch.cat([shift, speed], 1).unflatten(0, (2, 400))
    places = torch.tensor([3, 4, 5, 9, 10, 11])
    expected = known[places][:, places]
    unit = expected.diagonal().rsqrt()
    for scale, one in zip(scales, found, strict=True):
        drawn = one.T @ one / 400
        assert torch.allclose(drawn * torch.outer(unit, unit) / scale**2, expected * torch.outer(unit, unit), atol=0.2)
