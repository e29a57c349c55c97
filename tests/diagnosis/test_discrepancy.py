"""What the reference simulator says of an impact may go another way for a hair; it does not count against an effect."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from diagnosis.sets import recorded
from physid.data import RecordingSet
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import load_observations
from physid.diagnosis.reference import discrepancy as settling
from physid.diagnosis.reference.discrepancy import fit_with_reference
from physid.diagnosis.reference.nominal_fit import fit_nominal_model
from physid.effects import find

JUMP = 0.01  # [m]


@pytest.mark.slow
def test_a_replay_that_goes_another_way_makes_no_segment_worse(
    monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    effects = {"viscous_drag": {"coefficient": 0.8}}
    folder = recorded(tmp_path_factory.mktemp("settle") / "set", effects, trajectories=6, steps=80, split={"fit": 1})
    observations = load_observations(RecordingSet(folder))
    believed_model = read_nominal_model(observations.scene, None)
    nominal_fit = fit_nominal_model(
        observations, believed_model, [find("viscous_drag")], torch.Generator().manual_seed(0)
    )
    drag, segments = torch.tensor([0]), nominal_fit.experiment.predictor.segments
    row, start, size = (int(value[0]) for value in (segments.trajectory, segments.start, segments.size))
    true_replay = settling.replay

    def other_way(*arguments: object) -> Tensor:
        pose = true_replay(*arguments)  # type: ignore[arg-type]
        pose[row, start + size // 3 : start + size, :, 0] += JUMP * torch.arange(size - size // 3)[:, None] / size
        return pose

    begun = nominal_fit.experiment.linearise(nominal_fit.fit.point, drag)
    monkeypatch.setattr(settling, "replay", other_way)
    _, fit = fit_with_reference(nominal_fit.experiment, begun, drag, ("viscous_drag",), nominal_fit.settings)
    assert float(fit.loss[0]) < float(begun.loss[0])
    assert float(fit.point.effects[0, 0]) == pytest.approx(0.8, rel=0.1)
