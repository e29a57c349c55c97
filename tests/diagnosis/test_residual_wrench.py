"""What residual wrenches explain, against closed forms."""

from __future__ import annotations

import pytest
import torch

from physid.diagnosis.testing.residual_wrench import gain_alone, local_gain
from physid.estimation.least_squares.normal_equations import Linearised, Part
from physid.estimation.prediction.segments import Segmentation

SPREAD = 100.0
FRAMES, BODIES, COLUMNS, DRAWS = 12, 2, 5, 3


@pytest.fixture
def linear() -> Linearised:
    generator = torch.Generator().manual_seed(0)
    segments = Segmentation.equal(2, FRAMES, 6)
    parts = []
    for batch in segments.batches:
        count, rows = batch.frame.numel() // batch.frame.shape[1], batch.frame.shape[1] * BODIES * 6
        residual = torch.randn(count, rows, generator=generator).double()
        state, shared = (torch.randn(count, rows, width, generator=generator).double() for width in (4, COLUMNS))
        factor = torch.linalg.cholesky(state.mT @ state)
        parts.append(Part(batch, residual, state, shared, factor))
    return Linearised(segments, tuple(parts))


def test_a_column_explains_its_projection_after_initial_states(linear: Linearised) -> None:
    part = linear.parts[0]
    clean, data = part.profiled(part.shared)[0, :, 2], part.residual[0]
    wanted = float((clean @ data) ** 2 / (clean @ clean + 1 / SPREAD**2))
    assert float(gain_alone(linear, torch.arange(COLUMNS), SPREAD)[part.batch.segments[0], 2, 0]) == pytest.approx(
        wanted
    )


def test_columns_alone_explain_what_each_explains_without_the_others(linear: Linearised) -> None:
    columns = torch.arange(COLUMNS)
    data = torch.randn(DRAWS, 2, FRAMES, BODIES, 6, generator=torch.Generator().manual_seed(1)).double()
    scale = torch.ones_like(data[0])
    for given in ((), (data, scale)):
        together = gain_alone(linear, columns, SPREAD, *given)
        for column in columns:
            alone = local_gain(linear, column[None], SPREAD, *given)
            torch.testing.assert_close(together[:, column], alone, rtol=1e-9, atol=1e-12)
