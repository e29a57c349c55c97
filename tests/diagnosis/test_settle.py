"""What the other engine says of a hit may go another way for a hair; it does not count against an effect."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from diagnosis.sets import recorded
from physid.data.format import RecordingSet
from physid.diagnosis.inputs.model_source import believe
from physid.diagnosis.inputs.observations import observe
from physid.diagnosis.reference import discrepancy as settling
from physid.diagnosis.reference.discrepancy import settle
from physid.diagnosis.reference.nominal_fit import prepare
from physid.effects import find

JUMP = 0.01  # [m]


def test_a_replay_that_goes_another_way_makes_no_window_worse(
    monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    effects = {"viscous_drag": {"coefficient": 0.8}}
    folder = recorded(tmp_path_factory.mktemp("settle") / "set", effects, trajectories=6, steps=80, split={"fit": 1})
    observations = observe(RecordingSet(folder))
    believed = believe(observations.scene, None)
    prepared = prepare(observations, believed, [find("viscous_drag")], torch.Generator().manual_seed(0))
    drag, windows = torch.tensor([0]), prepared.experiment.predictor.windows
    row, start, size = (int(value[0]) for value in (windows.trajectory, windows.start, windows.size))
    true_replay = settling.replay

    def other_way(*arguments: object) -> Tensor:
        pose = true_replay(*arguments)  # type: ignore[arg-type]
        pose[row, start + size // 3 : start + size, :, 0] += JUMP * torch.arange(size - size // 3)[:, None] / size
        return pose

    begun = prepared.experiment.linearise(prepared.fit.point, drag)
    monkeypatch.setattr(settling, "replay", other_way)
    _, fit = settle(prepared.experiment, begun, drag, ("viscous_drag",))
    assert float(fit.loss[0]) < float(begun.loss[0])
    assert float(fit.point.effects[0, 0]) == pytest.approx(0.8, rel=0.1)
