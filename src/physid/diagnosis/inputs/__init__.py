"""What a diagnosis starts from: recordings, the nominal model, requirements on the data, phases of motion, events."""

from physid.diagnosis.inputs.events import find_events, smooth_path
from physid.diagnosis.inputs.inputs import Inputs, read_inputs
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.motion_phases import PHASES, phases_of, phases_of_steps
from physid.diagnosis.inputs.observations import FIT, SAME, SELECT, TRANSFER, Observations, load_observations
from physid.diagnosis.inputs.requirements import require_usable

__all__ = [
    "FIT",
    "PHASES",
    "SAME",
    "SELECT",
    "TRANSFER",
    "Inputs",
    "Observations",
    "find_events",
    "load_observations",
    "phases_of",
    "phases_of_steps",
    "read_inputs",
    "read_nominal_model",
    "require_usable",
    "smooth_path",
]
