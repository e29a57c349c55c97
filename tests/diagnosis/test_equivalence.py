"""Which effects a protocol cannot tell apart: closed forms, and a clock against gravity in free flight."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch
from torch import Tensor

from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing.equivalence import cosine, leaves_more
from physid.diagnosis.testing.score_test import Conditional, Group, condition
from physid.effects import find
from physid.estimation.least_squares.jacobian import Directions, differentiate
from physid.estimation.least_squares.normal_equations import linearise
from physid.estimation.prediction.nominal_model import NominalModel
from physid.estimation.prediction.rollout import Predictor
from physid.estimation.prediction.segments import Segmentation
from physid.estimation.prediction.timeline import Timeline
from physid.estimation.prediction.variants import Variants
from physid.scenes import find_setup

ALIKE, VISIBLE = Settings().equivalence.alike, Settings().score_test.visible
ONE = torch.ones(1, dtype=torch.float64)
NO_NUISANCE = (torch.zeros(0, dtype=torch.int64), *2 * [torch.zeros(0, 1, dtype=torch.float64)])


def group(*columns: int) -> Group:
    many = torch.ones(len(columns), dtype=torch.float64)
    return Group((f"effect {columns}",), torch.tensor(columns), many, many, -1e9 * many, 1e9 * many)


def given(columns: Tensor) -> Conditional:
    return Conditional(columns.T @ columns, torch.zeros(columns.shape[1], 1), *NO_NUISANCE)


def test_an_effect_that_makes_the_same_signature_is_alike_whatever_its_size_and_sign() -> None:
    one = torch.randn(40, 1, generator=torch.Generator().manual_seed(1)).double() * 5
    assert cosine(given(torch.cat([one, -3 * one], 1)), group(0), ONE, group(1), VISIBLE) == pytest.approx(1)


def test_an_orthogonal_effect_is_not_and_between_them_it_is_the_squared_cosine() -> None:
    axes = 9 * torch.eye(3, dtype=torch.float64)
    angle = torch.tensor(0.4, dtype=torch.float64)
    between = angle.cos() * axes[:, :1] + angle.sin() * axes[:, 1:2]
    both = given(torch.cat([axes[:, :1], axes[:, 1:2], between], 1))
    assert cosine(both, group(0), ONE, group(1), VISIBLE) == pytest.approx(0)
    assert cosine(both, group(0), ONE, group(2), VISIBLE) == pytest.approx(float(angle.cos() ** 2))
    assert cosine(both, group(2), ONE, group(0, 1), VISIBLE) == pytest.approx(1)
    faint = cosine(both, group(0), -1e-6 * ONE, group(2), VISIBLE)
    assert faint == pytest.approx(float(angle.cos() ** 2)), "however small the change"


def test_an_effect_that_does_not_show_is_alike_to_none() -> None:
    one = torch.ones(4, 1, dtype=torch.float64)
    assert cosine(given(torch.cat([5 * one, 0.1 * one], 1)), group(0), ONE, group(1), VISIBLE) == 0


@pytest.mark.parametrize("cuts", [1, 3])
def test_in_free_flight_a_clock_is_gravity_and_no_wind(cuts: int) -> None:
    """g (1 + k)^2 t^2 / 2: segments start anew, so that no sample is taken across the edge of two segments."""
    scene = find_setup("toss").scene
    frames, kinds = 60, ["clock_rate", "gravity_error", "constant_force"]
    predictor = Predictor(
        NominalModel(scene),
        Timeline.regular(torch.zeros(1, frames, 1, 6, dtype=torch.float64), scene.time_step),
        Segmentation.equal(1, frames, frames // cuts),
        [find(name) for name in kinds],
    )
    pose = torch.tensor([0, 0, 5.0, 0, 0, 0, 1], dtype=torch.float64).expand(1, cuts, 1, 7)
    twist = torch.tensor([0, 0, 0, 1.0, 0.5, 2], dtype=torch.float64).expand(1, cuts, 1, 6)
    point = Variants(
        pose, twist, torch.zeros(1, 0, dtype=torch.float64), predictor.null[None], torch.zeros(1, 1).double()
    )
    resting = torch.zeros(cuts, 1, dtype=torch.bool)
    directions = Directions.of(torch.tensor([0, 0, 1.0], dtype=torch.float64), resting)
    jacobian = differentiate(predictor, point, directions, torch.arange(len(predictor.terms)))
    scale = torch.full((1, frames, 1, 6), 1e4, dtype=torch.float64)
    linear = linearise(torch.zeros_like(scale), scale, jacobian, directions, predictor.segments)
    nothing = torch.zeros(0, dtype=torch.int64)
    normal = condition(linear.normal(), nothing, torch.zeros(0, dtype=torch.float64))
    clock, gravity, wind = group(0), group(1), group(2, 3)
    assert cosine(normal, gravity, ONE, clock, VISIBLE) > ALIKE
    assert cosine(normal, gravity, ONE, wind, VISIBLE) < 1 - ALIKE


@pytest.mark.parametrize(("left", "apart"), [(200.0, True), (5.0, False)])
def test_laws_that_start_alike_are_told_apart_by_what_they_leave_where_nothing_hits(left: float, apart: bool) -> None:
    """A lag and a delay have one signature; at the size that the data want, one may fit and the other not."""
    contact = torch.tensor([False, False, True])
    segments = SimpleNamespace(predictor=SimpleNamespace(segments=SimpleNamespace(contact=contact)))
    lag, delay = (
        cast(
            Any, SimpleNamespace(experiment=segments, fit=SimpleNamespace(loss=torch.tensor(loss)), settings=Settings())
        )
        for loss in ([900.0, 900.0, 4000.0], [900.0, 900.0 + left, 40.0])
    )
    assert leaves_more(lag, delay) == apart
    assert not leaves_more(delay, lag)
