"""From observations to the fitted nominal model: noise, segments, initial states, unknown parameters, numerics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.diagnosis.inputs import Observations, find_events, phases_of, smooth_path
from physid.diagnosis.progress import Progress, Stage, silent
from physid.diagnosis.reference.following import count_numerics, follow, weighed
from physid.diagnosis.reference.replay import references_of
from physid.diagnosis.settings.settings import Settings
from physid.estimation.least_squares import (
    ChosenSteps,
    Experiment,
    Fit,
    best_guess,
    choose_steps,
    gauss_newton,
    lay_out,
    parts_for_late_forces,
    search,
)
from physid.estimation.measurement import (
    Noise,
    NoiseSettings,
    estimate_noise,
    outlier_poses,
)
from physid.estimation.prediction import (
    NominalModel,
    Prediction,
    Predictor,
    Segmentation,
    Timeline,
    Variants,
    acts_late,
)
from physid.physics import Effect

DEFAULT = Settings()
NONE = torch.zeros(0, dtype=torch.int64)


@dataclass(frozen=True)
class NominalFit:
    """The fitted nominal model.

    Attributes:
        observations: What was recorded.
        experiment: Model, data and weights.
        fit: The fit.
        noise: White noise of the poses.
        phases: Codes of what each body is doing, shape (R, T, N).
        events: Frames at which small errors grow fast, shape (R, T).
        settings: What decided, and decides in all that follows.
        steps: The steps of the engine that were chosen; None where they are known, or given.
    """

    observations: Observations
    experiment: Experiment
    fit: Fit
    noise: Noise
    phases: Tensor
    events: Tensor
    settings: Settings
    steps: ChosenSteps | None = None

    @property
    def present(self) -> Tensor:
        """Frames that exist and are not outliers, shape (R, T, N)."""
        return inliers(self.observations, self.settings.noise)

    @property
    def references(self) -> tuple[str, ...]:
        """Names of the simulators that make its null simulations."""
        model = self.experiment.predictor.model
        made = references_of(model.scene, self.settings.replay, model.effects_at(self.fit.point.nominal))
        return tuple(one.name for one in made)


def inliers(observations: Observations, settings: NoiseSettings) -> Tensor:
    """Return which frames exist and are not outliers, shape (R, T, N)."""
    wild = outlier_poses(observations.pose, observations.present, observations.timeline.time, settings)
    present: Tensor = observations.present * ~wild
    return present


def fit_nominal_model(
    observations: Observations,
    model: NominalModel,
    candidates: Sequence[type[Effect]],
    generator: torch.Generator,
    say: Progress = silent,
    settings: Settings = DEFAULT,
) -> NominalFit:
    """Fit the nominal model: unknown parameters by the fitted trajectories, initial states by all.

    Args:
        observations: What was recorded.
        model: What is believed.
        candidates: Effects that may be added later; all null here.
        generator: Source of randomness.
        say: Called with what is being done.
        settings: What decides.

    Returns:
        The fit, with the noise that its residuals show.
    """
    trajectories, frames = observations.pose.shape[:2]
    present = inliers(observations, settings.noise)
    say(Stage.FITTING_SHORT_SEGMENTS)
    own = settings.nominal_fit
    length = settings.first_guess.length(observations.scene.time_step)
    short = Segmentation.equal(trajectories, frames, min(length, frames))
    timeline = _first_steps(observations, model)
    predictor = Predictor(model, timeline, short, candidates)
    start = Noise(own.first_rotation_noise, own.first_position_noise)
    experiment, point = begin(predictor, observations, present, start, settings)
    first = settings.first_guess.fit(experiment, point)
    noise = estimate_noise(first.residual, present, observations.error, settings.noise)
    say(Stage.FITTING_NOMINAL)
    experiment, fit, events = _fit_segments(observations, predictor, present, noise, first, settings)
    chosen, late = None, any(acts_late(kind) for kind in candidates)
    for _ in range(own.step_choices if _chooses_steps(model) else 0):
        say(Stage.CHOOSING_STEPS)
        noise, experiment = weighed(experiment, fit, present, noise.error, settings)
        near, base = experiment.linearise(fit.point, NONE), observations.timeline
        chosen = choose_steps(experiment, near, base, settings.steps)
        least = chosen.parts
        if late:
            predicted = near.jacobian.base.twist[0]
            least = least.maximum(parts_for_late_forces(experiment, base, settings.steps, predicted))
        predictor = experiment.predictor.at_times(chosen.timeline, base.refined(least))
        experiment, fit, events = _fit_segments(observations, predictor, present, noise, fit, settings)
    experiment, fit, noise = follow(experiment, fit, present, noise.error, settings, say)
    experiment, fit, settings = count_numerics(experiment, fit, settings, generator, say)
    phases = phases_of(fit.jacobian.base, observations.timeline, model.scene, settings.phases)
    return NominalFit(observations, experiment, fit, noise, phases, events, settings, chosen)


def _first_steps(observations: Observations, model: NominalModel) -> Timeline:
    """Return the timeline with the steps that are known, or the longest where they are chosen later."""
    timeline, made = observations.timeline, model.scene.integration
    if model.substeps is not None:
        return timeline.refined(model.substeps)
    return timeline if made is None else replace(timeline, grid=timeline.grid.in_steps_of(made.step))


def _chooses_steps(model: NominalModel) -> bool:
    """Return whether the steps of the engine follow from the recordings: nobody says how these were integrated."""
    return model.substeps is None and model.scene.integration is None


def _fit_segments(
    observations: Observations,
    predictor: Predictor,
    present: Tensor,
    noise: Noise,
    fit: Fit,
    settings: Settings,
) -> tuple[Experiment, Fit, Tensor]:
    """Fit segments cut around events, which a fit to short segments shows; cut again if the new fit shows others.

    Bodies that pass each other closely may hit each other in a fit to a long segment that is a little off: no step
    leads back from there, but short segments around the impact find their way.

    Returns:
        The experiment, the fit and the events that its segments are cut around, shape (R, T).
    """

    def events_of(fit: Fit) -> Tensor:
        base, time = fit.jacobian.base, observations.timeline.time
        phases = phases_of(base, observations.timeline, model.scene, settings.phases)
        smooth = smooth_path(base.twist[0], phases, time, predictor.segments)
        return find_events(phases, observations.pose, present, time, smooth, noise, model.scene, settings.events)

    model = predictor.model
    events = events_of(fit)
    for _ in range(settings.nominal_fit.cuts):
        segments = Segmentation.around(events, settings.segments.impacts, model.scene.time_step)
        predictor = predictor.over(segments)
        experiment, point = begin(
            predictor, observations, present, noise, settings, fit.point.nominal, fit.jacobian.base
        )
        fit = gauss_newton(experiment, point, NONE)
        if settings.nominal_fit.new_states:
            fit = gauss_newton(experiment, search(experiment, fit), NONE)
        missed = events_of(fit) & ~segments.spread(segments.contact)
        if not bool(missed.any()):
            break
        events = events | missed
    return experiment, fit, events


def begin(
    predictor: Predictor,
    observations: Observations,
    present: Tensor,
    noise: Noise,
    settings: Settings,
    nominal: Tensor | None = None,
    before: Prediction | None = None,
) -> tuple[Experiment, Variants]:
    """Return the experiment and a first point, see `best_guess`."""
    scale = present[..., None].sqrt() / noise.spread()
    experiment, initial = lay_out(
        predictor, observations.pose, scale, observations.fitted, noise.rotation, settings.least_squares
    )
    experiment = experiment.replace(common=observations.common)
    return experiment, best_guess(experiment, initial, nominal, before)
