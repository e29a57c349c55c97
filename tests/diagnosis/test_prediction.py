"""Predictions do not depend on how many segments are simulated at once."""

from __future__ import annotations

from pathlib import Path

import torch

from diagnosis.sets import recorded
from physid.data import RecordingSet
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import load_observations
from physid.effects import find
from physid.estimation.prediction.rollout import Predictor
from physid.estimation.prediction.segments import CutRule, Segmentation
from physid.estimation.prediction.variants import Variants


def test_threads_do_not_change_a_prediction(tmp_path: Path) -> None:
    observations = load_observations(RecordingSet(recorded(tmp_path / "set", trajectories=6, split={"fit": 1})))
    events = torch.zeros(observations.pose.shape[:2], dtype=torch.bool)
    events[:, 40], events[0, 70] = True, True
    segments, model = Segmentation.around(events, CutRule()), read_nominal_model(observations.scene, None)
    predictor = Predictor(model, observations.timeline, segments, [find("viscous_drag")])
    pose = observations.pose[segments.trajectory, segments.start][None]
    null = Variants(
        pose, torch.zeros_like(pose[..., :6]), model.guess[None], predictor.null[None], torch.zeros(1, 1).double()
    )
    many = null.repeat(5)
    many.effects[1:, 0] = torch.linspace(0.1, 0.4, 4, dtype=torch.float64)
    assert len(segments.batches) > 2
    little = Predictor(model, observations.timeline, segments, [find("viscous_drag")], most=1)  # one variant at a time
    apart = Variants.join([many[:2], many[2:3], many[3:]])
    threads, predicted = torch.get_num_threads(), []
    try:
        for count in (1, 2, 3):
            torch.set_num_threads(count)
            predicted.append(predictor.predict(many))
            with torch.inference_mode():  # as a trainer tests and predicts; each thread has a mode of its own
                predicted.append(predictor.predict(many))
            assert torch.get_num_threads() == count
    finally:
        torch.set_num_threads(threads)
    whole, few = predictor.predict(apart), little.predict(many)
    for name in ("pose", "twist", "impulse"):
        first, *others = (getattr(each, name) for each in predicted)
        assert bool(first.any())
        assert all(torch.equal(other, first) for other in [*others, getattr(whole, name)])
        # Worlds that are solved together take as many rounds as the worst of them.
        assert torch.allclose(getattr(few, name), first, rtol=1e-6, atol=1e-8)
