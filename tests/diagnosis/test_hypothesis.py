"""Leaving trajectories out: closed forms for a mean. A step that a line cannot make: a camera that is turned far."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from diagnosis.sets import recorded
from physid.data.format import RecordingSet
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import load_observations
from physid.diagnosis.reference.nominal_fit import fit_nominal_model
from physid.diagnosis.testing.hypothesis import begin_hypothesis
from physid.effects import find
from physid.estimation.least_squares.covariance import left_out
from physid.estimation.least_squares.normal_equations import Normal

NO_RIDGE = torch.zeros(1, dtype=torch.float64)


def means(values: torch.Tensor) -> Normal:
    """Return the normal equations of one shared mean, at the mean of values (R,), one for each trajectory."""
    pulls = (values - values.mean())[:, None]
    return Normal(torch.ones(len(values), 1, 1, dtype=torch.float64), pulls, values.square())


def test_without_one_value_the_mean_is_that_of_the_others() -> None:
    values = torch.tensor([1.0, 2.0, 4.0, 9.0], dtype=torch.float64)
    others = torch.stack([(values.sum() - value) / 3 for value in values])
    assert torch.allclose(left_out(means(values), NO_RIDGE)[:, 0], others - values.mean())


def test_the_squared_changes_are_the_variance_of_the_mean_and_a_little_more() -> None:
    values = torch.randn(20, generator=torch.Generator().manual_seed(3)).double()
    changes = left_out(means(values), NO_RIDGE)
    assert float(changes.square().sum()) == pytest.approx(float(values.var()) / 19)


def test_a_trajectory_that_alone_tells_a_parameter_makes_it_wide() -> None:
    normal = means(torch.tensor([1.0, 1.1, 0.9, 3.0], dtype=torch.float64))
    weight = torch.tensor([1, 1, 1, 100], dtype=torch.float64)[:, None, None]
    strong = Normal(weight * normal.matrix, normal.vector, normal.square)
    assert left_out(strong, NO_RIDGE)[3].abs() > 10 * left_out(strong, NO_RIDGE)[:3].abs().max()


def test_a_camera_that_is_turned_far_is_followed(tmp_path: Path) -> None:
    turned = {"camera_yaw": {"angle": 0.4}}
    changes = {"protocol": "paper", "trajectories": 6, "split": {"fit": 1}, "unknown": ("block.mass", "block.friction")}
    observations = load_observations(RecordingSet(recorded(tmp_path / "set", turned, **changes)))
    generator = torch.Generator().manual_seed(0)
    nominal_fit = fit_nominal_model(
        observations, read_nominal_model(observations.scene, None), [find("camera_yaw")], generator
    )
    start = nominal_fit.experiment.linearise(nominal_fit.fit.point, torch.tensor([0]))
    found = begin_hypothesis(nominal_fit.experiment, start, ("camera_yaw",), nominal_fit.settings)
    assert found.values["camera_yaw.angle"] == pytest.approx(0.4, abs=0.02)
    assert float(found.fit.loss.sum()) < 1.2 * float(nominal_fit.experiment.counted().sum())
