"""What an interrupted diagnosis leaves behind: the fitted nominal model, so that the next run need not fit it again."""

from __future__ import annotations

import hashlib
from pathlib import Path

import torch

from physid.data.files import read_tensors, write_tensors
from physid.diagnosis.inputs import Inputs
from physid.diagnosis.progress import Progress, silent
from physid.diagnosis.reference.nominal_fit import NominalFit, fit_nominal_model
from physid.diagnosis.reference.stored_fit import LAYOUT, from_tensors, to_tensors
from physid.diagnosis.settings.settings import Settings
from physid.physics import SolverError

FILE = "prepared.pt"
DECIDING = (
    "noise", "least_squares", "first_guess", "phases", "events", "nominal_fit", "segments", "steps", "discrepancy",
    "null_simulations", "replay",
)  # fmt: skip
"""Sections of the settings that the fit depends on."""


def fit_or_resume(
    folder: Path, inputs: Inputs, generator: torch.Generator, settings: Settings, say: Progress = silent
) -> NominalFit:
    """Fit the nominal model, or take the fit of an interrupted run with the same inputs if there is one.

    Args:
        folder: Output folder of the diagnosis.
        inputs: What the diagnosis starts from.
        generator: Source of randomness; goes on as if nothing had been interrupted.
        settings: What decides.
        say: Told what is being done.

    Raises:
        ValueError: If the nominal model cannot be simulated where the recordings go.
    """
    key = _key(inputs, generator, settings)
    path = folder / FILE
    if path.is_file():
        try:
            state = read_tensors(path, ("key", "generator"))
        except ValueError:  # damaged: is only there to save time
            state = {"key": None}
        if state["key"] == key:
            generator.set_state(state["generator"])
            return from_tensors(state, inputs, settings)
    try:
        nominal_fit = fit_nominal_model(inputs.observations, inputs.model, inputs.candidates, generator, say, settings)
    except SolverError as error:
        raise ValueError(
            f"the nominal model cannot go where the recordings go: {error}; check sizes, units and forces"
        ) from error
    write_tensors(path, to_tensors(nominal_fit) | {"key": key, "generator": generator.get_state()})
    return nominal_fit


def clear_cache(folder: Path) -> None:
    """Remove what only an interrupted diagnosis needs."""
    (folder / FILE).unlink(missing_ok=True)


def _key(inputs: Inputs, generator: torch.Generator, settings: Settings) -> str:
    """Return a checksum of all that the fit depends on."""
    observations, model = inputs.observations, inputs.model
    digest = hashlib.sha256(b"" if observations.error is None else observations.error.track.numpy().tobytes())
    grid = observations.timeline.grid
    for array in (observations.pose, observations.present, grid.steps, grid.wrench, generator.get_state()):
        digest.update(array.numpy().tobytes())
    known = [(effect.name, [float(value) for value in effect.values().values()]) for effect in model.effects]
    decided = [getattr(settings, section) for section in DECIDING]
    named = [(kind.name, sorted(kind.quantities())) for kind in inputs.candidates]
    digest.update(
        repr((LAYOUT, model.scene, model.sizes, model.substeps, known, observations.roles, named, decided)).encode()
    )
    return digest.hexdigest()
