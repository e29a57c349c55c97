"""Examine a fitted hypothesis: linearise it with all it lacks, and compare with null simulations."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.reference.null_simulations import draw_null_simulations, p_value
from physid.diagnosis.testing.hypothesis import Hypothesis
from physid.diagnosis.testing.lack_of_fit import LackOfFit, Row
from physid.diagnosis.testing.null_distribution import score_test_of
from physid.diagnosis.testing.residual_wrench import gain_alone, local_gain, residual_wrenches
from physid.estimation.least_squares import Experiment, Fit


def find_lack_of_fit(nominal_fit: NominalFit, hypothesis: Hypothesis, generator: torch.Generator) -> LackOfFit:
    """Look at what a hypothesis leaves unexplained.

    Args:
        nominal_fit: The recordings.
        hypothesis: The hypothesis.
        generator: Randomness of the null simulations.
    """
    experiment, settings = hypothesis.experiment, hypothesis.settings
    predictor, segments = experiment.predictor, experiment.predictor.segments
    planar = not bool(experiment.directions.free[..., 0].any())
    cells, wrenches = residual_wrenches(
        nominal_fit.phases,
        experiment.directions.frame,
        planar,
        segments,
        predictor.model.scene.time_step,
        settings.residual_wrench,
    )
    test = score_test_of(hypothesis, wrenches)
    fit, groups, count = test.fit, test.groups, test.count

    null_data = draw_null_simulations(
        experiment, hypothesis.fit, nominal_fit.noise, hypothesis.working, settings, generator
    )
    response = test.respond(null_data)
    chance = test.chance(response)
    cleaned = test.cleaned(null_data, response)
    free = torch.tensor([count + k for k, cell in enumerate(cells) if cell.piece is not None])
    sound = _sound(experiment, hypothesis.fit, settings.null_distribution.bad)
    spread, some = settings.residual_wrench.spread, cleaned[:: settings.lack_of_fit.cell_draws]
    conditional, gained = test.observed()
    steady = torch.tensor([gain.steady for gain in gained], dtype=torch.float64)
    rare = chance.steady_tail.deviation(steady).tolist()
    rows = [
        Row(**vars(gain), tail=chance.tail[k], steady_tail=chance.steady_tail[k], p_value=p_value(z, chance.steady))
        for k, (gain, z) in enumerate(zip(gained, rare, strict=True))
    ]
    return LackOfFit(
        fit,
        cells,
        sorted(rows, key=lambda row: -row.gain),
        chance.best,
        chance.steady,
        local_gain(fit.linear, free, spread)[:, 0],
        local_gain(fit.linear, free, spread, cleaned, experiment.scale),
        conditional,
        groups,
        sound & experiment.fitted[segments.trajectory],
        sound,
        _cell_gains(fit, count + torch.arange(len(cells)), spread, some, experiment.scale),
        settings.lack_of_fit,
    )


def _sound(experiment: Experiment, fit: Fit, bad: float) -> Tensor:
    """Return the segments whose misfit is evidence: contact-free ones, and those with contact if most fit badly."""
    segments = experiment.predictor.segments
    followed = experiment.misfit(fit.point)[segments.contact & experiment.follow]
    badly = len(followed) > 0 and float(followed.median()) > bad
    return ~segments.contact | (experiment.follow & badly)


def _cell_gains(fit: Fit, columns: Tensor, spread: float, cleaned: Tensor, scale: Tensor) -> Tensor:
    """Compute what each residual wrench explains alone, beyond its mean over null simulations; shape (F, K)."""
    chance = gain_alone(fit.linear, columns, spread, cleaned, scale).mean(2)
    return (gain_alone(fit.linear, columns, spread)[..., 0] - chance).T
