"""What an interrupted diagnosis leaves behind: the fitted nominal model, so that the next run need not fit it again."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Sequence
from pathlib import Path

import torch

from physid.data.files import read_tensors, write_tensors
from physid.data.observations.step_grid import StepGrid
from physid.diagnosis.inputs import Observations
from physid.diagnosis.progress import Progress, silent
from physid.diagnosis.reference.nominal_fit import NONE, NominalFit, fit_nominal_model
from physid.diagnosis.settings.settings import Settings
from physid.estimation.least_squares import Directions, Experiment
from physid.estimation.measurement import Noise
from physid.estimation.prediction import NominalModel, Predictor, Segmentation, Variants
from physid.physics import Effect, SolverError

FILE = "prepared.pt"
LAYOUT = 3  # of what the file holds; another one is not read
GRID = ("steps", "wrench", "frame_step", "count")
WINDOWS = ("trajectory", "start", "size", "contact")
DECIDING = (
    "noise", "least_squares", "first_guess", "phases", "events", "nominal_fit", "segments", "steps", "discrepancy",
    "null_simulations", "replay",
)  # fmt: skip
"""Sections of the settings that the fit depends on."""
POINT = ("pose", "twist", "nominal", "effects", "engine")


def fit_or_resume(
    folder: Path,
    observations: Observations,
    model: NominalModel,
    candidates: Sequence[type[Effect]],
    generator: torch.Generator,
    settings: Settings,
    say: Progress = silent,
) -> NominalFit:
    """Fit the nominal model, or take the fit of an interrupted run with the same inputs if there is one.

    Args:
        folder: Output folder of the diagnosis.
        observations: What was recorded.
        model: What is believed.
        candidates: Effects that may be added.
        generator: Source of randomness; goes on as if nothing had been interrupted.
        settings: What decides.
        say: Told what is being done.

    Raises:
        ValueError: If the nominal model cannot be simulated where the recordings go.
    """
    key = _key(observations, model, candidates, generator, settings)
    path = folder / FILE
    if path.is_file():
        try:
            state = read_tensors(path, ("key", "generator"))
        except ValueError:  # damaged: is only there to save time
            state = {"key": None}
        if state["key"] == key:
            generator.set_state(state["generator"])
            return _restored(state, observations, model, candidates, settings)
    try:
        nominal_fit = fit_nominal_model(observations, model, candidates, generator, say, settings)
    except SolverError as error:
        raise ValueError(
            f"the nominal model cannot go where the recordings go: {error}; check sizes, units and forces"
        ) from error
    experiment, segments = nominal_fit.experiment, nominal_fit.experiment.predictor.segments
    state = {name: getattr(segments, name) for name in WINDOWS}
    state |= {f"grid.{name}": getattr(experiment.predictor.timeline.grid, name) for name in GRID}
    if (late := experiment.predictor.late) is not None:
        state |= {f"late.{name}": getattr(late.grid, name) for name in GRID}
    state |= {f"point.{name}": getattr(nominal_fit.fit.point, name) for name in POINT}
    state |= {name: getattr(experiment, name) for name in ("scale", "engine", "follow")}
    state |= {"frame": experiment.directions.frame, "free": experiment.directions.free, "phases": nominal_fit.phases}
    state |= {"events": nominal_fit.events}
    state |= {"noise": (nominal_fit.noise.rotation, nominal_fit.noise.position)}
    state |= {"factors": None if nominal_fit.noise.error is None else nominal_fit.noise.error.factors}
    write_tensors(path, state | {"key": key, "generator": generator.get_state()})
    return nominal_fit


def clear_cache(folder: Path) -> None:
    """Remove what only an interrupted diagnosis needs."""
    (folder / FILE).unlink(missing_ok=True)


def _restored(
    state: dict[str, torch.Tensor],
    observations: Observations,
    model: NominalModel,
    candidates: Sequence[type[Effect]],
    settings: Settings,
) -> NominalFit:
    """Put the parts together again."""
    segments = Segmentation(*observations.pose.shape[:2], *(state[name] for name in WINDOWS))
    grids = {
        kind: dataclasses.replace(observations.timeline, grid=StepGrid(*(state[f"{kind}.{name}"] for name in GRID)))
        for kind in ("grid", "late")
        if f"{kind}.steps" in state
    }
    predictor = Predictor(model, grids["grid"], segments, candidates, late=grids.get("late"))
    directions = Directions(state["frame"], state["free"])
    experiment = Experiment(
        predictor,
        observations.pose,
        state["scale"],
        observations.fitted,
        directions,
        state["engine"],
        state["follow"],
        settings.least_squares,
        observations.common,
    )
    fit = experiment.linearise(Variants(*(state[f"point.{name}"] for name in POINT)), NONE)
    rotation, position = map(float, state["noise"])
    error = observations.error
    if error is not None:
        rotations, positions = map(float, state["factors"])
        error = dataclasses.replace(error, factors=(rotations, positions), sure=settings.noise.sure)
    noise = Noise(rotation, position, error, settings.noise.least)
    return NominalFit(observations, experiment, fit, noise, state["phases"], state["events"], settings)


def _key(
    observations: Observations,
    model: NominalModel,
    candidates: Sequence[type[Effect]],
    generator: torch.Generator,
    settings: Settings,
) -> str:
    """Return a checksum of all that the fit depends on."""
    digest = hashlib.sha256(b"" if observations.error is None else observations.error.track.numpy().tobytes())
    grid = observations.timeline.grid
    for array in (observations.pose, observations.present, grid.steps, grid.wrench, generator.get_state()):
        digest.update(array.numpy().tobytes())
    known = [(effect.name, [float(value) for value in effect.values().values()]) for effect in model.effects]
    decided = [getattr(settings, section) for section in DECIDING]
    named = [(kind.name, sorted(kind.quantities())) for kind in candidates]
    digest.update(
        repr((LAYOUT, model.scene, model.sizes, model.substeps, known, observations.roles, named, decided)).encode()
    )
    return digest.hexdigest()
