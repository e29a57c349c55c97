"""A residual wrench that is free to be anything: by pieces of time, or in one phase only."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.diagnosis.settings.testing import ResidualWrenchSettings
from physid.estimation.least_squares import Fit, Linearised, Part
from physid.estimation.prediction import Segmentation
from physid.estimation.segmented_fit import PHASES


@dataclass(frozen=True)
class Cell:
    """Where a residual wrench may act.

    Attributes:
        body: Index of the body.
        dof: x, y, z, rx, ry or rz, in the axes of the ground.
        phase: A name of PHASES, or None for a piece of time.
        piece: Which piece of its segment, or None for a phase.
    """

    body: int
    dof: str
    phase: str | None = None
    piece: int | None = None


def piece_frames(piece_time: float, time_step: float) -> int:
    """Return the frames of one piece of a residual wrench."""
    return max(2, round(piece_time / time_step))


DOFS = ("rx", "ry", "rz", "x", "y", "z")
PLANAR = ("rz", "x", "y")


def residual_wrenches(
    phases: Tensor,
    frame: Tensor,
    planar: bool,
    segments: Segmentation,
    time_step: float,
    settings: ResidualWrenchSettings,
) -> tuple[list[Cell], Tensor]:
    """List residual wrenches of unit size; phases that are seldom within segments have none.

    Args:
        phases: Codes of PHASES, shape (R, T, N).
        frame: Axes of the ground (tangent, tangent, normal), rows of (3, 3).
        planar: Whether bodies stay on the ground, so that only motion in its plane is of interest.
        segments: How trajectories are cut.
        time_step: [s] between frames.
        settings: Their units, and how long a piece is.

    Returns:
        The cells, and their wrenches, shape (F, R, T, N, 6).
    """
    bodies = phases.shape[2]
    inside = segments.spread(torch.ones(len(segments), dtype=torch.bool))
    piece = segments.position // piece_frames(settings.piece_time, time_step)
    pieces = int(piece.max()) + 1
    cells: list[Cell] = []
    masks: list[Tensor] = []
    for body in range(bodies):
        share = torch.bincount(phases[:, :, body][inside], minlength=len(PHASES)) / inside.sum()
        for dof in PLANAR if planar else DOFS:
            for k in range(pieces):
                cells.append(Cell(body, dof, piece=k))
                masks.append(piece == k)
            for code in (share > settings.seldom).nonzero()[:, 0].tolist():
                cells.append(Cell(body, dof, phase=PHASES[code]))
                masks.append(phases[:, :, body] == code)
    wrench = torch.zeros(len(cells), *phases.shape, 6, dtype=torch.float64)
    for row, (cell, mask) in enumerate(zip(cells, masks, strict=True)):
        k = DOFS.index(cell.dof)
        wrench[row, :, :, cell.body, 3 * (k // 3) : 3 * (k // 3) + 3] = (
            mask[..., None] * frame[k % 3] * (settings.force if k >= 3 else settings.torque)
        )
    return cells, wrench


def local_gain(
    linear: Linearised, columns: Tensor, spread: float, residuals: Tensor | None = None, scale: Tensor | None = None
) -> Tensor:
    """Compute what columns explain when each segment has its own amplitudes.

    Args:
        linear: The linearised experiment.
        columns: Shared columns to free, shape (F,).
        spread: Prior standard deviation of an amplitude.
        residuals: Other data, shape (Z, R, T, N, 6), with `scale`; None for the observed ones.
        scale: One over the standard deviation, shape (R, T, N, 6).

    Returns:
        Explained squared residual of each segment, shape (K, Z).
    """

    def explain(part: Part) -> Tensor:
        data = _data(part, residuals, scale)
        clean = part.profiled(part.shared[..., columns])
        gram = clean.mT @ clean + torch.eye(len(columns), dtype=clean.dtype) / spread**2
        moment = clean.mT @ data
        gain: Tensor = (moment * torch.linalg.solve(gram, moment)).sum(1)
        return gain

    return linear.gather(explain)


def gain_alone(
    linear: Linearised, columns: Tensor, spread: float, residuals: Tensor | None = None, scale: Tensor | None = None
) -> Tensor:
    """Compute what each column explains alone when each segment has its own amplitude; see `local_gain`.

    Returns:
        Explained squared residual of each segment, shape (K, F, Z).
    """

    def explain(part: Part) -> Tensor:
        clean = part.profiled(part.shared[..., columns])
        gram = clean.square().sum(1) + 1 / spread**2
        moment: Tensor = clean.mT @ _data(part, residuals, scale)
        return moment.square() / gram[..., None]

    return linear.gather(explain)


def _data(part: Part, residuals: Tensor | None, scale: Tensor | None) -> Tensor:
    """Return the observed residuals of a part, or others, in units of the noise, shape (k, M, Z)."""
    if residuals is None or scale is None:
        return part.residual[..., None]
    return part.batch.columns(residuals * scale)


def freed(fit: Fit, columns: Tensor, spread: float) -> Tensor:
    """Return the residuals, in units of the noise, that are left when each segment has its own amplitudes of columns.

    Args:
        fit: A linearised experiment.
        columns: Shared columns to free, shape (F,).
        spread: Prior standard deviation of an amplitude.

    Returns:
        Shape (R, T, N, 6).
    """
    left = torch.zeros_like(fit.residual)[None]
    for part in fit.linear.parts:
        clean = part.profiled(part.shared[..., columns])
        gram = clean.mT @ clean + torch.eye(len(columns), dtype=clean.dtype) / spread**2
        data = part.profiled(part.residual[..., None])
        rest = data - clean @ torch.linalg.solve(gram, clean.mT @ data)
        part.batch.put(rest[..., 0].unflatten(1, (-1, *fit.residual.shape[2:]))[None], left)
    return left[0]
