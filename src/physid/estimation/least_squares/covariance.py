"""How well shared parameters are known: from what leaving out whole trajectories changes."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.estimation.least_squares.normal_equations import Normal

CONFIDENCE = 0.9


def left_out(normal: Normal, ridge: Tensor) -> Tensor:
    """Return how the shared parameters change when each of R trajectories is left out of the fit, shape (R, P)."""
    matrix = normal.matrix.sum(0) + torch.diag(ridge) - normal.matrix
    changes: Tensor = torch.linalg.solve(matrix, normal.vector.sum(0) - normal.vector)
    return changes


def covariance_of(normal: Normal, ridge: Tensor, least: Tensor | None = None) -> Tensor:
    """Estimate the covariance of the shared parameters from their changes when each trajectory is left out, (P, P).

    Whole trajectories stand for all that disturbs them, noise, however coloured, and misfit, as long as it is
    independent between trajectories (Huber 1967, White 1982, Liang & Zeger 1986), and it counts that they were fitted
    themselves (CR3: Bell & McCaffrey 2002). What all trajectories share, say a wrong length, does not show.

    Args:
        normal: Normal equations by trajectory, where their sum is solved.
        ridge: Prior of the parameters, shape (P,).
        least: Variances that white noise alone would cause, shape (P,): few trajectories may agree by chance. None for
            those of residuals in units of the noise.
    """
    changes = left_out(normal, ridge)
    robust = changes.T @ changes
    if least is None:
        least = torch.linalg.inv(normal.matrix.sum(0) + torch.diag(ridge)).diagonal()
    larger = torch.maximum(robust.diagonal(), least).sqrt()
    spread = robust.diagonal().clamp_min(1e-30).sqrt()
    covariance: Tensor = robust / spread[:, None] / spread * larger[:, None] * larger
    return covariance + torch.diag(torch.where(robust.diagonal() > 1e-30, 0.0, least))


def reach_of(covariance: Tensor, trajectories: int, confidence: float = CONFIDENCE) -> Tensor:
    """Return how far intervals reach to either side, (P,), by the distribution of few trajectories (Student 1908).

    Args:
        covariance: Of the parameters, shape (P, P).
        trajectories: From how many independent trajectories it was estimated.
        confidence: Share of the intervals that hold the truth.
    """
    from scipy.stats import t as student

    quantile = float(student.ppf((1 + confidence) / 2, max(trajectories - 1, 1)))
    return quantile * covariance.diagonal().sqrt()
