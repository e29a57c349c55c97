"""What residual wrenches explain, against closed forms."""

from __future__ import annotations

import pytest
import torch

from physid.diagnosis.settings.testing import ResidualWrenchSettings
from physid.diagnosis.testing.residual_wrench import (
    DOFS,
    PLANAR,
    gain_alone,
    local_gain,
    piece_frames,
    residual_wrenches,
)
from physid.estimation.least_squares.normal_equations import Linearised, Part
from physid.estimation.prediction.segments import Segmentation
from physid.estimation.segmented_fit.motion_phases import PHASES

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


def test_a_piece_of_a_residual_wrench_lasts_as_long_at_any_rate_and_two_frames_at_least() -> None:
    assert [piece_frames(0.5, 1 / rate) for rate in (240, 60, 2)] == [120, 30, 2]


@pytest.mark.parametrize("planar", [True, False])
def test_residual_wrenches_are_unit_forces_and_torques_along_the_axes_of_the_ground(planar: bool) -> None:
    settings, segments = ResidualWrenchSettings(), Segmentation.equal(2, FRAMES, FRAMES)
    frame = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(2)).double()).Q
    phases = torch.full((2, FRAMES, BODIES), PHASES.index("slide_fast"))
    cells, wrench = residual_wrenches(phases, frame, planar, segments, 1 / FRAMES, settings)
    assert {cell.dof for cell in cells} == set(PLANAR if planar else DOFS)
    for cell, one in zip(cells, wrench, strict=True):
        turn, axis = cell.dof.startswith("r"), "xyz".index(cell.dof[-1])
        unit = frame[axis] * (settings.torque if turn else settings.force)
        there = (one != 0).any(-1)
        assert not there[:, :, 1 - cell.body].any(), "on one body"
        at = one[there]
        assert torch.allclose(at[:, :3] if turn else at[:, 3:], unit.expand(len(at), 3))
        assert not (at[:, 3:] if turn else at[:, :3]).any()
        assert there.sum() == (2 * FRAMES if cell.phase else 2 * piece_frames(settings.piece_time, 1 / FRAMES))


def test_the_pieces_of_a_residual_wrench_cover_every_frame_once() -> None:
    settings, segments = ResidualWrenchSettings(), Segmentation.equal(2, FRAMES, FRAMES)
    phases = torch.full((2, FRAMES, BODIES), PHASES.index("slide_fast"))
    cells, wrench = residual_wrenches(phases, torch.eye(3).double(), True, segments, 1 / FRAMES, settings)
    for body in range(BODIES):
        for dof in PLANAR:
            pieces = [k for k, one in enumerate(cells) if one.piece is not None and (one.body, one.dof) == (body, dof)]
            assert len(pieces) > 1
            assert ((wrench[pieces][:, :, :, body] != 0).any(-1).sum(0) == 1).all()


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
    once, twice = (gain_alone(linear, columns, SPREAD, factor * data, scale) for factor in (1.0, 2.0))
    torch.testing.assert_close(twice, 4 * once)
    torch.testing.assert_close(gain_alone(linear, columns, SPREAD, 2 * data, scale / 2), once)
