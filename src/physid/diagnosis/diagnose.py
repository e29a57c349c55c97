"""Diagnose the sim-to-real gap of a recording set: where it lies, which effect causes it, how far it closes."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from physid.data import RecordingSet
from physid.diagnosis.analysis import analyse
from physid.diagnosis.document.document import Diagnosis
from physid.diagnosis.inputs import read_inputs
from physid.diagnosis.progress import Progress, Stage, silent
from physid.diagnosis.results import results_in, write_results
from physid.diagnosis.settings.settings import Settings
from physid.physics import Effect

DEFAULT = Settings()


def diagnose(
    recordings: RecordingSet,
    out: Path,
    *,
    model: Path | Mapping[str, Any] | None = None,
    transfer: RecordingSet | None = None,
    effects: Sequence[type[Effect]] = (),
    limit: int | None = None,
    seed: int = 0,
    save: Path | None = None,
    settings: Settings = DEFAULT,
    say: Progress = silent,
) -> Diagnosis:
    """Diagnose a recording set and write diagnosis.json and report.html.

    An interrupted diagnosis goes on from the fitted nominal model when it is called again.

    Args:
        recordings: The recording set.
        out: Folder for the results; made if it is not there.
        model: What is believed of the system, see `read_nominal_model`; None for what recording.yaml says.
        transfer: A second set: the same bodies under another protocol, which certifies a cause.
        effects: Candidates beside the catalogue.
        limit: At most so many trajectories of each set, the first ones.
        seed: Seed of the null simulations and of the bootstrap.
        save: Where to write the model with what was found, as a configuration of `physid fit`.
        settings: Every number that decides.
        say: Told what is being done.

    Returns:
        The document, as diagnosis.json holds it.

    Raises:
        ValueError: If the recordings or the model cannot be used; the message says what is missing.
        FolderInUseError: If another process writes into the output folder.
    """
    begun = time.perf_counter()
    say(Stage.READING)
    inputs = read_inputs(recordings, transfer, model, effects, limit, settings)
    with results_in(out):
        conclusion = analyse(inputs, out, seed, settings, say)
        say(Stage.WRITING)
        seconds = float(f"{time.perf_counter() - begun:.3g}")
        document = dataclasses.replace(conclusion.diagnosis, seconds=seconds)
        write_results(out, document, conclusion, save)
    return document
