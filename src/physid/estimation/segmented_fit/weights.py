"""How much frames and segments count in a fit: by noise, by how far they stand out, by what they leave unexplained."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.estimation.least_squares import Experiment, Fit
from physid.estimation.measurement import Noise, NoiseSettings, TrackingError, estimate_noise, frame_weights
from physid.estimation.prediction import Segmentation


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
