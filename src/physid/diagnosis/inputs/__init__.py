"""What a diagnosis starts from: recordings, the nominal model, requirements on the data."""

from physid.diagnosis.inputs.inputs import Inputs, read_inputs
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import FIT, SAME, SELECT, TRANSFER, Observations, load_observations
from physid.diagnosis.inputs.requirements import require_usable

__all__ = [
    "FIT",
    "SAME",
    "SELECT",
    "TRANSFER",
    "Inputs",
    "Observations",
    "load_observations",
    "read_inputs",
    "read_nominal_model",
    "require_usable",
]
