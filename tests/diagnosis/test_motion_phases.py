"""What a body does at each frame is a matter of the motion, not of the camera's rate."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.estimation.prediction import Prediction, Predictor, Segmentation, Timeline, Variants
from physid.estimation.segmented_fit import PHASES, PhaseSettings, phases_of, phases_of_steps
from physid.estimation.segmented_fit.motion_phases import _switched
from physid.physics.contact import PATCH
from physid.scenes.setups.push import PUSH

SECONDS = 0.6


def names(rate: int, height: float = 0.0, speed: float = 0.0, push: float = 0.0) -> list[str]:
    """Name the phases of such a block (see `codes`), one after the other."""
    found = [PHASES[k] for k in codes(rate, height, speed, push)[:-1].tolist()]  # nothing pushes after the last frame
    return [name for name, before in zip(found, [None, *found], strict=False) if name != before]


def codes(
    rate: int,
    height: float = 0.0,
    speed: float = 0.0,
    push: float = 0.0,
    named: Callable[..., Tensor] = phases_of_steps,
) -> Tensor:
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
    return named(predictor.predict(point), timeline, scene, PhaseSettings())[0, :, 0]


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


@pytest.mark.parametrize("rate", [30, 60, 120, 240, 480])
@pytest.mark.parametrize(("named", "least"), [(phases_of_steps, 0), (phases_of, PhaseSettings().impact_frames)])
def test_an_impact_lasts_for_a_time_and_poses_show_it_for_some_frames_at_least(
    rate: int, named: Callable[..., Tensor], least: int
) -> None:
    settings = PhaseSettings()
    code = codes(rate, height=0.5**2 / 2 / 9.81, speed=2.0, named=named)
    after = int((code == PHASES.index("impact")).sum()) - 1  # the frame in which it falls
    assert after == max(least, round(settings.impact_time * rate))
    assert after / rate <= max(settings.impact_time + 0.5 / rate, least / rate)


@pytest.mark.parametrize("rate", [60, 240])
def test_an_impact_from_which_a_body_flies_on_takes_up_no_step_of_the_flight(rate: int) -> None:
    frames, step = 12, 5
    scene = dataclasses.replace(PUSH.scene, time_step=1 / rate)
    timeline = Timeline.regular(torch.zeros(1, frames, 1, 6).double(), 1 / rate)
    impulse = torch.zeros(1, 1, frames, PATCH).double()
    impulse[0, 0, step] = 2.0  # [N s] of each point
    pose, twist = torch.zeros(1, 1, frames, 1, 7).double(), torch.ones(1, 1, frames, 1, 6).double()
    for lasting in (0, 1, 2):
        settings = PhaseSettings().model_copy(update={"impact_time": lasting / rate})
        code = phases_of_steps(Prediction(pose, pose, twist, impulse), timeline, scene, settings)[0, :, 0]
        assert (code == PHASES.index("impact")).nonzero()[:, 0].tolist() == [*range(step, step + lasting + 1)]
        assert {PHASES[k] for k in code[code != PHASES.index("impact")].tolist()} == {"free_fall"}


def test_a_trajectory_is_judged_by_its_own_command_however_noisy_those_beside_it_are() -> None:
    settings, time_step, frames = PhaseSettings(), 1 / 240, 240
    wrench = torch.zeros(3, frames, 1, 6, dtype=torch.float64)
    wrench[0, 60:180, 0, 3] = 1.0  # weaker than those beside it
    wrench[1, :, 0, 3] = 50 * torch.randn(frames, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    switched = _switched(wrench, time_step, settings)
    lasting = round(settings.switch_time / time_step)
    expected = {*range(60, 61 + lasting), *range(180, 181 + lasting)}
    assert {*switched[0, :, 0].nonzero()[:, 0].tolist()} == expected
    assert not switched[1].any()  # a noise has no switches
    assert not switched[2].any()  # nothing is commanded
    for row in range(3):
        assert torch.equal(_switched(wrench[row : row + 1], time_step, settings)[0], switched[row])
