"""The linearised experiment: residuals and columns in units of the noise, with the initial states profiled out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.estimation.least_squares.jacobian import Directions, Jacobian
from physid.estimation.least_squares.settings import PriorSettings
from physid.estimation.prediction.segments import Batch, Segmentation
from physid.physics import SolverError

DEFAULT = PriorSettings()


@dataclass(frozen=True)
class Normal:
    """Normal equations of the shared columns, one per trajectory (or segment), after initial states are profiled out.

    With x the change of the shared parameters, the squared residual of trajectory r is c_r - 2 b_r . x + x . A_r x.

    Attributes:
        matrix: A, shape (R, P, P).
        vector: b, shape (R, P) or (R, P, K) for K data sets.
        square: c, shape (R,) or (R, K).
    """

    matrix: Tensor
    vector: Tensor
    square: Tensor

    def select(self, columns: Tensor) -> Normal:
        """Keep some shared columns."""
        return Normal(self.matrix[:, columns][:, :, columns], self.vector[:, columns], self.square)

    def of(self, trajectories: Tensor) -> Normal:
        """Keep some trajectories."""
        return Normal(self.matrix[trajectories], self.vector[trajectories], self.square[trajectories])

    def per(self, segments: Segmentation) -> Normal:
        """Turn what is by segment into what is by trajectory."""
        return Normal(*(segments.sum_segments(each) for each in (self.matrix, self.vector, self.square)))

    def grouped(self, index: Tensor) -> Normal:
        """Sum over what has the same index (R,): segments of one trajectory; in the order of the indices."""
        kinds, which = index.unique(return_inverse=True)

        def summed(value: Tensor) -> Tensor:
            return value.new_zeros(len(kinds), *value.shape[1:]).index_add(0, which, value)

        return Normal(*(summed(each) for each in (self.matrix, self.vector, self.square)))

    def solved(self, ridge: Tensor) -> Normal:
        """Return the normal equations after the step that solves their sum, with a ridge (P,) on it."""
        step = torch.linalg.solve(self.matrix.sum(0) + torch.diag(ridge), self.vector.sum(0))
        return Normal(self.matrix, self.vector - self.matrix @ step, self.loss(step))

    def loss(self, change: Tensor) -> Tensor:
        """Return the squared residual of each trajectory after the change (P,) or (R, P) of the shared parameters."""
        change = change.expand(self.vector.shape[0], -1)
        bent = (change[:, None] @ self.matrix @ change[..., None])[:, 0, 0]
        return self.square - 2 * (self.vector * change).sum(-1) + bent


@dataclass(frozen=True)
class Part:
    """Residuals and columns of the segments of one batch, in units of the noise.

    Attributes:
        batch: The segments.
        residual: Shape (k, M), M = L N 6.
        state: Shape (k, M, D).
        shared: Shape (k, M, P).
        factor: Cholesky factor of the state's normal matrix, shape (k, D, D).
    """

    batch: Batch
    residual: Tensor
    state: Tensor
    shared: Tensor
    factor: Tensor

    def profiled(self, columns: Tensor) -> Tensor:
        """Return columns (k, M, K) without what a change of the initial states explains."""
        return columns - self.state @ torch.cholesky_solve(self.state.mT @ columns, self.factor)


@dataclass(frozen=True)
class Linearised:
    """The linearised experiment.

    Attributes:
        segments: How trajectories are cut.
        parts: Residuals and columns, one part for each batch of segments.
    """

    segments: Segmentation
    parts: tuple[Part, ...]

    def gather(self, compute: Callable[[Part], Tensor]) -> Tensor:
        """Compute a value (k, ...) of the segments of each part and return them in order, shape (K, ...)."""
        values = [compute(part) for part in self.parts]
        whole = values[0].new_zeros(len(self.segments), *values[0].shape[1:])
        for part, value in zip(self.parts, values, strict=True):
            whole[part.batch.segments] = value
        return whole

    def observing(self, residual: Tensor, scale: Tensor) -> Linearised:
        """Return the same columns with other residuals, observed minus predicted; both have the shape (R, T, N, 6)."""
        weighed = (residual * scale)[None]
        parts = [replace(part, residual=part.batch.columns(weighed)[..., 0]) for part in self.parts]
        return Linearised(self.segments, tuple(parts))

    def normal(self, share: Tensor | None = None) -> Normal:
        """Return the normal equations of the shared columns by trajectory; segments may count by a share (K,)."""
        own = self.by_segment()
        if share is not None:
            own = Normal(share[:, None, None] * own.matrix, share[:, None] * own.vector, share * own.square)
        return own.per(self.segments)

    def by_segment(self) -> Normal:
        """Return the normal equations of the shared columns by segment."""
        clean = [part.profiled(part.shared) for part in self.parts]
        by_part = {id(part): each for part, each in zip(self.parts, clean, strict=True)}
        matrix = self.gather(lambda part: part.shared.mT @ by_part[id(part)])
        vector = self.gather(lambda part: (by_part[id(part)].mT @ part.residual[..., None])[..., 0])
        square = self.gather(lambda part: (part.residual * part.profiled(part.residual[..., None])[..., 0]).sum(1))
        return Normal(matrix, vector, square)

    def respond(self, residuals: Tensor, scale: Tensor) -> Normal:
        """Return the normal equations by trajectory for other data; see `respond_by_segment`."""
        return self.respond_by_segment(residuals, scale).per(self.segments)

    def respond_by_segment(self, residuals: Tensor, scale: Tensor) -> Normal:
        """Return the normal equations by segment for other data.

        Args:
            residuals: Observed minus predicted of Z data sets, shape (Z, R, T, N, 6).
            scale: One over the standard deviation, shape (R, T, N, 6).
        """
        matrices, vectors, squares = [], [], []
        order = torch.cat([part.batch.segments for part in self.parts]).argsort()
        for part in self.parts:
            data = part.batch.columns(residuals * scale)
            clean = part.profiled(part.shared)
            matrices.append(part.shared.mT @ clean)
            vectors.append(clean.mT @ data)
            squares.append((data * part.profiled(data)).sum(1))
        return Normal(*(torch.cat(each)[order] for each in (matrices, vectors, squares)))

    def profile(self, columns: Tensor) -> Tensor:
        """Return weighed columns (C, R, T, N, 6) without what a change of the initial states explains."""
        clean = torch.zeros_like(columns)
        for part in self.parts:
            own = part.profiled(part.batch.columns(columns)).movedim(-1, 0)
            part.batch.put(own.unflatten(2, (part.batch.frame.shape[1], *columns.shape[3:])), clean)
        return clean

    def response(self) -> Tensor:
        """Return how the best initial states follow the shared parameters, to first order, (K, D, P)."""
        return self.gather(lambda part: -torch.cholesky_solve(part.state.mT @ part.shared, part.factor))

    def state_change(self, change: Tensor, damping: Tensor) -> Tensor:
        """Return the best change of the initial states (K, D) when the shared parameters change by (P,).

        Args:
            change: Of the shared parameters.
            damping: Of each segment, relative to the diagonal (Marquardt 1963), shape (K,).
        """

        def solve(part: Part) -> Tensor:
            left = part.residual - part.shared @ change
            gram = part.factor @ part.factor.mT
            diagonal = damping[part.batch.segments, None] * gram.diagonal(dim1=-2, dim2=-1)
            moment = part.state.mT @ left[..., None]
            own: Tensor = torch.linalg.solve(gram + torch.diag_embed(diagonal), moment)[..., 0]
            return own

        return self.gather(solve)


def linearise(
    residual: Tensor,
    scale: Tensor,
    jacobian: Jacobian,
    directions: Directions,
    segments: Segmentation,
    settings: PriorSettings = DEFAULT,
) -> Linearised:
    """Bring residuals and columns into units of the noise.

    Args:
        residual: Observed minus predicted, shape (R, T, N, 6).
        scale: One over the standard deviation, 0 where there is nothing to see; shape (R, T, N, 6).
        jacobian: Change of the prediction.
        directions: Free changes of the initial states.
        segments: How trajectories are cut.
        settings: How far an initial state may move from its guess.

    Raises:
        SolverError: If the prediction, or its change, is not finite.
    """
    spread = torch.tensor([settings.state[k // 3] for _, k in directions.used], dtype=residual.dtype)
    parts = []
    for batch in segments.batches:
        state, shared = (batch.columns(columns * scale) for columns in (jacobian.state, jacobian.shared))
        gram = state.mT @ state
        if not bool(gram.isfinite().all() and shared.isfinite().all()):
            raise SolverError("prediction: expected finite changes at these states and parameters, found others")
        ridge = 1 / spread**2 + 1e-9 * gram.diagonal(dim1=-2, dim2=-1)
        factor = torch.linalg.cholesky(gram + torch.diag_embed(ridge))
        parts.append(Part(batch, batch.columns((residual * scale)[None])[..., 0], state, shared, factor))
    return Linearised(segments, tuple(parts))
