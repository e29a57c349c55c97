"""Initial states of trajectories: given, guessed, or fitted together with the parameters."""

from physid.training.initial_states.elimination import slopes, without_initial_states
from physid.training.initial_states.explaining import Explaining, started_from
from physid.training.initial_states.fitted import fit_states
from physid.training.initial_states.tracked import TrackedFit

__all__ = ["Explaining", "TrackedFit", "fit_states", "slopes", "started_from", "without_initial_states"]
