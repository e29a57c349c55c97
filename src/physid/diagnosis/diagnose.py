"""Diagnose the sim-to-real gap of a recording set: where it lies, which effect causes it, how far it closes."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from physid.data.files import write_text
from physid.data.format import RecordingSet
from physid.data.reading import read_reading
from physid.diagnosis.conclusion.conclusion import Conclusion, draw_conclusion
from physid.diagnosis.conclusion.fitted_model import save_model
from physid.diagnosis.conclusion.materiality import Tolerance
from physid.diagnosis.document.document import Diagnosis, write_diagnosis
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import Observations, load_observations
from physid.diagnosis.inputs.requirements import require_usable
from physid.diagnosis.progress import Progress, Stage, silent
from physid.diagnosis.reference.nominal_fit import NominalFit, fit_nominal_model
from physid.diagnosis.reference.nominal_fit_cache import cached_fit, clear_cache
from physid.diagnosis.report.figures import draw
from physid.diagnosis.report.overlay import overlay
from physid.diagnosis.report.page import write_report
from physid.diagnosis.selection.attribution import attribute
from physid.diagnosis.settings.settings import Settings
from physid.effects import CATALOGUE
from physid.estimation.prediction.nominal_model import NominalModel
from physid.one_writer import one_writer
from physid.physics.effect import Effect
from physid.physics.layer import SolverError

NEXT = "next_experiment.yaml"
DEFAULT = Settings()


def diagnose(
    recordings: Path,
    out: Path,
    *,
    model: Path | Mapping[str, Any] | None = None,
    transfer: Path | None = None,
    effects: Sequence[type[Effect]] = (),
    limit: int | None = None,
    seed: int = 0,
    tolerance: float | None = None,
    save: Path | None = None,
    settings: Settings = DEFAULT,
    say: Progress = silent,
) -> Diagnosis:
    """Diagnose a recording set and write diagnosis.json and report.html.

    An interrupted diagnosis goes on from the fitted nominal model when it is called again.

    Args:
        recordings: Folder of the recording set.
        out: Folder for the results; made if it is not there.
        model: What is believed of the system, see `read_nominal_model`; None for what recording.yaml says.
        transfer: Folder of a second set: the same bodies under another protocol, which certifies a cause.
        effects: Candidates beside the catalogue.
        limit: At most so many trajectories of each set, the first ones.
        seed: Seed of the null simulations and of the bootstrap.
        tolerance: How far positions may leave the model, beyond what noise accounts for, before anything is blamed [m];
            None for what follows from noise and sizes.
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
    if tolerance is not None:
        Tolerance(tolerance, tolerance)  # refused before anything is computed
    say(Stage.READING)
    observations = load_observations(
        RecordingSet(recordings), None if transfer is None else RecordingSet(transfer), limit, settings.roles
    )
    believed_model = read_nominal_model(observations.scene, model)
    require_usable(observations, settings.requirements)
    with one_writer(out):
        document, conclusion = _write(
            recordings,
            out,
            transfer,
            effects,
            limit,
            seed,
            tolerance,
            observations,
            believed_model,
            settings,
            say,
            begun,
        )
        if save is not None:
            save_model(save, recordings, believed_model, conclusion)
    return document


def _write(
    recordings: Path,
    out: Path,
    transfer: Path | None,
    effects: Sequence[type[Effect]],
    limit: int | None,
    seed: int,
    tolerance: float | None,
    observations: Observations,
    believed_model: NominalModel,
    settings: Settings,
    say: Progress,
    begun: float,
) -> tuple[Diagnosis, Conclusion]:
    """Diagnose and write the results (see `diagnose`); `begun` is when, by `time.perf_counter`."""
    generator = torch.Generator().manual_seed(seed)
    nominal_fit = _fitted(out, observations, believed_model, effects, generator, settings, say)
    found = attribute(nominal_fit, generator, say)
    conclusion = draw_conclusion(nominal_fit, found, generator, tolerance)
    say(Stage.WRITING)
    document = dataclasses.replace(conclusion.diagnosis, seconds=float(f"{time.perf_counter() - begun:.3g}"))
    reading = read_reading(recordings)
    title = Path(reading.films).name if reading else recordings.name
    pictures = draw(title, nominal_fit, found, conclusion, time.perf_counter() - begun)
    drawn = overlay(out, _sources(recordings, transfer, limit), observations, found.whole_nominal, conclusion)
    pictures = dataclasses.replace(pictures, overlay=drawn)
    write_report(out, document, pictures)
    write_diagnosis(out, document)
    clear_cache(out)
    if conclusion.further and conclusion.further.config:
        write_text(out / NEXT, conclusion.further.config)
    return document, conclusion


def _sources(recordings: Path, transfer: Path | None, limit: int | None) -> list[tuple[RecordingSet, int]]:
    """List the set of each trajectory, and its number there, in the order of the observations."""
    sets = [RecordingSet(each) for each in (recordings, transfer) if each is not None]
    return [(each, index) for each in sets for index in range(len(each))[:limit]]


def _fitted(
    out: Path,
    observations: Observations,
    believed_model: NominalModel,
    effects: Sequence[type[Effect]],
    generator: torch.Generator,
    settings: Settings,
    say: Progress,
) -> NominalFit:
    """Fit the nominal model, or take the fit of an interrupted run; effects that it knows are no candidates."""
    known = {effect.name for effect in believed_model.effects}
    candidates = [kind for kind in (*CATALOGUE, *effects) if kind.name not in known]
    try:
        return cached_fit(
            out,
            observations,
            believed_model,
            candidates,
            generator,
            settings,
            lambda: fit_nominal_model(observations, believed_model, candidates, generator, say, settings),
        )
    except SolverError as error:
        raise ValueError(
            f"the nominal model cannot go where the recordings go: {error}; check sizes, units and forces"
        ) from error
