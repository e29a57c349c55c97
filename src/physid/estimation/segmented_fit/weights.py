"""How much frames and segments count in a fit: by noise, by how far they stand out, by what they leave unexplained."""

from __future__ import annotations

import torch
from scipy.stats import chi2
from torch import Tensor

from physid.estimation.least_squares import Experiment, Fit, Normal
from physid.estimation.measurement import (
    Noise,
    NoiseSettings,
    TrackingError,
    correlated_noise,
    estimate_noise,
    frame_weights,
)
from physid.estimation.prediction import Segmentation
from physid.estimation.segmented_fit.settings import AgreementSettings


def weighed(
    experiment: Experiment,
    fit: Fit,
    present: Tensor,
    error: TrackingError | None,
    settings: NoiseSettings,
    *,
    robust: bool,
) -> tuple[Noise, Experiment]:
    """Estimate the noise from the residuals of a fit, and weigh its frames.

    Args:
        experiment: What was fitted.
        fit: The fit.
        present: Frames that exist and are not outliers, shape (R, T, N).
        error: That of poses which were read from films.
        settings: Of the noise.
        robust: Whether frames count less that stand alone (see `frame_weights`).
    """
    noise = estimate_noise(fit.residual, present, error, settings)
    if error is None:
        scene, predicted = experiment.predictor.model.scene, fit.jacobian.base.pose[0]
        up = scene.ground.normal
        noise = noise.of_tracker(correlated_noise(fit.residual, predicted, present, scene.time_step, up, settings))
    weight = weights_of_frames(experiment, fit, present, noise, settings, robust=robust)
    return noise, experiment.replace(scale=weight[..., None].sqrt() / noise.spread())


def weights_of_frames(
    experiment: Experiment, fit: Fit, present: Tensor, noise: Noise, settings: NoiseSettings, *, robust: bool
) -> Tensor:
    """Return how much frames count, 0 to 1, shape (R, T, N): those that are present, less where they stand alone.

    Args:
        experiment: What was fitted.
        fit: The fit.
        present: Frames that exist and are not outliers, shape (R, T, N).
        noise: Of the poses.
        settings: Beyond which a frame counts less.
        robust: Whether frames count less that stand alone (see `frame_weights`); else they count as they are present.
    """
    time = experiment.predictor.timeline.time
    return frame_weights(fit.residual, present, time, noise, settings) if robust else present


def own_weights(misfit: Tensor, usual: Tensor, doubtful: Tensor) -> Tensor:
    """Return how much segments (K,) count if doubtful ones do as if their noise were as large as their misfit, (K,).

    With m the mean squared residual of a segment in units of the noise and u the usual one, a doubtful segment counts
    min(1, u / m), any other 1. In some segments with impacts no initial state is found that explains them.

    Args:
        misfit: m, shape (K,).
        usual: u, shape ().
        doubtful: Which are, shape (K,).
    """
    own = torch.where(doubtful, usual / misfit.clamp_min(1e-9), torch.ones_like(misfit))
    return own.clamp_max(1)


def usual_misfit(segments: Segmentation, misfit: Tensor) -> Tensor:
    """Return the median misfit of contact segments, at least 1: what an effect does to all of them is usual."""
    contact = misfit[segments.contact]
    return contact.median().clamp_min(1) if len(contact) else torch.ones((), dtype=misfit.dtype)


def agreed_weights(normal: Normal, settings: AgreementSettings) -> Tensor:
    """Return how much trajectories or segments (K,) count if none says more of a parameter than they agree on.

    After an impact on a corner a trajectory has many narrow valleys. In a wrong one it says little but claims much: its
    curvature A_i may be 10^5 times that of the others, and its parameters are theirs no more. So the parameters of each
    are taken for those of all plus a deviation of its own, of the variances T = diag(t^2), which have the largest
    restricted likelihood (random effects; Patterson & Thompson 1971),

        -2 ln L = sum_i {L_i(x) - s_i (A_i + T^-1)^-1 s_i + ln det(1 + A_i T)} + ln det sum_i A_i',
        A_i' = A_i - A_i (A_i + T^-1)^-1 A_i,

    with the squared residual L_i, its slope s_i = b_i - A_i x, and x that solves sum_i A_i' A_i^-1 s_i = 0. Whichever
    knows more than that counts as if it did not: w_i = 1 / (1 + the largest eigenvalue of A_i T), so that w_i A_i is at
    most A_i'. All count 1 where T = 0 explains them too (a likelihood ratio within the quantile of chi-square).

    Args:
        normal: Normal equations of each, in units of the noise; nothing is known of a parameter whose A is zero.
        settings: How improbable a disagreement must be, and which deviations are tried.
    """
    weight = normal.matrix.new_ones(len(normal.matrix))
    normal = normal.select(normal.matrix.sum(0).diagonal() > 0)
    count = normal.matrix.shape[-1]
    if not count:
        return weight
    deviation = normal.matrix.new_zeros(count)
    agreed = least = float(_disagreement(normal, deviation[None]))
    tried = torch.cat([deviation[:1], torch.logspace(*settings.deviations, settings.tries).to(deviation)])
    for _ in range(settings.sweeps):
        for k in range(count):
            several = deviation.repeat(len(tried), 1)
            several[:, k] = tried
            found = _disagreement(normal, several)
            least, deviation = float(found.amin()), several[found.argmin()]
    if agreed - least <= chi2.isf(settings.chance, count):
        return weight
    known: Tensor = torch.linalg.eigvalsh(deviation[:, None] * normal.matrix * deviation).amax(-1)
    return 1 / (1 + known.clamp_min(0))


def _disagreement(normal: Normal, deviation: Tensor) -> Tensor:
    """Return -2 ln L of D deviations (D, P), up to a constant, shape (D,)."""
    spread = deviation[:, None, :, None]
    own = torch.eye(deviation.shape[1]).to(deviation) + spread * normal.matrix * spread.mT
    inner = spread * torch.linalg.inv(own) * spread.mT  # (A + T^-1)^-1, shape (D, K, P, P)
    shared = normal.matrix @ inner
    total = (normal.matrix - shared @ normal.matrix).sum(1)
    rounding = torch.finfo(total.dtype).eps  # where only a sum of parameters is known
    total = total + rounding * torch.diag_embed(total.diagonal(dim1=1, dim2=2))
    left = (normal.vector - (shared @ normal.vector[..., None])[..., 0]).sum(1)
    change = torch.linalg.solve(total, left)
    slope = normal.vector - (normal.matrix @ change[:, None, :, None])[..., 0]
    square = normal.square - ((normal.vector + slope) * change[:, None]).sum(-1)
    explained = (slope * (inner @ slope[..., None])[..., 0]).sum(-1)
    known: Tensor = torch.linalg.slogdet(own).logabsdet.sum(1) + torch.linalg.slogdet(total).logabsdet
    likelihood: Tensor = ((square - explained).sum(1) + known).nan_to_num(nan=torch.inf)
    return likelihood
