"""Which steps a fit takes: parts of those that lead too far, and those that the fitted trajectories want alone."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from estimation.blocks import two_blocks
from estimation.flights import FORCE, G, flights
from physid.estimation.least_squares.experiment import Experiment, Fit
from physid.estimation.least_squares.levenberg_marquardt import NONE, bodies_at_rest, gauss_newton
from physid.estimation.least_squares.multi_start import carried, search
from physid.estimation.least_squares.settings import MultiStartSettings
from physid.estimation.prediction import Prediction, Predictor, Segmentation, Variants
from physid.physics import SolverError
from physid.physics.rotations import exponential

BOTH = torch.arange(2)


class Saturated(Predictor):
    """Sees bodies at x = atan(10 u) for an unknown parameter that is off by u: a step by the slope leads too far."""

    farthest = torch.inf  # what is off by more cannot be simulated

    def predict(self, variants: Variants) -> Prediction:
        off = (variants.nominal - self.model.guess)[:, 0, None, None, None]
        if bool((off.abs() > self.farthest).any()):
            raise SolverError("no solution")
        found = super().predict(variants)
        found.pose[..., 0] = torch.atan(10 * off)
        return found


@pytest.mark.parametrize(("off", "farthest"), [(0.05, 1e9), (0.2, 1e9), (-0.3, 1e9), (0.3, 0.31), (-0.2, 0.21)])
def test_a_fit_ends_where_nothing_is_left_although_a_whole_step_leads_further_away(off: float, farthest: float) -> None:
    """Newton's method for the zero of atan diverges from 1.39 on; and some of the steps may not be simulated at all."""
    made = flights(unknown=("block.mass",), noise=(0.0, 0.0), sizes=(0.0, 0.0))
    old = made.experiment.predictor
    pose = made.experiment.pose.clone()
    pose[..., 0] = 0.0
    predictor = Saturated(old.model, old.timeline, old.segments, old.candidates)
    predictor.farthest = farthest
    experiment = made.experiment.with_known_states().replace(predictor=predictor, pose=pose)
    begun = made.start.replace(nominal=made.start.nominal + off)
    fit = gauss_newton(experiment, begun, NONE)
    assert float(fit.point.nominal - made.start.nominal) == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("fitted", [0, 5])
def test_held_out_trajectories_have_no_say_however_much_worse_they_are_explained(fitted: int) -> None:
    """A wind blows in one of eight trajectories, whose initial states are known; a fit to it begins without one."""
    made = flights(trajectories=8, frames=20, cuts=1, noise=(0.0, 0.0), fitted=torch.arange(8) == fitted)
    pose = made.experiment.predictor.predict(made.start).pose[0]
    pose[fitted] = made.experiment.pose[fitted]
    experiment = made.experiment.with_known_states().replace(pose=pose)
    fit = gauss_newton(experiment, made.start, BOTH)
    assert fit.point.effects[0].tolist() == pytest.approx(FORCE, rel=0.02)
    before, after = (experiment.losses(one).sum() for one in (made.start, fit.point))
    assert float(after) > 2 * float(before), "all of them together are explained worse"


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_no_more_jacobians_are_made_than_are_asked_for_and_one_at_the_end(
    steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = flights(unknown=("block.mass",), noise=(0.0, 0.0), sizes=(2.0, 0.0))
    begun, asked = made.true.replace(nominal=made.true.nominal + 2.9), list[int]()
    line_search = made.experiment.settings.line_search.model_copy(update={"chords": 0})
    settings = made.experiment.settings.model_copy(update={"line_search": line_search})
    usual = Experiment.linearise

    def watched(self: Experiment, point: Variants, *words: torch.Tensor) -> Fit:
        asked.append(len(point))
        return usual(self, point, *words)

    monkeypatch.setattr(Experiment, "linearise", watched)
    fit = gauss_newton(made.experiment.replace(settings=settings), begun, NONE, steps=steps)
    assert asked == [1] * (steps + 1)
    # A step changes the logarithm of the mass by one at most.
    assert float(fit.point.nominal - made.true.nominal) > 2.9 - steps - 1e-9


@pytest.mark.parametrize(("loss", "many"), [(0.008, False), (0.012, True)])
def test_a_step_is_the_last_that_gains_less_than_a_hundredth_of_a_deviation_in_all(
    loss: float, many: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of what is linear and exact one step gains all: of a loss of nearly nothing the deviation is one."""
    made, asked = flights(noise=(0.0, 0.0)), list[int]()
    away = torch.tensor([[0.1, 0.05]]).double()
    found = float(made.experiment.losses(made.true.replace(effects=made.true.effects + away)).sum())
    begun = made.true.replace(effects=made.true.effects + (loss / found) ** 0.5 * away)
    usual = Experiment.linearise

    def watched(self: Experiment, point: Variants, *words: torch.Tensor) -> Fit:
        asked.append(len(point))
        return usual(self, point, *words)

    monkeypatch.setattr(Experiment, "linearise", watched)
    fit = gauss_newton(made.experiment, begun, BOTH)
    assert float(fit.loss.sum()) < 1e-3 * loss
    assert (len(asked) > 1) is many


@pytest.mark.parametrize("lengths", [[24, 24], [8, 24], [24, 3]])
def test_bodies_are_brought_to_rest_alone_and_together_where_they_start_and_where_they_stop(lengths: list[int]) -> None:
    """Of two blocks the one that stops within the segment rests where it stops, the other at the segment's end."""
    friction, step = 0.12, 1 / 240
    made = two_blocks(torch.zeros(2, 24, 2).double(), friction)
    predictor = made.experiment.predictor.over(Segmentation.whole(torch.tensor(lengths), 24))
    experiment = made.experiment.replace(predictor=predictor)
    speed = torch.tensor([[0.03, 0.06], [0.0, 0.02]]).double()
    twist = torch.zeros_like(made.start.twist)
    twist[0, :, :, 4] = speed
    many, still = bodies_at_rest(experiment, made.start.replace(twist=twist), each=True)
    time = (speed / (friction * G)).minimum(step * (torch.tensor(lengths)[:, None] - 1))
    way = speed * time - friction * G * time**2 / 2
    moves = speed > 0
    chosen = [moves, moves & torch.tensor([True, False]), moves & torch.tensor([False, True])]
    assert still.tolist() == torch.stack([0 * moves > 0, *chosen, *chosen]).tolist()
    for k, one in enumerate([0 * moves > 0, *chosen, *chosen]):
        assert torch.allclose(many.twist[k, ..., 4], torch.where(one, 0.0, speed))
        off = (many.pose[k] - made.start.pose[0])[..., 1]
        # A step that takes the share f of its change of velocity away goes on by f / 2 of its way, and not by f^2 / 2.
        assert torch.allclose(off, torch.where(one & (torch.tensor(k) > 3), way, 0.0), atol=friction * G * step**2 / 8)
    assert float(way[0].min()) > 15 * friction * G * step**2


def test_who_does_not_move_or_moves_fast_is_not_brought_to_rest() -> None:
    made = two_blocks(torch.zeros(1, 12, 2).double())
    limit = made.experiment.settings.line_search.at_rest
    for speeds in ((0.0, 0.0), (limit, -2 * limit), (0.0, limit)):
        twist = torch.zeros_like(made.start.twist)
        twist[0, 0, :, 3] = torch.tensor(speeds).double()
        point = made.start.replace(twist=twist)
        many, still = bodies_at_rest(made.experiment, point, each=True)
        assert many is point
        assert still.tolist() == [[[False, False]]]


class Blind(Predictor):
    """A camera that shows every body at x = 0."""

    def observe(self, state: torch.Tensor, variants: Variants) -> torch.Tensor:
        return torch.cat([0 * state[..., :1], state[..., 1:]], -1)


def test_a_camera_that_does_not_see_along_an_axis_leaves_initial_states_where_they_were_along_it() -> None:
    made = flights(noise=(0.0, 0.0))
    fit, old = made.experiment.linearise(made.true, NONE), made.experiment.predictor
    blind = made.experiment.replace(predictor=Blind(old.model, old.timeline, old.segments, old.candidates))
    aside = made.true.replace(pose=made.true.pose.clone())
    aside.pose[..., 1] += 0.3
    found = carried(blind, fit, aside)
    assert torch.allclose(found.pose[..., :3], made.true.pose[..., :3], atol=1e-2)
    assert torch.allclose(found.effects, made.true.effects)


@pytest.mark.parametrize("speed", [0.0, 0.002, 0.004])
def test_a_velocity_that_friction_stops_within_a_step_moves_a_block_by_half_of_its_way_and_none_at_rest(
    speed: float,
) -> None:
    """A step takes a velocity evenly away. At rest there is no slope: the braking distance is v^2 / (2 mu g)."""
    friction, step = 0.12, 1 / 240
    made = two_blocks(torch.zeros(1, 24, 2).double(), friction)
    twist = torch.zeros_like(made.start.twist)
    twist[0, 0, 1, 3] = speed
    assert speed < friction * G * step
    fit = made.experiment.linearise(made.start.replace(twist=twist), NONE)
    columns = made.experiment.directions.used
    slope = fit.jacobian.state[columns.index((1, 9)), 0, 2:, 1, 3]
    assert torch.allclose(slope, torch.full_like(slope, step / 2 if speed else 0.0), rtol=1e-3, atol=1e-12)
    assert not bool(fit.jacobian.state[columns.index((0, 9))].any()), "the other block is at rest"
    place = fit.jacobian.state[columns.index((1, 3)), 0, :, 1, 3]
    assert torch.allclose(place, torch.ones_like(place), rtol=1e-6)


def test_a_step_of_one_segment_leaves_the_others_where_they_are() -> None:
    """All segments but one begin where they should: that one is mended, and its spin with it."""
    made = flights(noise=(0.0, 0.0))
    off = made.true.replace(pose=made.true.pose.clone(), twist=made.true.twist.clone())
    off.pose[0, 3, 0, 3:] = exponential(torch.tensor([0.02, 0.0, -0.01]).double())
    off.pose[0, 3, 0, 0] += 0.05
    off.twist[0, 3, 0, 5] -= 0.2
    experiment: Experiment = made.experiment
    fit: Fit = gauss_newton(experiment, off, BOTH)
    assert float(fit.loss.sum()) < 1e-2
    assert torch.allclose(fit.point.pose[..., :3], made.true.pose[..., :3], atol=1e-4)
    assert torch.allclose(fit.point.twist[..., 3:], made.true.twist[..., 3:], atol=1e-3)
    one = replace(made, start=fit.point).start
    assert one.effects[0].tolist() == pytest.approx(FORCE, rel=1e-2)


def test_a_body_that_stops_at_once_is_found_at_rest_beside_one_that_slides() -> None:
    """From a wrong speed of the one, both are fitted: that of the other stays what it is."""
    time = torch.arange(24).double() / 240
    places = torch.zeros(1, 24, 2).double()
    places[0, :, 0] = 1.3 * time - 0.12 * G * time**2 / 2
    made = two_blocks(places)
    plain = made.experiment.settings.model_copy(update={"multi_start": MultiStartSettings(draws=0, doubtful=1e9)})
    asked = plain.model_copy(update={"line_search": plain.line_search.model_copy(update={"worth": 6.0})})
    experiment = made.experiment.replace(settings=asked)
    twist, pose = torch.zeros_like(made.start.twist), made.start.pose.clone()
    twist[0, 0, :, 3] = torch.tensor([1.3, 0.05]).double()
    pose[0, 0, 1, 0] -= 2e-3
    begun = experiment.linearise(made.start.replace(twist=twist, pose=pose), NONE)
    found = experiment.losses(search(experiment, begun))[0]
    assert float(found) < 0.01 * float(begun.loss)
