"""Null simulations: replays from states that the data allow, noise about them, and what numerics leave."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from diagnosis.flown import QUICK, busy, random
from estimation.flights import FORCE, MASS, NOISE, Flights, flights
from physid.diagnosis.reference.null_simulations import draw_null_simulations, floors, jitter, noiseless
from physid.diagnosis.reference.replay import Reference
from physid.effects import from_values
from physid.estimation.least_squares import Experiment, Fit
from physid.estimation.measurement import Noise

WIND = from_values("constant_force", {"x": FORCE[0], "y": FORCE[1]})


def drawn_states(made: Flights, experiment: Experiment, fit: Fit, seeds: int) -> Tensor:
    """Draw initial states about a fit: shifts, speeds and spins of each segment; shape (draws, 9)."""
    drawn = [jitter(experiment, fit, QUICK, random(seed)) for seed in range(seeds)]
    old = fit.point
    parts = [torch.cat([(one.pose - old.pose)[0, :, 0, :3], (one.twist - old.twist)[0, :, 0, 3:],
                        (one.twist - old.twist)[0, :, 0, :3]], -1) for one in drawn]  # fmt: skip
    return torch.cat(parts)


def test_null_simulations_begin_where_the_data_and_the_first_frames_let_them() -> None:
    """Their precision is the sum of what the fit knows and what a line through the first five frames would."""
    made = flights(trajectories=60, cuts=2)
    fit = made.experiment.linearise(made.true, torch.zeros(0, dtype=torch.int64))
    found = drawn_states(made, made.experiment, fit, 6)
    factor = fit.linear.parts[0].factor[0]
    step = made.experiment.predictor.model.scene.time_step
    first = torch.tensor(NOISE).double().repeat_interleave(3)
    first = torch.cat([first, first * (12 / 5**3) ** 0.5 / step])
    expected = torch.linalg.inv(factor @ factor.mT + torch.diag(first**-2))
    places = torch.tensor([3, 4, 5, 9, 10, 11, 6, 7, 8])
    deviation = expected.diagonal()[places].sqrt()
    assert torch.allclose(found.std(0), deviation, rtol=0.12)
    across = (found / deviation).T @ (found / deviation) / len(found)
    wanted = expected[places][:, places] / torch.outer(deviation, deviation)
    assert torch.allclose(across, wanted, atol=0.15)


def test_where_nothing_was_seen_the_first_frames_bound_a_draw() -> None:
    made = flights(trajectories=80, cuts=1)
    scale = made.experiment.scale.clone()
    scale[1:] = 0.0
    scale[0, 3, 0, [2, 3]] *= 2.0  # one axis in one frame is known best
    blind = made.experiment.replace(scale=scale)
    fit = blind.linearise(made.true, torch.zeros(0, dtype=torch.int64))
    found = drawn_states(made, blind, fit, 6)
    slope = (12 / 5**3) ** 0.5 * 60
    expected = torch.tensor([NOISE[1]] * 3 + [NOISE[1] * slope] * 3 + [NOISE[0] * slope] * 3).double() / 2
    assert torch.allclose(found.std(0), expected, rtol=0.15)


def test_unknown_parameters_are_drawn_as_widely_as_the_data_leave_them_and_states_follow() -> None:
    made = flights(trajectories=2, cuts=1, unknown=("block.mass",), sizes=(4.0, 0.0), noise=(0.0, 0.0))
    fit = made.experiment.linearise(made.true, torch.zeros(0, dtype=torch.int64))
    drawn = [jitter(made.experiment, fit, QUICK, random(seed)) for seed in range(80)]
    shift = torch.stack([one.nominal[0, 0] - made.true.nominal[0, 0] for one in drawn])
    expected = float((fit.normal().matrix.sum(0)[0, 0] + 1 / 9) ** -0.5)
    assert float(shift.std()) == pytest.approx(expected, rel=0.3)
    speed = torch.stack([one.twist[0, 0, 0, 3] - made.true.twist[0, 0, 0, 3] for one in drawn])
    slope = float((speed * shift).sum() / shift.square().sum())
    assert slope == pytest.approx(float(fit.linear.response()[0, 9, 0]), rel=0.35)
    assert slope > 0, "a heavier box is pushed less, and begins faster"


@pytest.mark.parametrize("sure", [0.001, 1.0, 3.0])
def test_draws_that_the_data_contradict_are_shortened_unless_events_are_in_the_segment(sure: float) -> None:
    settings = QUICK.changed({"null_simulations.sure": sure})
    made = busy(flights(trajectories=30, cuts=2), [0, 5, 9])
    free = ~made.experiment.predictor.segments.contact
    fit = made.experiment.linearise(made.true, torch.zeros(0, dtype=torch.int64))
    drawn, whole = (jitter(made.experiment, fit, one, random(3)) for one in (settings, QUICK.changed(
        {"null_simulations.sure": 1e9})))  # fmt: skip
    most = fit.loss + 12 + sure * 24**0.5
    assert bool((made.experiment.losses(drawn)[0] <= most)[free].all())
    share = ((drawn.pose - fit.point.pose) / (whole.pose - fit.point.pose))[0, :, 0, 0]
    power = share.log2()
    assert torch.allclose(power, power.round(), atol=1e-6)
    assert bool((power <= 1e-6).all())
    assert torch.allclose(share[~free], torch.ones(3).double())
    assert bool((power[free] < -0.5).any()) is (sure < 3)


def test_what_a_replay_leaves_counts_for_each_value_that_is_seen() -> None:
    """A wind that the model has and the replay lacks; initial states take up what they can of F t^2 / (2 m)."""
    made = flights(trajectories=3, cuts=1)
    strong = made.true.replace(effects=torch.tensor([[4.0, 0.0]]).double())
    fit = made.experiment.linearise(strong, torch.zeros(0, dtype=torch.int64))
    found = floors(made.experiment, fit, QUICK, random())
    time = made.experiment.predictor.timeline.time[0]
    basis = torch.stack([torch.ones_like(time), time], 1)
    bent = 4.0 / MASS * time.square() / 2 / NOISE[1]
    left = bent - basis @ torch.linalg.lstsq(basis, bent[:, None]).solution[:, 0]
    assert found.tolist() == pytest.approx([float(left.square().sum()) / (6 * 24)] * 3, rel=0.02)
    none = QUICK.changed({"null_simulations.floor_replays": 0})
    assert floors(made.experiment, fit, none, random()).tolist() == [0.0] * 3
    still = made.experiment.linearise(made.start, torch.zeros(0, dtype=torch.int64))
    assert float(floors(made.experiment, still, QUICK, random()).max()) < 1e-3


def test_null_simulations_of_a_right_model_are_draws_of_the_noise_about_each_of_its_replays() -> None:
    made = flights(trajectories=3, cuts=1)
    settings = QUICK.changed({"null_simulations.replays": 3, "null_simulations.draws": 40})
    fit = made.experiment.linearise(made.true, torch.zeros(0, dtype=torch.int64))
    drawn = draw_null_simulations(made.experiment, fit, Noise(*NOISE), (WIND,), settings, random()).residual
    assert drawn.shape == (120, 3, 24, 1, 6)
    clean = drawn.unflatten(0, (3, 40)).mean(1, keepdim=True)
    white = drawn.unflatten(0, (3, 40)) - clean
    assert torch.allclose(white.flatten(0, 4).std(0) * (40 / 39) ** 0.5, Noise(*NOISE).spread(), rtol=0.05)
    assert float((clean[0] - clean[1]).abs().max()) > 0.2 * NOISE[1], "other initial states"
    exact = noiseless(made.experiment, fit, (WIND,), settings, random(), Reference("pybullet", 1e-3, staggered=True))
    assert float(exact[..., 3:].abs().max()) < 10 * NOISE[1]
    wrong = noiseless(made.experiment, fit, (), settings, random(), Reference("pybullet", 1e-3, staggered=True))
    off = (wrong - exact)[:, -1, 0, 3:5]
    time = float(made.experiment.predictor.timeline.time[0, -1])
    assert torch.allclose(off, (-torch.tensor(FORCE).double() / MASS * time**2 / 2).expand(3, 2), rtol=0.02)
