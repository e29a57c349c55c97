"""What a body does at each frame is a matter of the motion, not of the camera's rate."""

from __future__ import annotations

import dataclasses

import pytest
import torch

from physid.diagnosis.inputs import PHASES, phases_of
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.settings.inputs import PhaseSettings
from physid.estimation.prediction import Predictor, Segmentation, Timeline, Variants
from physid.scenes.setups.push import PUSH

SECONDS = 0.6


def names(rate: int, height: float = 0.0, speed: float = 0.0, push: float = 0.0) -> list[str]:
    """Name the phases of a block that is let go at a height, moves along x, and is pushed along it, frame by frame."""
    scene, frames = dataclasses.replace(PUSH.scene, time_step=1 / rate), round(SECONDS * rate)
    wrench = torch.zeros(1, frames, 1, 6, dtype=torch.float64)
    wrench[..., 3] = push
    timeline = Timeline.regular(wrench, 1 / rate).refined(480 // rate)
    whole, model = Segmentation.whole(torch.tensor([frames]), frames), read_nominal_model(scene, None)
    predictor = Predictor(model, timeline, whole)
    pose = torch.tensor([[0.0, 0.0, height + scene.bodies[0].size[2] / 2, 0.0, 0.0, 0.0, 1.0]], dtype=torch.float64)
    twist = torch.tensor([[0.0, 0.0, 0.0, speed, 0.0, 0.0]], dtype=torch.float64)
    point = Variants.of_states(pose[None, None], twist[None, None], model.guess[None], predictor.null[None])
    code = phases_of(predictor.predict(point), timeline, scene, PhaseSettings())[0, :, 0]
    found = [PHASES[k] for k in code[:-1].tolist()]  # nothing pushes after the last frame
    return [name for name, before in zip(found, [None, *found], strict=False) if name != before]


@pytest.mark.parametrize("rate", [30, 60, 120, 240])
def test_a_landing_at_half_a_metre_per_second_is_an_impact_at_every_rate(rate: int) -> None:
    """Over a thirtieth of a second it is one and a half weights, over a 240th twelve."""
    assert names(rate, height=0.5**2 / 2 / 9.81, speed=2.0) == ["free_fall", "impact", "coast"]


@pytest.mark.parametrize("rate", [30, 60, 120, 240])
def test_what_lies_and_is_pushed_hits_nothing_at_any_rate(rate: int) -> None:
    assert names(rate) == ["rest"]
    assert names(rate, push=0.5) == ["stick"]
    assert names(rate, push=8.0, speed=0.5) == ["slide_fast"]
    assert names(rate, speed=0.4) == ["coast", "rest"]


def test_a_touch_that_is_slower_than_the_limit_is_no_impact() -> None:
    limit = PhaseSettings().hard
    assert "impact" not in names(240, height=(0.7 * limit) ** 2 / 2 / 9.81)
    assert "impact" in names(240, height=(1.5 * limit) ** 2 / 2 / 9.81)
