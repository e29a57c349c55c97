"""The nominal fit follows the reference simulator, and counts each segment by how far both can be told apart there."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.diagnosis.progress import Progress
from physid.diagnosis.reference.discrepancy import between, fit_with_reference
from physid.diagnosis.reference.numerics import count_numerics
from physid.diagnosis.settings.settings import Settings
from physid.estimation.least_squares import NONE, Experiment, Fit
from physid.estimation.measurement import Noise, TrackingError
from physid.estimation.prediction import Segmentation
from physid.estimation.segmented_fit import own_weights, usual_misfit, weighed


def fit_beside_references(
    experiment: Experiment,
    alone: Fit,
    present: Tensor,
    error: TrackingError | None,
    settings: Settings,
    generator: torch.Generator,
    say: Progress,
) -> tuple[Experiment, Fit, Noise, Settings]:
    """Follow the reference simulator from a fit without it, where its steps are known, and see what numerics do.

    Returns:
        The experiment, the fit, the noise, and the settings with the reference simulators that count from here on.
    """
    experiment, fit, noise = follow(experiment, alone, present, error, settings, say)
    experiment, fit, settings = count_numerics(experiment, fit, settings, generator, say)
    return experiment, fit, noise, settings


def follow(
    experiment: Experiment,
    alone: Fit,
    present: Tensor,
    error: TrackingError | None,
    settings: Settings,
    say: Progress,
) -> tuple[Experiment, Fit, Noise]:
    """Follow the reference simulator from a fit without it; give up the contact segments in which that fails.

    After an impact the state depends on tiny differences before it, so that in some segments no initial state makes the
    other engine go where the recording went. They return to their fit without it, and `floors` tells how little they
    count.
    """
    segments = experiment.predictor.segments
    rounds, limits = settings.nominal_fit, settings.discrepancy
    noise, experiment = weighed(experiment, alone, present, error, settings.noise, robust=rounds.robust)
    if experiment.predictor.model.scene.integration is None or not limits.follows:
        # Steps are fine, and no simulator is nearer to the recordings than the model itself.
        own = _own_scale(segments, experiment.misfit(alone.point), segments.contact & rounds.own_weights)
        experiment = experiment.replace(scale=experiment.scale * own, follow=torch.zeros_like(experiment.follow))
        return experiment, experiment.linearise(alone.point, NONE), noise
    own = _own_scale(segments, experiment.misfit(alone.point), segments.contact & rounds.own_weights)
    fit = experiment.linearise(alone.point.replace(engine=torch.ones_like(alone.point.engine)), NONE)
    followed, fit = fit_with_reference(experiment.replace(scale=experiment.scale * own), fit, NONE, (), settings, say)
    misfit = experiment.replace(engine=followed.engine).misfit(fit.point)
    lost = segments.contact & (misfit > limits.lost * usual_misfit(segments, misfit))
    point = between(alone.point, fit.point, (~lost).double())
    engine = torch.where(segments.spread(lost)[..., None, None], torch.zeros((), dtype=torch.float64), followed.engine)
    experiment = experiment.replace(follow=~lost, engine=engine)
    fit = experiment.linearise(point, NONE)
    noise, experiment = weighed(experiment, fit, present, error, settings.noise, robust=rounds.robust)
    own = _own_scale(segments, experiment.misfit(fit.point), lost & rounds.own_weights)
    experiment = experiment.replace(scale=experiment.scale * own)
    return experiment, experiment.linearise(point, NONE), noise


def _own_scale(segments: Segmentation, misfit: Tensor, doubtful: Tensor) -> Tensor:
    """Return the roots of the weights of segments (see `own_weights`) at each frame, shape (R, T, 1, 1)."""
    return segments.spread(own_weights(misfit, usual_misfit(segments, misfit), doubtful).sqrt())[..., None, None]
