"""How far estimates go astray by numerics alone: not at all in pushes, visibly where hits amplify."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from diagnosis.sets import recorded
from physid.data.format import RecordingSet
from physid.diagnosis.conclusion.parametric_bootstrap import astray
from physid.diagnosis.inputs.model_source import believe
from physid.diagnosis.inputs.observations import observe
from physid.diagnosis.reference.nominal_fit import prepare
from physid.diagnosis.testing.hypothesis import Hypothesis, conclude
from physid.effects import find

MOST = 0.5  # of a parameter: no clean data mislead an estimate further


def fitted(folder: Path, **changes: object) -> Hypothesis:
    observations = observe(RecordingSet(recorded(folder, trajectories=5, steps=60, split={"fit": 1}, **changes)))
    generator = torch.Generator().manual_seed(0)
    prepared = prepare(observations, believe(observations.scene, None), [find("viscous_drag")], generator)
    return conclude(prepared.experiment, prepared.fit, ())


def test_pushes_leave_the_scatter_over_trajectories_alone(tmp_path: Path) -> None:
    assert not astray(fitted(tmp_path / "push"), torch.Generator()).any()


@pytest.mark.slow
def test_hits_lead_estimates_astray_by_a_little(tmp_path: Path) -> None:
    unknown = ("block.friction",)
    toss = fitted(tmp_path / "toss", scene="toss", protocol_of_split={}, seed=2, unknown=unknown)
    moved = astray(toss, torch.Generator().manual_seed(1))
    assert toss.experiment.predictor.windows.busy.any()
    assert torch.linalg.eigvalsh(moved).min() > -1e-9
    assert 0 < float(moved[0, 0].sqrt()) < MOST
