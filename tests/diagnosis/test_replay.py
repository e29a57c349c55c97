"""Reference simulators against closed forms, at stamps that do not lie on their steps."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from torch import Tensor

from physid.diagnosis.reference.replay import Reference, references_of, replay
from physid.diagnosis.settings.reference import ReplaySettings
from physid.estimation.prediction.nominal_model import NominalModel
from physid.estimation.prediction.rollout import Variants
from physid.estimation.prediction.segments import Segmentation
from physid.estimation.prediction.timeline import Timeline
from physid.scenes import Integration, find_setup

TOSS = find_setup("toss").scene
STEP = 1e-3
FINE_ENOUGH = 2e-5  # [m] a fiftieth of what a millisecond is at 1 m/s
SPEED = 2.0


def flown(reference: Reference) -> tuple[Tensor, Tensor]:
    """Return the heights of a box in flight by a reference and by g t^2 / 2, at uneven times."""
    time = torch.tensor([[0.0, 0.0163, 0.0341, 0.0498, 0.0671, 0.08333]], dtype=torch.float64)
    timeline = Timeline.regular(torch.zeros(1, 6, 1, 6, dtype=torch.float64), 1 / 60)
    grid = dataclasses.replace(timeline.grid, steps=time.diff(dim=1))
    model = NominalModel(TOSS)
    pose = torch.tensor([0.0, 0.0, 3.0, 0, 0, 0, 1], dtype=torch.float64).expand(1, 1, 1, 7)
    twist = torch.tensor([0.0, 0, 0, 0, 0, SPEED], dtype=torch.float64).expand(1, 1, 1, 6)
    nothing = torch.zeros(1, 0, dtype=torch.float64)
    point = Variants(pose, twist, model.guess[None], nothing, torch.zeros(1, 1, dtype=torch.float64))
    seen = replay(
        model, Timeline(time, grid), Segmentation.equal(1, 6, 6), point, ReplaySettings(), reference=reference
    )
    return seen[0, :, 0, 2], 3 + SPEED * time[0] - 9.81 * time[0] ** 2 / 2


@pytest.mark.parametrize("reference", [Reference("pybullet", STEP, lags=True), Reference("mujoco", 2 * STEP)])
def test_a_reference_flies_a_parabola_at_any_stamps(reference: Reference) -> None:
    pytest.importorskip(reference.name)
    height, parabola = flown(reference)
    assert (height - parabola).abs().max() < FINE_ENOUGH


def test_positions_of_semi_implicit_steps_run_ahead_by_half_a_step_unless_they_are_put_back() -> None:
    height, parabola = flown(Reference("pybullet", STEP))
    ahead = -9.81 * 0.08333 * STEP / 2
    assert float((height - parabola)[-1]) == pytest.approx(ahead, rel=0.05)


def test_recordings_of_a_known_simulator_are_replayed_with_its_own_steps() -> None:
    known = dataclasses.replace(TOSS, integration=Integration("semi_implicit_euler", 1 / 480))
    assert references_of(known, ReplaySettings()) == (Reference("pybullet", 1 / 480),)


def test_no_reference_of_an_unknown_maker_has_long_steps() -> None:
    slow = dataclasses.replace(TOSS, integration=None, time_step=1 / 30)
    assert all(each.step <= 1 / 480 for each in references_of(slow, ReplaySettings()))
    collide = dataclasses.replace(find_setup("collide").scene, integration=None)
    assert "pybullet" not in {each.name for each in references_of(collide, ReplaySettings())}
