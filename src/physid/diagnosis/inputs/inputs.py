"""All that a diagnosis starts from, read together: what was recorded, what is believed, and what may be missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physid.data import RecordingSet
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import Observations, load_observations
from physid.diagnosis.inputs.requirements import Mistakes, require_usable
from physid.diagnosis.settings.settings import Settings
from physid.effects import candidates_beside
from physid.estimation.prediction import NominalModel
from physid.physics import Effect


@dataclass(frozen=True)
class Inputs:
    """What a diagnosis starts from.

    Attributes:
        observations: What was recorded.
        model: What is believed of the system.
        candidates: Effects that may be added to it.
        findings: What looks like a mistake in the recordings, or is odd.
    """

    observations: Observations
    model: NominalModel
    candidates: Sequence[type[Effect]]
    findings: Mistakes = ()


def read_inputs(
    recordings: RecordingSet,
    transfer: RecordingSet | None,
    model: Path | Mapping[str, Any] | None,
    effects: Sequence[type[Effect]],
    limit: int | None,
    settings: Settings,
) -> Inputs:
    """Read what a diagnosis starts from, refuse what nothing can be concluded from, and find what looks like a mistake.

    Args:
        recordings: The recording set.
        transfer: The same bodies under another protocol, if there is such a set.
        model: What is believed of the system, see `read_nominal_model`.
        effects: Candidates beside the catalogue.
        limit: At most so many trajectories of each set, the first ones.
        settings: The parts that trajectories play, and what is required of them.

    Raises:
        ValueError: If the recordings or the model cannot be used; the message says what is missing.
    """
    observations = load_observations(recordings, transfer, limit, settings.roles)
    believed = read_nominal_model(observations.scene, model)
    findings = require_usable(observations, settings.requirements, settings.noise)
    return Inputs(observations, believed, candidates_beside(believed.effects, effects), findings)
