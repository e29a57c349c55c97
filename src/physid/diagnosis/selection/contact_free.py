"""Where nothing is hit: motion that the model can follow decides alone what it can decide."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from physid.diagnosis.inputs.requirements import LEAST_FITTED
from physid.diagnosis.reference.discrepancy import Say, fit_with_reference
from physid.diagnosis.reference.nominal_fit import NONE, NominalFit, begin
from physid.diagnosis.reference.null_simulations import floors
from physid.diagnosis.testing.hypothesis import Hypothesis, conclude
from physid.estimation.least_squares.levenberg_marquardt import gauss_newton
from physid.estimation.least_squares.multi_start import try_new_states
from physid.estimation.measurement.sensor_noise import frame_weights
from physid.estimation.prediction.segments import CONTACT_FREE, Segmentation

LATE = 0.05  # [s] first frames of a segment in which a late camera would still show what was before it


def contact_free(nominal_fit: NominalFit, generator: torch.Generator, say: Say = lambda _: None) -> NominalFit | None:
    """Return the same recordings with contact-free segments alone, and the nominal model fitted to these.

    After an impact the state depends on tiny differences before it: such segments outweigh, by chance and by far, what
    an effect does to a flight. What shows in contact-free segments is therefore looked for there first.

    Args:
        nominal_fit: The fitted nominal model.
        generator: Randomness of replays that tell where the numerics disturb.
        say: Called with what is being done.

    Returns:
        None where no segment is busy, or fewer fitted trajectories have contact-free segments than a diagnosis needs.
    """
    observations, noise, base = nominal_fit.observations, nominal_fit.noise, nominal_fit.fit.jacobian.base
    segments = Segmentation.around(nominal_fit.events, CONTACT_FREE, observations.scene.time_step)
    chosen = (~segments.contact).nonzero()[:, 0]
    fitted = observations.fitted[segments.trajectory[chosen].unique()]
    if len(chosen) == len(segments) or int(fitted.sum()) < LEAST_FITTED:
        return None
    say("fitting the nominal model where nothing is hit")
    predictor = nominal_fit.experiment.predictor.over(segments.only(chosen), base.state[0])
    quiet, point = begin(predictor, observations, nominal_fit.present, noise, nominal_fit.fit.point.nominal, base)
    fit = gauss_newton(quiet, point.replace(engine=nominal_fit.fit.point.engine), NONE)
    weight = frame_weights(fit.residual, nominal_fit.present, noise)
    weight = weight * _own_frames(predictor.segments, observations.scene.time_step)[..., None]
    quiet = quiet.replace(scale=weight[..., None].sqrt() / noise.spread())
    fit = quiet.linearise(fit.point, NONE)
    extra = predictor.segments.spread((1 + floors(quiet, fit, generator)).rsqrt())
    quiet, fit = fit_with_reference(quiet.replace(scale=quiet.scale * extra[..., None, None]), fit, NONE, (), say)
    return replace(nominal_fit, experiment=quiet, fit=fit)


def refit_all_segments(nominal_fit: NominalFit, best: Hypothesis) -> Hypothesis:
    """Fit unknown parameters and initial states to all segments, with the effects that contact-free segments found.

    Args:
        nominal_fit: The nominal model, fitted to all segments.
        best: The hypothesis, fitted to the contact-free ones.

    Returns:
        The hypothesis without free parameters of effects: its shared columns are the unknown parameters.
    """
    experiment, point = nominal_fit.experiment, nominal_fit.fit.point.replace(effects=best.fit.point.effects)
    fit = gauss_newton(experiment, try_new_states(experiment, point), NONE)
    experiment, fit = fit_with_reference(experiment, fit, NONE, best.names)
    return replace(conclude(experiment, fit, ()), names=best.names)


def _own_frames(segments: Segmentation, time_step: float) -> Tensor:
    """Return which frames (R, T) are of segments, but for first ones that a late camera would take from before them."""
    late = torch.where(segments.start > 0, (segments.size // 2).clamp_max(round(LATE / time_step)), 0)
    inside = segments.spread(torch.ones(len(segments), dtype=torch.bool))
    return inside & (segments.position >= segments.spread(late))
