"""How well shared parameters are known: from the scatter of whole trajectories, beside what white noise would do."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physid.estimation.least_squares.normal_equations import Normal
from physid.estimation.least_squares.settings import IntervalSettings

CONFIDENCE = 0.9
DEFAULT = IntervalSettings()


def predictive_score(normal: Normal, fitted: Tensor, ridge: Tensor) -> Tensor:
    """Score how well each of R trajectories is predicted by the fitted ones without it: -2 ln of its density.

    With the normal equations A x = b of the others (and a ridge on A), the parameters are known as x +- A^-1; of a
    trajectory with the squared residual c - 2 v . x + x . N x the score is, up to a constant of the data alone,

        min over d of {c - 2 v . (x + d) + (x + d) . N (x + d) + d . A d} + ln det(1 + A^-1 N).

    What the others leave open may follow the trajectory, and is paid for by the determinant: the squared residual of
    parameters that are known, and neither a wild extrapolation nor a free fit of those that are not (Dawid 1984;
    Geisser & Eddy 1979).

    Args:
        normal: Normal equations by trajectory, at the fit.
        fitted: Which of them were fitted to, shape (R,); the fit is what these say.
        ridge: Prior of the parameters, shape (P,).

    Returns:
        Shape (R,).
    """
    known, change = _without_each(normal, fitted, ridge)
    slope = normal.vector - (normal.matrix @ change[..., None])[..., 0]
    together = known + normal.matrix
    followed = (slope * torch.linalg.solve(together, slope)).sum(-1)
    volume = torch.linalg.slogdet(together).logabsdet - torch.linalg.slogdet(known).logabsdet
    score: Tensor = normal.loss(change) - followed + volume
    return score


def left_out(normal: Normal, fitted: Tensor, ridge: Tensor) -> Tensor:
    """Return how parameters change for each trajectory if it is left out of the fitted ones, (R, P).

    Args:
        normal: Normal equations by trajectory, at the fit.
        fitted: Which of them were fitted to, shape (R,).
        ridge: Prior of the parameters, shape (P,).
    """
    return _without_each(normal, fitted, ridge)[1]


def _without_each(normal: Normal, fitted: Tensor, ridge: Tensor) -> tuple[Tensor, Tensor]:
    """Return the matrices (R, P, P) of the fitted trajectories without each, and the changes (R, P) that follow."""
    among = fitted.to(normal.matrix.dtype)
    others = among * (1 - torch.eye(len(among)).to(among))
    known = torch.einsum("rs,spq->rpq", others, normal.matrix) + torch.diag(ridge)
    wanted = others @ normal.vector * among[:, None]
    return known, torch.linalg.solve(known, wanted)


def scatter_of(normal: Normal, ridge: Tensor, settings: IntervalSettings = DEFAULT) -> tuple[Tensor, Tensor, Tensor]:
    """Estimate the covariance of the shared parameters from the scatter of whole trajectories alone.

    With A the summed matrix, L a square root, L L^T = A, G_i = L^-1 A_i L^-T and s_i the slope that trajectory i has
    left at the solution, the covariance is L^-T (sum d_i d_i^T) L^-1 with d_i = (1 - G_i)^-1/2 L^-1 s_i: right on
    average where residuals are white (CR2). Its degrees of freedom are those of the chi-square distribution that has
    the same mean and variance (Satterthwaite 1946), for residuals that are white: (tr K)^2 / tr K^2 with K the
    covariance of what the trajectories contribute; what of the trace, one, is missing counts as of one trajectory.
    Source of both: Bell & McCaffrey 2002; Imbens & Kolesar 2016.

    Args:
        normal: Normal equations by trajectory, where their sum is solved.
        ridge: Prior of the parameters, shape (P,).
        settings: When a trajectory is alone with a parameter.

    Returns:
        The covariance (P, P), degrees of freedom (P,), at least one, and the share of the variance that shows in it at
        all (P,): none where one trajectory alone says something of a parameter.
    """
    total = normal.matrix.sum(0) + torch.diag(ridge)
    if not bool(total.isfinite().all() & normal.vector.isfinite().all()):
        return torch.full_like(total, math.nan), torch.ones_like(ridge), torch.zeros_like(ridge)
    # A square root that also exists where curvatures of coarse differences, or rounding, make the matrix indefinite.
    curvature, axes = torch.linalg.eigh((total + total.mT) / 2)
    least = curvature.abs().amax() * torch.finfo(total.dtype).eps
    inverse = curvature.clamp_min(float(least)).rsqrt()[:, None] * axes.mT
    size, turned = torch.linalg.eigh(inverse @ normal.matrix @ inverse.mT)
    size = size.clamp(0, 1)
    root = turned * (1 - size).clamp_min(settings.alone).rsqrt()[:, None] @ turned.mT
    own = (root @ (inverse @ normal.vector[..., None]))[..., 0] @ inverse
    toward = root @ (inverse / inverse.square().sum(0).sqrt())
    pulled = turned * size[:, None] @ turned.mT @ toward
    each = (toward * pulled).sum(1)
    both = torch.einsum("iap,ibp->pab", pulled, pulled)
    shown = each.sum(0) - both.diagonal(dim1=1, dim2=2).sum(1)
    squared = each.square().sum(0) - 2 * (each * pulled.square().sum(1)).sum(0) + both.square().sum((1, 2))
    shown = shown.clamp(0, 1)
    freedom = 1 / (squared.clamp_min(0) + (1 - shown).square()).clamp(settings.alone, 1)
    return own.T @ own, freedom, shown


def inflation(ratio: Tensor, freedom: Tensor, settings: IntervalSettings = DEFAULT) -> Tensor:
    """Return how much larger than that of white noise the variance is to be taken, shape (P,).

    The variance is f >= 1 times that of white noise. With the probability `settings.white` f is one, else its
    density falls as f^-(1 + settings.tail). What trajectories scatter, `ratio`, says what f is: ratio / f is a mean
    square of as many standard normal variables as there are degrees of freedom. The error then is a mixture of normal
    distributions; returned is the variance of the normal distribution with the same 90 % interval. For large ratios it
    is Student's.

    Args:
        ratio: Of the variance that the scatter suggests to that of white noise, shape (P,).
        freedom: Degrees of freedom of the scatter, shape (P,).
        settings: The prior.
    """
    factor = torch.logspace(0, math.log10(settings.span), settings.points).to(ratio)
    prior = factor**-settings.tail
    prior = (1 - settings.white) * prior / prior.sum()
    prior[0] += settings.white
    exponent = prior.log() - freedom[:, None] / 2 * (factor.log() + ratio[:, None] / factor)
    weight = exponent.softmax(-1)
    low = torch.ones_like(ratio)
    high = low * settings.span
    while (high / low > 1 + settings.accuracy).any():
        middle = (low * high).sqrt()
        inside = (weight * torch.erf(middle[:, None] / (2 * factor).sqrt())).sum(-1)
        low, high = torch.where(inside < CONFIDENCE, middle, low), torch.where(inside < CONFIDENCE, high, middle)
    return (high / quantile(CONFIDENCE)).square()


def covariance_of(
    normal: Normal, ridge: Tensor, least: Tensor | None = None, settings: IntervalSettings = DEFAULT
) -> Tensor:
    """Estimate the covariance of the shared parameters, (P, P), for intervals by the normal distribution.

    Whole trajectories stand for all that disturbs them, noise, however coloured, and misfit, as long as it is
    independent between trajectories (Huber 1967, White 1982, Liang & Zeger 1986; see `scatter_of`). Few trajectories
    may agree by chance: what white noise alone would do is known beside it (see `inflation`). What all trajectories
    share, say a wrong length, does not show.

    Args:
        normal: Normal equations by trajectory, where their sum is solved.
        ridge: Prior of the parameters, shape (P,).
        least: Variances that white noise alone would cause, shape (P,). None for those of residuals in units of the
            noise.
        settings: How the two are weighed.
    """
    scatter, freedom, seen = scatter_of(normal, ridge, settings)
    if least is None:
        least = torch.linalg.inv(normal.matrix.sum(0) + torch.diag(ridge)).diagonal()
    variance = scatter.diagonal()
    shown = variance + (1 - seen) * least
    tiny = torch.finfo(least.dtype).tiny
    unit = torch.maximum(least, shown / settings.largest)
    spread = (unit * inflation(shown / unit.clamp_min(tiny), freedom, settings)).sqrt()
    correlation = scatter / torch.outer(variance, variance).clamp_min(tiny).sqrt()
    correlation.diagonal().fill_(1.0)
    covariance: Tensor = correlation * torch.outer(spread, spread)
    return covariance


def quantile(confidence: float) -> float:
    """Return within how many standard deviations a normal variable lies with that probability."""
    return math.sqrt(2) * float(torch.erfinv(torch.tensor(confidence, dtype=torch.float64)))


def reach_of(covariance: Tensor, confidence: float = CONFIDENCE) -> Tensor:
    """Return how far intervals reach to either side, (P,).

    Args:
        covariance: Of the parameters, shape (P, P).
        confidence: Share of the intervals that hold the truth.
    """
    return quantile(confidence) * covariance.diagonal().sqrt()
