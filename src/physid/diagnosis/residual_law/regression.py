"""Regression of what a model leaves on residual laws, beside its unknown parameters and initial states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.diagnosis.residual_law.laws import Law, over_pieces
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing import Hypothesis, LackOfFit, piece_frames
from physid.diagnosis.testing.residual_wrench import DOFS
from physid.estimation.least_squares import Linearised, Normal, left_out, predictive_score, prior


@dataclass(frozen=True)
class Columns:
    """What amplitudes of a law change: a combination of columns that are linearised.

    Attributes:
        rows: Which columns, shape (F,).
        weights: How much of each in each segment, shape (K or 1, F, B).
    """

    rows: Tensor
    weights: Tensor


@dataclass(frozen=True)
class Solution:
    """Laws that are fitted together.

    Attributes:
        score: Of the predictions of all trajectories, each from the others (see `predictive_score`), less is better.
        loss: Squared residual of these predictions.
        normal: Normal equations by trajectory, at the fit.
        ridge: Prior precision of all columns, shape (P + B,).
        sizes: Amplitudes of the laws, shape (B,).
    """

    score: float
    loss: float
    normal: Normal
    ridge: Tensor
    sizes: Tensor


class Regression:
    """What a hypothesis leaves, linearised with residual wrenches and shifts.

    A wrench that changes slowly acts as its means over the pieces of time of `LackOfFit.cells` do. With a prediction y
    that is linear in these, in unknown parameters and in initial states, a law's amplitudes are fitted by the normal
    equations of combinations of columns: no law costs a simulation.

    Args:
        hypothesis: The model.
        lack: What it leaves, linearised with the wrenches of pieces of time.
        laws: All that will be asked for.
    """

    def __init__(self, hypothesis: Hypothesis, lack: LackOfFit, laws: Sequence[Law]) -> None:
        experiment, linear = hypothesis.experiment, lack.fit.linear
        self.fitted = experiment.fitted
        self.settings: Settings = hypothesis.settings
        self._segments = experiment.predictor.segments
        self._frame = experiment.directions.frame
        offset = lack.fit.point.nominal.shape[1] + 1
        self._nuisance = torch.cat([torch.arange(offset), offset + hypothesis.columns])
        self._prior = prior(experiment, hypothesis.columns)
        first = linear.parts[0].shared.shape[-1] - len(lack.cells)
        free = [k for k, cell in enumerate(lack.cells) if cell.piece is not None]
        cells = [lack.cells[k] for k in free]
        self._places = [(cell.piece or 0, cell.body, DOFS.index(cell.dof)) for cell in cells]
        kept = torch.cat([self._nuisance, first + torch.tensor(free)])
        shifts = [law for law in laws if law.direction.kind == "shift"]
        patterns = [law.direction.value[..., None] * law.basis()[..., None, :] for law in shifts]
        self._shift_places: dict[int, int] = {}
        place = len(kept)
        for law in shifts:
            self._shift_places[id(law)] = place
            place += len(law.knots)
        own = _with(linear, kept, patterns, experiment.scale).by_segment()
        sound = lack.sound.to(own.matrix)
        self._own = Normal(sound[:, None, None] * own.matrix, sound[:, None] * own.vector, sound * own.square)
        states = experiment.directions.free.flatten(1).sum(1)
        self.expected = float(((experiment.counted() - states).clamp_min(0) * sound).sum())
        seen = (experiment.scale[..., 0] > 0).any(2)[None].double()
        self.frames = max(float((self._segments.sum_frames(seen)[0] * sound).sum()), 1.0)
        step = experiment.predictor.model.scene.time_step
        frames = piece_frames(self.settings.residual_wrench.piece_time, step)
        self._piece = self._segments.position // frames
        inside = self._segments.spread(torch.ones(len(self._segments), dtype=torch.bool))
        index = self._segments.spread(torch.arange(len(self._segments)))
        self._owner = torch.where(inside, index, -1)
        scene = experiment.predictor.model.scene
        weight = sum(body.mass for body in scene.bodies) * torch.tensor(scene.gravity).norm()
        size = float(scene.sizes.max())
        self._spread = {"force": float(weight), "torque": float(weight) * size, "shift": size}

    def columns(self, law: Law) -> Columns:
        """Return what the amplitudes of a law change [N, N m, m]."""
        count = len(self._nuisance)
        if law.direction.kind == "shift":
            rows = self._shift_places[id(law)] + torch.arange(len(law.knots))
            return Columns(rows, torch.eye(len(law.knots), dtype=torch.float64)[None])
        units = self.settings.residual_wrench
        pieces = int(self._piece.max()) + 1
        mean = over_pieces(law, self._piece, pieces, self._owner, len(self._segments), self._frame)
        index = [torch.tensor([one[k] for one in self._places]) for k in range(3)]
        picked = mean[:, index[0], index[1], index[2]]
        unit = torch.where(index[2] < DOFS.index("x"), units.torque, units.force)
        return Columns(count + torch.arange(len(index[2])), picked / unit[:, None])

    def solve(self, laws: Sequence[Law]) -> Solution:
        """Fit laws together with the unknown parameters, to the fitted trajectories."""
        own, chosen, count = self._own, [self.columns(law) for law in laws], len(self._nuisance)
        wide = torch.cat([own.matrix[..., :count], *(own.matrix[..., one.rows] @ one.weights for one in chosen)], -1)
        matrix = torch.cat([wide[:, :count], *(one.weights.mT @ wide[:, one.rows] for one in chosen)], 1)
        vectors = ((one.weights.mT @ own.vector[:, one.rows, None])[..., 0] for one in chosen)
        normal = Normal(matrix, torch.cat([own.vector[:, :count], *vectors], 1), own.square).per(self._segments)
        spread = [self._spread[law.direction.kind] for law in laws for _ in law.knots]
        ridge = torch.cat([self._prior, torch.tensor(spread, dtype=torch.float64) ** -2])
        among = normal.of(self.fitted)
        step = torch.linalg.solve(among.matrix.sum(0) + torch.diag(ridge), among.vector.sum(0))
        there = Normal(normal.matrix, normal.vector - (normal.matrix @ step), normal.loss(step))
        score = float(predictive_score(there, self.fitted, ridge).sum())
        loss = float(there.loss(left_out(there, self.fitted, ridge)).sum())
        return Solution(score, loss, there, ridge, step[count:])


def _with(linear: Linearised, kept: Tensor, patterns: Sequence[Tensor], scale: Tensor) -> Linearised:
    """Keep some shared columns, and add what shifts (R, T, N, 6, B) of reported positions change."""
    extra = torch.cat([pattern.movedim(-1, 0) for pattern in patterns]) * scale if patterns else None
    parts = []
    for part in linear.parts:
        columns = [part.shared[..., kept]]
        if extra is not None:
            columns.append(part.batch.columns(extra))
        parts.append(replace(part, shared=torch.cat(columns, -1)))
    return Linearised(linear.segments, tuple(parts))
