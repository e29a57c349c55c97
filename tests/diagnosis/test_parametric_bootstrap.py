"""How far estimates diverge by numerics alone: not at all in pushes, visibly where impacts amplify."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from diagnosis.sets import recorded
from physid.data import RecordingSet
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import load_observations
from physid.diagnosis.reference.nominal_fit import fit_nominal_model
from physid.diagnosis.testing.hypothesis import Hypothesis, conclude
from physid.diagnosis.testing.parametric_bootstrap import bootstrap_spread
from physid.effects import find

EXACT = 0.2  # of a standard error
MOST = 0.5  # of a parameter: no clean data mislead an estimate further


def fitted(folder: Path, **changes: object) -> Hypothesis:
    observations = load_observations(
        RecordingSet(recorded(folder, trajectories=5, steps=60, split={"fit": 1}, **changes))
    )
    generator = torch.Generator().manual_seed(0)
    nominal_fit = fit_nominal_model(
        observations, read_nominal_model(observations.scene, None), [find("viscous_drag")], generator
    )
    return conclude(nominal_fit.experiment, nominal_fit.fit, (), nominal_fit.settings)


@pytest.mark.slow
def test_pushes_leave_the_scatter_over_trajectories_alone_and_one_busy_segment_does_not(tmp_path: Path) -> None:
    pushed = fitted(tmp_path / "push")
    assert not bootstrap_spread(pushed, torch.Generator()).any()
    assert bootstrap_spread(pushed, torch.Generator()).shape == pushed.covariance().shape
    pushed.experiment.predictor.segments.contact[0] = True
    assert bootstrap_spread(pushed, torch.Generator()).any()


@pytest.mark.slow
def test_a_push_without_noise_gives_back_the_parameters_that_it_was_made_with(tmp_path: Path) -> None:
    pushed = fitted(tmp_path / "push")
    pushed.experiment.predictor.segments.contact[0] = True
    moved, known = bootstrap_spread(pushed, torch.Generator().manual_seed(1)), pushed.covariance()
    unknown = pushed.fit.point.nominal.shape[1]
    assert (moved.diagonal()[:unknown] < EXACT**2 * known.diagonal()[:unknown]).all()


@pytest.mark.slow
def test_impacts_make_estimates_scatter_a_little(tmp_path: Path) -> None:
    unknown = ("block.friction",)
    toss = fitted(tmp_path / "toss", scene="toss", protocol_of_split={}, seed=2, unknown=unknown)
    moved = bootstrap_spread(toss, torch.Generator().manual_seed(1))
    assert toss.experiment.predictor.segments.contact.any()
    assert torch.linalg.eigvalsh(moved).min() > -1e-9
    assert 0 < float(moved[0, 0].sqrt()) < MOST
