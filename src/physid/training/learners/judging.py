"""What is said of every fit of physical parameters beside its estimates."""

from __future__ import annotations

import lightning as L

from physid.training.callbacks.identifiability_warning import IdentifiabilityWarning
from physid.training.callbacks.intervals import Intervals
from physid.training.callbacks.parameter_history import ParameterHistory
from physid.training.callbacks.unexplained import Unexplained


def judging_callbacks() -> list[L.Callback]:
    """Find intervals, keep the history of the parameters, and warn of what is not identifiable or explained."""
    return [Intervals(), ParameterHistory(), IdentifiabilityWarning(), Unexplained()]
