"""Initial states of trajectories: given, guessed, or fitted together with the parameters."""

from physid.estimation.segmented_fit import SegmentedFitSettings
from physid.training.initial_states.around_impacts import AROUND_IMPACTS, fit_around_impacts
from physid.training.initial_states.cutting import WHOLE, Cutting, OutlierFrames
from physid.training.initial_states.elimination import slopes, without_initial_states
from physid.training.initial_states.explaining import Explaining, started_from
from physid.training.initial_states.fitted import fit_beginnings, fit_states
from physid.training.initial_states.piece_weights import weighed_anew
from physid.training.initial_states.tracked import TrackedFit

__all__ = [
    "AROUND_IMPACTS",
    "WHOLE",
    "Cutting",
    "Explaining",
    "OutlierFrames",
    "SegmentedFitSettings",
    "TrackedFit",
    "fit_around_impacts",
    "fit_beginnings",
    "fit_states",
    "slopes",
    "started_from",
    "weighed_anew",
    "without_initial_states",
]
