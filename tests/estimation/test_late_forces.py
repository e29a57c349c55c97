"""Steps for forces that act late: each trajectory is cut by what happens in it, whatever others there are."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from physid.data.observations.step_grid import StepGrid
from physid.estimation.least_squares.discretisation import StepChoice, parts_for_late_forces
from physid.estimation.prediction import NominalModel, Timeline
from physid.scenes import find_setup

STEP, LONG, SHORT, CHANGE = 1 / 60, 30, 14, 11
CHOICE = StepChoice(late=3.5 * STEP)
PUSH = find_setup("push").scene


def cut(frames: list[int], speed: Tensor) -> Tensor:
    """Return the parts of steps of trajectories of so many frames, with speeds (R, T); a force changes in each."""
    rows, longest = len(frames), max(frames)
    wrench = torch.zeros(rows, longest - 1, 1, 6).double()
    wrench[:, CHANGE:, 0, 3] = 6.0
    count = torch.tensor(frames) - 1
    places = torch.arange(longest).expand(rows, -1).minimum(count[:, None])
    wrench = wrench * (torch.arange(longest - 1) < count[:, None])[..., None, None]
    grid = StepGrid(torch.full((rows, longest - 1), STEP).double(), wrench, places, count)
    twist = torch.zeros(rows, longest, 1, 6).double()
    twist[:, :, 0, 3] = speed
    scale = torch.full((rows, longest, 1, 6), 1e3).double()
    experiment: Any = SimpleNamespace(predictor=SimpleNamespace(model=NominalModel(PUSH)), scale=scale)
    return parts_for_late_forces(experiment, Timeline(grid.times.gather(1, places), grid), CHOICE, twist, PUSH)


@pytest.mark.parametrize("rests", [0, 1, 9, 13])
def test_a_shorter_trajectory_beside_a_longer_one_has_the_steps_that_it_has_alone(rests: int) -> None:
    """Its last pose stands in the frames after its end: that is no other state, and no rest where it moves."""
    speed = torch.ones(2, LONG).double()
    speed[1, rests] = 0.0
    speed[1, SHORT:] = speed[1, SHORT - 1]
    alone = cut([SHORT], speed[1:, :SHORT])[0]
    beside = cut([LONG, SHORT], speed)
    assert beside[1, : SHORT - 1].tolist() == alone.tolist()
    assert beside[0].tolist() == cut([LONG], speed[:1])[0].tolist()
    assert alone[:CHANGE].tolist() == [1] * CHANGE
    sliding = cut([SHORT], torch.ones(1, SHORT).double())[0]
    near = rests > 1  # what sets off within the time by which forces may be late needs shorter steps
    assert (int(alone.max()) > int(sliding.max())) is near
