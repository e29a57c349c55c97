"""From observations to the fitted nominal model: noise, segments, initial states, unknown parameters, numerics."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from physid.diagnosis.inputs import Observations
from physid.diagnosis.progress import Progress, Stage, silent
from physid.diagnosis.reference.following import fit_beside_references
from physid.diagnosis.settings.settings import Settings
from physid.estimation.least_squares import NONE, ChosenSteps, Experiment, Fit
from physid.estimation.measurement import Noise
from physid.estimation.prediction import EffectKinds, NominalModel, Predictor, Segmentation, Timeline
from physid.estimation.segmented_fit import (
    UnexplainedEvents,
    fit_around_events,
    fit_short_segments,
    fit_with_chosen_steps,
    phases_of,
    squares_of_segments,
    unexplained_events,
    without_outliers,
)

DEFAULT = Settings()


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
        steps: The steps of the engine that were chosen; None where they are given, or those of the simulator that made
            the recordings, one from frame to frame.
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
        return without_outliers(self.observations, self.settings.noise).present

    @cached_property
    def unexplained_events(self) -> UnexplainedEvents | None:
        """What it leaves at impacts, where many of them are not explained; None where they are.

        Where a simulator is known that recorded, it is how that one resolves contact (decision 78), and no gap.
        """
        if self.observations.scene.integration is not None:
            return None
        segments = self.experiment.predictor.segments
        square = squares_of_segments(segments, self.fit.residual, self.present)
        return unexplained_events(square, segments.struck, self.noise, self.settings.unexplained)

    @property
    def references(self) -> tuple[str, ...]:
        """Names of the simulators that make its null simulations."""
        return self.settings.replay.simulators


def fit_nominal_model(
    observations: Observations,
    model: NominalModel,
    candidates: EffectKinds,
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
    own = settings.segmented_fit
    say(Stage.FITTING_SHORT_SEGMENTS)
    timeline = _first_steps(observations, model)
    whole = Segmentation.equal(len(observations.pose), timeline.frames, timeline.frames)
    first = fit_short_segments(observations, Predictor(model, timeline, whole, candidates), own)
    say(Stage.FITTING_NOMINAL)
    found = fit_around_events(first, own)
    for _ in range(own.rounds.step_choices if _chooses_steps(observations, model) else 0):
        say(Stage.CHOOSING_STEPS)
        found = fit_with_chosen_steps(found, own)
    experiment, fit, noise, settings = fit_beside_references(
        found.experiment, found.fit, found.seen, observations.error, settings, generator, say
    )
    # A fit may end with the slopes of a point nearby; those of a run that is taken up again are of its own point.
    fit = experiment.linearise(fit.point, NONE)
    scene = model.scene_at(fit.point.nominal[0])
    phases = phases_of(fit.jacobian.base, observations.timeline, scene, settings.phases)
    return NominalFit(observations, experiment, fit, noise, phases, found.events, settings, found.steps)


def _first_steps(observations: Observations, model: NominalModel) -> Timeline:
    """Return the timeline with the steps that are given or known, or the longest where they are chosen later."""
    timeline = observations.timeline
    if model.substeps is not None:
        return timeline.refined(model.substeps)
    if model.made_in is None or _chooses_steps(observations, model):
        return timeline
    return timeline.refined(timeline.grid.parts_of(model.made_in))


def _chooses_steps(observations: Observations, model: NominalModel) -> bool:
    """Return whether the steps of the engine follow from the recordings.

    They do where nobody says how these were integrated, and of one body where it was in steps shorter than those of a
    frame. How bodies strike each other depends on the very step in which they meet: longer ones elsewhere made
    estimates of collisions worse than the steps of the simulator throughout.
    """
    if model.substeps is not None or model.made_in is None:
        return model.substeps is None
    alone = len(model.scene.bodies) == 1
    return alone and bool((observations.timeline.grid.parts_of(model.made_in) > 1).any())
