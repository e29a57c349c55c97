"""From poses to parameters and initial states over segments that are cut around impacts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.estimation.least_squares import (
    NONE,
    ChosenSteps,
    Experiment,
    Fit,
    LeastSquaresSettings,
    best_guess,
    choose_steps,
    gauss_newton,
    lay_out,
    parts_for_late_forces,
    search,
)
from physid.estimation.measurement import Noise, estimate_noise
from physid.estimation.prediction import (
    Prediction,
    Predictor,
    Segmentation,
    Variants,
    acts_late,
)
from physid.estimation.segmented_fit.events import find_events, find_tumbling, smooth_path
from physid.estimation.segmented_fit.motion_phases import phases_of
from physid.estimation.segmented_fit.observed import Observed, Recorded, without_outliers
from physid.estimation.segmented_fit.settings import SegmentedFitSettings
from physid.estimation.segmented_fit.weights import weighed


@dataclass(frozen=True)
class SegmentedFit:
    """A model that is fitted to segments of trajectories, each with an initial state of its own.

    Attributes:
        observed: What was recorded, without outliers: poses that no motion explains, and those that stand alone off the
            fit.
        seen: Frames that exist and that some motion explains, shape (R, T, N).
        experiment: Model, segments and weights.
        fit: The fit.
        noise: White noise of the poses.
        events: Frames that the segments are cut around, shape (R, T).
        steps: The steps of the engine that were chosen; None where they were not.
    """

    observed: Observed
    seen: Tensor
    experiment: Experiment
    fit: Fit
    noise: Noise
    events: Tensor
    steps: ChosenSteps | None = None


def fit_short_segments(recorded: Recorded, predictor: Predictor, settings: SegmentedFitSettings) -> SegmentedFit:
    """Fit equal short segments: errors have no time to grow in them, wherever impacts are.

    Frames that stand alone off the fit (see `frame_weights`) are left out, and segments are fitted again: a pose that
    is a few millimetres off changes velocities as an impact does, and impacts are sought next.

    Args:
        recorded: What was recorded.
        predictor: The model whose unknown parameters are fitted, in the first steps of the engine; its candidate
            effects are null.
        settings: What decides.

    Returns:
        The fit with the noise that its residuals show, without outliers and without events yet.

    Raises:
        SolverError: If the physics has no solution at the first guess.
    """
    observed, own = without_outliers(recorded, settings.noise), settings.rounds
    trajectories, frames = observed.pose.shape[:2]
    length = settings.first_guess.length(predictor.model.scene.time_step)
    predictor = predictor.over(Segmentation.equal(trajectories, frames, min(length, frames)))
    start = Noise(own.first_rotation_noise, own.first_position_noise)
    experiment, point = begin(predictor, observed, start, settings.least_squares)
    first = settings.first_guess.fit(experiment, point)
    noise = estimate_noise(first.residual, observed.present, observed.error, settings.noise)
    events = torch.zeros(trajectories, frames, dtype=torch.bool)
    found = SegmentedFit(observed, observed.present, experiment, first, noise, events)
    for _ in range(own.outlier_rounds if own.robust else 0):
        before, found = found, _without_frames_that_stand_alone(found, settings)
        if found is before:
            break
    return found


def _without_frames_that_stand_alone(found: SegmentedFit, settings: SegmentedFitSettings) -> SegmentedFit:
    """Leave out frames that stand alone off a fit and fit the others again; return the same where there are none."""
    before = found.observed.present
    noise, experiment = weighed(found.experiment, found.fit, before, found.observed.error, settings.noise, robust=True)
    observed = _counted(found.observed, before, experiment)
    if torch.equal(observed.present, before):
        return found
    fit = gauss_newton(experiment, found.fit.point, NONE, settings.first_guess.steps)
    noise = estimate_noise(fit.residual, observed.present, observed.error, settings.noise)
    return replace(found, observed=observed, experiment=experiment, fit=fit, noise=noise)


def _counted(observed: Observed, present: Tensor, experiment: Experiment) -> Observed:
    """Return what was observed in those of some frames (R, T, N) that have a weight in an experiment."""
    return replace(observed, present=present * (experiment.scale > 0).any(-1))


def fit_around_events(before: SegmentedFit, settings: SegmentedFitSettings) -> SegmentedFit:
    """Fit segments cut around events, which a fit shows; cut again if the new fit shows others.

    Bodies that pass each other closely may hit each other in a fit to a long segment that is a little off: no step
    leads back from there, but short segments around the impact find their way.

    Args:
        before: The fit that shows the first events; its segments, parameters and states are where the fit begins.
        settings: What decides.
    """
    observed, predictor, noise, fit = before.observed, before.experiment.predictor, before.noise, before.fit
    time_step = predictor.model.scene.time_step
    events = _events_of(before, predictor, fit, settings)
    for _ in range(settings.rounds.cuts):
        segments = Segmentation.around(events, settings.impacts, time_step)
        predictor = predictor.over(segments)
        experiment, point = begin(
            predictor, observed, noise, settings.least_squares, fit.point.nominal, fit.jacobian.base
        )
        fit = gauss_newton(experiment, point, NONE)
        if settings.rounds.new_states:
            fit = gauss_newton(experiment, search(experiment, fit), NONE)
        missed = _events_of(before, predictor, fit, settings) & ~segments.spread(segments.contact)
        if not bool(missed.any()):
            break
        events = events | missed
    return replace(before, experiment=experiment, fit=fit, events=events)


def fit_with_chosen_steps(before: SegmentedFit, settings: SegmentedFitSettings) -> SegmentedFit:
    """Choose the steps of the engine where a fit stands (see `choose_steps`), and fit segments around events again.

    Where effects may act late, steps are short enough for forces that change within them. Which frames stand alone is
    decided anew: at impacts, those that short segments cannot follow seem to.

    Args:
        before: The fit; its noise is estimated anew, and its frames are weighed, first.
        settings: What decides.
    """
    noise, experiment = weighed(
        before.experiment, before.fit, before.seen, before.observed.error, settings.noise, robust=settings.rounds.robust
    )
    observed = before.observed
    if settings.rounds.outlier_rounds > 0:
        observed = _counted(observed, before.seen, experiment)
    near, base = experiment.linearise(before.fit.point, NONE), observed.timeline
    chosen = choose_steps(experiment, near, base, settings.steps)
    least = chosen.parts
    if any(acts_late(kind) for kind in experiment.predictor.candidates):
        predicted, scene = near.jacobian.base.twist[0], experiment.predictor.model.scene_at(near.point.nominal[0])
        least = least.maximum(parts_for_late_forces(experiment, base, settings.steps, predicted, scene))
    predictor = experiment.predictor.at_times(chosen.timeline, base.refined(least))
    stepped = replace(
        before, observed=observed, experiment=experiment.replace(predictor=predictor), noise=noise, steps=chosen
    )
    return fit_around_events(stepped, settings)


def tumbles(found: SegmentedFit, settings: SegmentedFitSettings) -> Tensor:
    """Return in which trajectories a body touches the ground with an edge or a corner, shape (R,)."""
    observed, scene = found.observed, found.experiment.predictor.model.scene_at(found.fit.point.nominal[0])
    phases = phases_of(found.fit.jacobian.base, observed.timeline, scene, settings.phases)
    seen = observed.present > 0
    return (find_tumbling(phases, observed.pose, scene, settings.events) & seen).any(-1).any(-1)


def begin(
    predictor: Predictor,
    observed: Observed,
    noise: Noise,
    settings: LeastSquaresSettings,
    nominal: Tensor | None = None,
    before: Prediction | None = None,
) -> tuple[Experiment, Variants]:
    """Return the experiment and a first point, see `best_guess`."""
    scale = observed.present[..., None].sqrt() / noise.spread()
    experiment, initial = lay_out(predictor, observed.pose, scale, observed.fitted, noise.rotation, settings)
    experiment = experiment.replace(common=observed.common)
    return experiment, best_guess(experiment, initial, nominal, before)


def _events_of(before: SegmentedFit, predictor: Predictor, fit: Fit, settings: SegmentedFitSettings) -> Tensor:
    """Return the frames at which a fit over the segments of a predictor shows events, shape (R, T)."""
    observed, base, scene = before.observed, fit.jacobian.base, predictor.model.scene_at(fit.point.nominal[0])
    time = observed.timeline.time
    phases = phases_of(base, observed.timeline, scene, settings.phases)
    smooth = smooth_path(base.twist[0], phases, time, predictor.segments)
    return find_events(phases, observed.pose, observed.present, time, smooth, before.noise, scene, settings.events)
