"""The linearised experiment against plain least squares on all columns at once."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from physid.estimation.least_squares.jacobian import Directions
from physid.estimation.least_squares.normal_equations import Linearised, Part, linearise
from physid.estimation.least_squares.settings import PriorSettings
from physid.estimation.prediction.segments import Segmentation
from physid.physics import SolverError

TRAJECTORIES, FRAMES, STATES, SHARED = 2, 12, 4, 3


@pytest.fixture
def linear() -> Linearised:
    """Three segments of each trajectory, with columns of very different lengths."""
    generator = torch.Generator().manual_seed(0)
    segments = Segmentation.equal(TRAJECTORIES, FRAMES, 4)
    parts = []
    for batch in segments.batches:
        count, rows = len(batch.segments), 6 * batch.frame.shape[1]
        residual, state, shared = (
            torch.randn(count, rows, width, generator=generator, dtype=torch.float64) for width in (1, STATES, SHARED)
        )
        state = state * torch.tensor([1e-3, 1.0, 30.0, 1e4], dtype=torch.float64)
        parts.append(Part(batch, residual[..., 0], state, shared, torch.linalg.cholesky(state.mT @ state)))
    return Linearised(segments, tuple(parts))


@pytest.mark.parametrize("damping", [0.0, 0.3, 100.0])
def test_a_damped_initial_state_is_held_by_so_much_of_what_its_own_columns_say(
    linear: Linearised, damping: float
) -> None:
    """Marquardt's damping adds rows sqrt(damping) |s_k|, one for each column s_k: no unit of a state matters."""
    change = torch.tensor([0.5, -1.0, 2.0], dtype=torch.float64)
    each = damping * (1 + torch.arange(len(linear.segments), dtype=torch.float64))
    found = linear.state_change(change, each)
    for part in linear.parts:
        for k, segment in enumerate(part.batch.segments.tolist()):
            state, left = part.state[k], part.residual[k] - part.shared[k] @ change
            held = torch.diag(each[segment].sqrt() * state.norm(dim=0))
            rows, wanted = torch.cat([state, held]), torch.cat([left, torch.zeros(STATES, dtype=torch.float64)])
            unit = rows.norm(dim=0)
            expected = torch.linalg.lstsq(rows / unit, wanted[:, None]).solution[:, 0] / unit
            assert torch.allclose(found[segment] * unit, expected * unit, rtol=1e-6, atol=1e-9)


def test_what_shared_columns_leave_is_the_least_that_any_initial_state_leaves(linear: Linearised) -> None:
    change = torch.tensor([0.5, -1.0, 2.0], dtype=torch.float64)
    states = linear.state_change(change, torch.zeros(len(linear.segments), dtype=torch.float64))
    least = torch.zeros(TRAJECTORIES, dtype=torch.float64)
    for part in linear.parts:
        left = part.residual - part.shared @ change
        left = left - (part.state @ states[part.batch.segments][..., None])[..., 0]
        least.index_add_(0, part.batch.trajectory, left.square().sum(1))
    assert torch.allclose(linear.normal().loss(change), least)


def test_other_data_make_the_normal_equations_that_they_would_make_if_they_were_observed(linear: Linearised) -> None:
    generator = torch.Generator().manual_seed(1)
    data = torch.randn(2, TRAJECTORIES, FRAMES, 1, 6, generator=generator, dtype=torch.float64)
    scale = torch.rand(TRAJECTORIES, FRAMES, 1, 6, generator=generator, dtype=torch.float64)
    found = linear.respond_by_segment(data, scale)
    for k, residual in enumerate(data):
        own = linear.observing(residual, scale).by_segment()
        assert torch.allclose(found.matrix, own.matrix)
        assert torch.allclose(found.vector[..., k], own.vector)
        assert torch.allclose(found.square[..., k], own.square)


def test_where_nothing_is_seen_an_initial_state_is_as_sure_as_its_prior() -> None:
    segments, blank = Segmentation.equal(1, FRAMES, FRAMES), torch.zeros(1, FRAMES, 1, 6, dtype=torch.float64)
    free = torch.zeros(1, 1, dtype=torch.bool)
    directions = Directions.of(torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64), free, free)
    columns = torch.ones(len(directions.used), *blank.shape, dtype=torch.float64)
    jacobian: Any = SimpleNamespace(state=columns, shared=columns[:1])
    linear = linearise(blank, blank, jacobian, directions, segments, PriorSettings(state=(0.1, 0.3, 5.0, 2.0)))
    precision = linear.parts[0].factor[0] @ linear.parts[0].factor[0].mT
    deviations = torch.tensor([0.1, 0.3, 5.0, 2.0], dtype=torch.float64).repeat_interleave(3)
    assert torch.allclose(precision, torch.diag(deviations**-2))


@pytest.mark.parametrize("which", ["state", "shared"])
def test_what_is_not_finite_is_no_linear_model(which: str) -> None:
    segments, seen = Segmentation.equal(1, FRAMES, FRAMES), torch.ones(1, FRAMES, 1, 6, dtype=torch.float64)
    free = torch.zeros(1, 1, dtype=torch.bool)
    directions = Directions.of(torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64), free, free)
    columns = torch.ones(len(directions.used), *seen.shape, dtype=torch.float64)
    jacobian = SimpleNamespace(state=columns, shared=columns[:1].clone())
    getattr(jacobian, which)[0, 0, 3] = torch.nan
    with pytest.raises(SolverError, match="expected finite changes"):
        linearise(seen, seen, jacobian, directions, segments)  # type: ignore[arg-type]
