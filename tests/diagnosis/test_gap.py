"""How far a gap closes: the share is a mean over trajectories, its interval needs enough of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from physid.diagnosis.conclusion.gap import ROTATION, Closing, closing, errors_of, floors_of, residual_wrench_errors
from physid.diagnosis.settings.conclusion import GapSettings
from physid.diagnosis.testing.residual_wrench import Cell
from physid.estimation.least_squares.normal_equations import Linearised, Part
from physid.estimation.prediction.segments import Segmentation

SETTINGS = GapSettings()
FLOOR = 1e-6


@pytest.mark.parametrize("count", [1, 2, 3, 8])
def test_a_share_has_an_interval_where_there_are_enough_trajectories(count: int) -> None:
    generator = torch.Generator().manual_seed(count)
    before = 4 * FLOOR * (1 + 0.1 * torch.rand(count, generator=generator).double())
    after = FLOOR * (1 + 0.1 * torch.rand(count, generator=generator).double())
    floors, chosen = torch.full((count,), FLOOR).double(), torch.ones(count, dtype=torch.bool)
    values = torch.full((count,), 300)
    found = closing(before, after, floors, values, chosen, SETTINGS, generator)
    assert found is not None
    assert found.shrink is not None
    assert found.shrink.value == pytest.approx(1.0, abs=0.1)
    assert found.values == 300 * count
    if count < SETTINGS.fewest:
        assert found.shrink.low is found.shrink.high is None
        assert found.shrink.most == found.shrink.value
    else:
        assert found.shrink.low is not None
        assert found.shrink.low <= found.shrink.value <= found.shrink.most


def test_trajectories_of_which_no_frame_counts_have_no_gap() -> None:
    nothing, chosen = torch.zeros(4, dtype=torch.float64), torch.ones(4, dtype=torch.bool)
    found = closing(nothing, nothing, nothing, nothing, chosen, SETTINGS, torch.Generator())
    assert found is not None
    assert found.shrink is None


@pytest.mark.slow
@pytest.mark.parametrize("values", [30, 360, 10_000])
def test_noise_exceeds_the_ceiling_as_often_as_it_says(values: int) -> None:
    ceiling = Closing(1.0, 1.0, None, 0.5, values).ceiling(0.02)
    generator = torch.Generator().manual_seed(values)
    errors = 0.5 * torch.randn(4000, values, generator=generator).square().mean(1).sqrt()
    assert float((errors > ceiling).double().mean()) == pytest.approx(0.02, abs=0.007)
    assert Closing(0.0, 0.0, None, 0.0, 0).ceiling(0.02) == 0.0


def test_an_error_is_the_mean_square_with_frames_weighted_by_how_little_numerics_disturb_them() -> None:
    residual = torch.zeros(1, 3, 1, 6, dtype=torch.float64)
    residual[0, :, 0, 3] = torch.tensor([0.01, 0.02, 0.04])
    residual[..., :3] = 9.0  # turns are no errors of position
    scale = torch.full((1, 3, 1, 6), 1000.0, dtype=torch.float64)
    scale[0, 1] = 500.0  # twice the deviation: a quarter of the weight
    scale[0, 2] = 0.0  # is not there
    hypothesis: Any = SimpleNamespace(experiment=SimpleNamespace(scale=scale), fit=SimpleNamespace(residual=residual))
    expected = (0.01**2 + 0.25 * 0.02**2) / 1.25
    assert float(errors_of(hypothesis)) == pytest.approx(expected)
    noise: Any = SimpleNamespace(floor=0.002)
    assert float(floors_of(hypothesis.experiment, noise)) == pytest.approx(0.002**2 * 2 / 1.25)
    weaker: Any = SimpleNamespace(experiment=SimpleNamespace(scale=1e-6 * scale), fit=hypothesis.fit)
    assert float(errors_of(weaker)) == pytest.approx(expected), "weights are relative"
    disturbed = scale.clone()
    disturbed[0, 0] = 500.0
    both: Any = SimpleNamespace(scale=torch.cat([scale, disturbed]))  # the second has no frame that is not disturbed
    assert floors_of(both, noise).tolist() == pytest.approx([0.002**2 * 2 / 1.25, 0.002**2 * 2 / 0.5])


def test_an_error_of_rotations_is_their_mean_square_beside_the_noise_of_rotations() -> None:
    residual = torch.zeros(1, 2, 1, 6, dtype=torch.float64)
    residual[0, :, 0, :3] = torch.tensor([[0.03, 0.04, 0.0], [0.0, 0.0, 0.05]])
    residual[..., 3:] = 9.0  # displacements are no errors of rotation
    scale = torch.full((1, 2, 1, 6), 300.0, dtype=torch.float64)
    hypothesis: Any = SimpleNamespace(experiment=SimpleNamespace(scale=scale), fit=SimpleNamespace(residual=residual))
    assert float(errors_of(hypothesis, ROTATION)) == pytest.approx(0.05**2)
    noise: Any = SimpleNamespace(floor=0.002, rotation_floor=3**0.5 * 0.01)
    assert float(floors_of(hypothesis.experiment, noise, ROTATION)) == pytest.approx(3 * 0.01**2)


def test_what_a_free_force_leaves_of_positions_is_their_mean_square_about_their_mean() -> None:
    """Four frames; a force that acts in all of them moves x by a constant, one of a phase alone is not used."""
    noise, frames = 2e-3, 4
    residual = torch.zeros(1, frames, 1, 6, dtype=torch.float64)
    residual[0, :, 0, 0] = 7.0  # turns are no errors of position
    residual[0, :, 0, 3] = torch.tensor([1.0, 3.0, 5.0, 7.0])  # 4 at the mean
    residual[0, :, 0, 4] = torch.tensor([0.0, 1.0, 0.0, 0.0])
    moved = torch.zeros(2, 1, frames, 1, 6, dtype=torch.float64)
    moved[0, ..., 3], moved[1, 0, 1, 0, 4] = 1.0, 1.0
    segments = Segmentation.equal(1, frames, frames)
    (batch,) = segments.batches
    unknown, state = torch.zeros_like(moved[:1]), torch.zeros_like(moved[:1])
    state[..., 5] = 1.0
    columns = batch.columns(torch.cat([unknown, moved]))
    state = batch.columns(state)
    part = Part(batch, batch.columns(residual[None])[..., 0], state, columns, torch.linalg.cholesky(state.mT @ state))
    cells = [Cell(0, "x", piece=0), Cell(0, "y", phase="rest")]
    lack: Any = SimpleNamespace(
        fit=SimpleNamespace(linear=Linearised(segments, (part,)), residual=residual), cells=cells
    )
    spread = SimpleNamespace(residual_wrench=SimpleNamespace(spread=1e6))
    scale = torch.full_like(residual, 1 / noise)
    hypothesis: Any = SimpleNamespace(experiment=SimpleNamespace(scale=scale), settings=spread)
    left = residual_wrench_errors(lack, hypothesis, SimpleNamespace(position=noise))  # type: ignore[arg-type]
    assert left.tolist() == pytest.approx([noise**2 * (9 + 1 + 1 + 9 + 1) / frames])
