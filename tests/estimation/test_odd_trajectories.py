"""A trajectory that parameters of its own explain is named, and nothing else is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NoReturn

import pytest
import torch
from torch import Tensor

from physid.estimation.least_squares import NONE
from physid.estimation.prediction import NominalModel, Predictor, Segmentation, Timeline, Variants
from physid.estimation.segmented_fit import (
    Observed,
    OddTrajectory,
    SegmentedFitSettings,
    fit_around_events,
    fit_short_segments,
    odd_trajectories,
    weighed,
)
from physid.physics import SolverError
from physid.scenes import find_setup

STEP, FRAMES, PARTS, ROWS = 1 / 60, 60, 4, 6
MASS, FRICTION, FORCE = 2.0, 0.24, 9.0
SETTINGS = SegmentedFitSettings()
MADE = {"block.mass": MASS, "block.friction": FRICTION}
UNKNOWN = tuple(MADE)
SCENE = replace(find_setup("push").scene, time_step=STEP, integration=None, unknown=UNKNOWN)


def seen_of(mass: float, friction: float, gain: float = 1.0) -> tuple[Timeline, Tensor]:
    """Return the forces that were logged, and what a camera sees of blocks pushed by so many times these."""
    strength = torch.linspace(0.7, 1.3, ROWS).double()
    wrench = torch.zeros(ROWS, FRAMES, 1, 6).double()
    wrench[:, :20, 0, 3] = FORCE * strength[:, None]
    wrench[:, 30:, 0, 4] = -0.8 * FORCE * strength.flip(0)[:, None]
    timeline, whole = Timeline.regular(wrench, STEP), Segmentation.equal(ROWS, FRAMES, FRAMES)
    scene = replace(SCENE, bodies=(replace(SCENE.bodies[0], mass=mass, friction=friction),))
    pose, twist = torch.zeros(1, ROWS, 1, 7).double(), torch.zeros(1, ROWS, 1, 6).double()
    pose[..., 2], pose[..., 6] = scene.bodies[0].size[2] / 2, 1.0
    point = Variants.of_states(pose, twist, NominalModel(scene).guess[None], torch.zeros(1, 0).double())
    acting = Timeline.regular(gain * wrench, STEP).refined(PARTS)
    seen = Predictor(NominalModel(scene), acting, whole).predict(point).pose[0]
    seen[..., :3] += 3e-4 * torch.randn(seen[..., :3].shape, generator=torch.Generator().manual_seed(0)).double()
    return timeline, seen


def odd_ones(pose: Tensor, timeline: Timeline, fitted: Sequence[bool] = (True,) * ROWS) -> tuple[OddTrajectory, ...]:
    there = torch.ones(ROWS, FRAMES, 1).double()
    observed = Observed(pose, there, timeline, torch.tensor(fitted))
    whole = Segmentation.equal(ROWS, FRAMES, FRAMES)
    predictor = Predictor(NominalModel(SCENE), timeline.refined(PARTS), whole)
    found = fit_around_events(fit_short_segments(observed, predictor, SETTINGS), SETTINGS)
    _, experiment = weighed(found.experiment, found.fit, found.seen, None, SETTINGS.noise, robust=True)
    fit = experiment.linearise(found.fit.point, NONE)
    return odd_trajectories(experiment, fit, torch.ones(ROWS, dtype=torch.bool), SETTINGS.odd)


@pytest.mark.parametrize(
    ("row", "name", "value"),
    [
        pytest.param(3, "block.mass", 3.0, marks=pytest.mark.slow),
        pytest.param(4, "block.friction", 0.36, marks=pytest.mark.slow),
    ],
)
def test_a_trajectory_of_another_body_or_on_another_ground_is_named_with_what_it_has_of_its_own(
    row: int, name: str, value: float
) -> None:
    timeline, pose = seen_of(MASS, FRICTION)
    own = {**MADE, name: value}
    pose[row] = seen_of(own["block.mass"], own["block.friction"])[1][row]
    (odd,) = odd_ones(pose, timeline)
    assert (odd.row, odd.names) == (row, (name,))
    assert odd.own == pytest.approx([value], rel=0.03)
    assert odd.others == pytest.approx([MADE[name]], rel=0.03)


@pytest.mark.slow
def test_where_one_parameter_does_not_explain_it_all_are_named() -> None:
    timeline, pose = seen_of(MASS, FRICTION)
    pose[5] = seen_of(3.0, 0.12)[1][5]
    (odd,) = odd_ones(pose, timeline)
    assert (odd.row, odd.names) == (5, UNKNOWN)
    assert odd.own == pytest.approx([3.0, 0.12], rel=0.15)


@pytest.mark.slow
def test_one_that_nothing_was_fitted_to_is_named_too() -> None:
    timeline, pose = seen_of(MASS, FRICTION)
    pose[3] = seen_of(3.0, FRICTION)[1][3]
    fitted = [row != 3 for row in range(ROWS)]
    assert [odd.row for odd in odd_ones(pose, timeline, fitted)] == [3]


@pytest.mark.slow
def test_none_is_odd_where_all_are_alike_or_each_is_another() -> None:
    timeline, pose = seen_of(MASS, FRICTION)
    assert odd_ones(pose, timeline) == ()
    for row in range(ROWS):
        pose[row] = seen_of(MASS * (0.5 + 0.3 * row), FRICTION)[1][row]
    assert odd_ones(pose, timeline) == ()


@pytest.mark.slow
def test_where_a_try_has_no_solution_nothing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    timeline, pose = seen_of(MASS, FRICTION)
    pose[3] = seen_of(3.0, FRICTION)[1][3]

    def unsolved(*_: object) -> NoReturn:
        raise SolverError("contact problems were not solved")

    monkeypatch.setattr(Predictor, "with_model", unsolved)
    assert odd_ones(pose, timeline) == ()


@pytest.mark.slow
def test_none_is_odd_whose_own_parameters_explain_nothing() -> None:
    """A block that wanders off by itself is not another block."""
    timeline, pose = seen_of(MASS, FRICTION)
    pose[2, :, 0, 1] += 0.05 * torch.sin(torch.arange(FRAMES).double() / 5)
    assert odd_ones(pose, timeline) == ()
