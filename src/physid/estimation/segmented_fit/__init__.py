"""Fits to segments that are cut around impacts: what bodies do, where errors grow fast, and the fit between."""

from physid.estimation.segmented_fit.events import find_events, smooth_path
from physid.estimation.segmented_fit.fit import (
    SegmentedFit,
    begin,
    fit_around_events,
    fit_short_segments,
    fit_with_chosen_steps,
    tumbles,
)
from physid.estimation.segmented_fit.motion_phases import PHASES, phases_of, phases_of_steps
from physid.estimation.segmented_fit.observed import Observed, Recorded, without_outliers
from physid.estimation.segmented_fit.odd_trajectories import OddTrajectory, odd_trajectories
from physid.estimation.segmented_fit.settings import (
    AgreementSettings,
    EventSettings,
    OddSettings,
    PhaseSettings,
    RoundSettings,
    SegmentedFitSettings,
    UnexplainedSettings,
)
from physid.estimation.segmented_fit.unexplained import (
    UnexplainedEvents,
    misfit_of_segments,
    squares_of_segments,
    unexplained_events,
)
from physid.estimation.segmented_fit.weights import (
    agreed_weights,
    own_weights,
    usual_misfit,
    weighed,
    weights_of_frames,
)

__all__ = [
    "PHASES",
    "AgreementSettings",
    "EventSettings",
    "Observed",
    "OddSettings",
    "OddTrajectory",
    "PhaseSettings",
    "Recorded",
    "RoundSettings",
    "SegmentedFit",
    "SegmentedFitSettings",
    "UnexplainedEvents",
    "UnexplainedSettings",
    "agreed_weights",
    "begin",
    "find_events",
    "fit_around_events",
    "fit_short_segments",
    "fit_with_chosen_steps",
    "misfit_of_segments",
    "odd_trajectories",
    "own_weights",
    "phases_of",
    "phases_of_steps",
    "smooth_path",
    "squares_of_segments",
    "tumbles",
    "unexplained_events",
    "usual_misfit",
    "weighed",
    "weights_of_frames",
    "without_outliers",
]
