"""Fits from finite sizes find strong effects that no small step from a bent nominal fit finds."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from diagnosis.sets import recorded
from physid.data import RecordingSet
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import load_observations
from physid.diagnosis.reference.nominal_fit import fit_nominal_model
from physid.diagnosis.testing.hypothesis import begin_from_finite_sizes, columns_of
from physid.effects import CATALOGUE

STRENGTH = 0.12  # [1/m^2], six times the typical one
BENT = 2.5  # natural logarithm of the factor by which friction is off


@pytest.mark.slow
def test_a_strong_lens_is_found_whatever_the_nominal_fit_made_of_it(tmp_path: Path) -> None:
    folder = recorded(
        tmp_path / "lens", {"lens_distortion": {"k1": STRENGTH}}, steps=60, trajectories=5, split={"fit": 5}
    )
    observations = load_observations(RecordingSet(folder), None, None)
    model = read_nominal_model(observations.scene, None)
    fitted = fit_nominal_model(observations, model, list(CATALOGUE), torch.Generator().manual_seed(0))
    bent = fitted.fit.point.replace(nominal=fitted.fit.point.nominal - BENT)
    column = columns_of(fitted.experiment.predictor, ["lens_distortion"])
    one = torch.ones(1, dtype=torch.float64)
    found = begin_from_finite_sizes(fitted.experiment, bent, ("lens_distortion",), one, fitted.settings)
    assert float(found.fit.point.effects[0, column]) == pytest.approx(STRENGTH, rel=0.1)
