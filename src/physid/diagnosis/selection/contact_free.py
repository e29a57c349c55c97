"""Contact-free segments: motion that the model can follow decides alone what it can decide."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from physid.diagnosis.progress import Progress, Stage, silent
from physid.diagnosis.reference.discrepancy import fit_with_reference
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.reference.null_simulations import floors
from physid.diagnosis.testing import Hypothesis, conclude
from physid.estimation.least_squares import NONE, choose_steps, gauss_newton, try_new_states
from physid.estimation.prediction import Segmentation, acts_late
from physid.estimation.segmented_fit import begin, weights_of_frames, without_outliers


def contact_free(nominal_fit: NominalFit, generator: torch.Generator, say: Progress = silent) -> NominalFit | None:
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
    settings = nominal_fit.settings
    observations, noise, base = nominal_fit.observations, nominal_fit.noise, nominal_fit.fit.jacobian.base
    segments = Segmentation.around(nominal_fit.events, settings.segments.contact_free, observations.scene.time_step)
    chosen = (~segments.contact).nonzero()[:, 0]
    fitted = observations.fitted[segments.trajectory[chosen].unique()]
    if len(chosen) == len(segments) or int(fitted.sum()) < settings.requirements.least_fitted:
        return None
    say(Stage.FITTING_CONTACT_FREE)
    predictor = nominal_fit.experiment.predictor.over(segments.only(chosen), base.state[0])
    observed = without_outliers(observations, settings.noise)
    quiet, point = begin(predictor, observed, noise, settings.least_squares, nominal_fit.fit.point.nominal, base)
    fit = gauss_newton(quiet, point.replace(engine=nominal_fit.fit.point.engine), NONE)
    robust = settings.nominal_fit.robust
    weight = weights_of_frames(quiet, fit, observed.present, noise, settings.noise, robust=robust)
    late = round(settings.contact_free.late / observations.scene.time_step)
    weight = weight * _own_frames(predictor.segments, late)[..., None]
    quiet = quiet.replace(scale=weight[..., None].sqrt() / noise.spread())
    fit = quiet.linearise(fit.point, NONE)
    extra = predictor.segments.spread((1 + floors(quiet, fit, settings, generator)).rsqrt())
    quiet = quiet.replace(scale=quiet.scale * extra[..., None, None])
    quiet, fit = fit_with_reference(quiet, fit, NONE, (), settings, say)
    return replace(nominal_fit, experiment=quiet, fit=fit)


def refit_all_segments(nominal_fit: NominalFit, best: Hypothesis) -> Hypothesis:
    """Fit a hypothesis to all segments: effects that contact-free ones found, unknown parameters and initial states.

    Effects and unknown parameters are fitted together: what is not known of one is not known of the other.

    Args:
        nominal_fit: The nominal model, fitted to all segments.
        best: The hypothesis, fitted to the contact-free ones.
    """
    experiment = nominal_fit.experiment.for_effects(best.columns)
    point = nominal_fit.fit.point.replace(effects=best.fit.point.effects)
    fit = gauss_newton(experiment, try_new_states(experiment, point), NONE)
    fit = gauss_newton(experiment, fit.point, best.columns)
    experiment, fit = fit_with_reference(experiment, fit, best.columns, best.names, best.settings)
    return conclude(experiment, fit, best.names, best.settings)


def with_own_steps(nominal_fit: NominalFit, one: Hypothesis) -> Hypothesis:
    """Fit a hypothesis again with the steps that it needs itself, where nobody says how recordings were integrated.

    Steps were chosen by the nominal model, whose misfit hides what they change; an effect that explains that has
    standard errors of which the same steps may change much. Where somebody says, replays in the steps of that simulator
    have accounted for what longer ones miss.

    Args:
        nominal_fit: The nominal model, and the steps that it chose.
        one: A hypothesis, fitted; one with an effect that acts late has short steps already, and is returned as it is.
    """
    predictor = one.experiment.predictor
    if nominal_fit.steps is None or predictor.model.made_in is not None:
        return one
    if any(acts_late(predictor.terms[k].effect) for k in one.columns.tolist()):
        return one
    base, first = nominal_fit.observations.timeline, nominal_fit.steps.parts
    chosen = choose_steps(one.experiment, one.fit, base, one.settings.steps, first)
    if torch.equal(chosen.parts, first):
        return one
    experiment = one.experiment.replace(predictor=predictor.at_times(chosen.timeline))
    return conclude(experiment, gauss_newton(experiment, one.fit.point, one.columns), one.names, one.settings)


def _own_frames(segments: Segmentation, late: int) -> Tensor:
    """Return which frames (R, T) are of segments, but for so many that a late camera would take from before them."""
    left = torch.where(segments.start > 0, (segments.size // 2).clamp_max(late), 0)
    inside = segments.spread(torch.ones(len(segments), dtype=torch.bool))
    return inside & (segments.position >= segments.spread(left))
