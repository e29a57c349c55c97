"""A fitted nominal model as the tensors and plain values of a file, and back."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from physid.data.observations.step_grid import StepGrid
from physid.diagnosis.inputs import Inputs
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.settings.settings import Settings
from physid.estimation.least_squares import NONE, ChosenSteps, Directions, Experiment
from physid.estimation.measurement import CorrelatedNoise, Correlation, Noise, TrackingError
from physid.estimation.prediction import Predictor, Segmentation, Variants
from physid.estimation.segmented_fit import without_outliers

LAYOUT = 9  # of what is stored; another one is not read
GRID = ("steps", "wrench", "frame_step", "count")
WINDOWS = ("trajectory", "start", "size", "contact", "struck")
DIRECTIONS = ("frame", "free", "parallel")
POINT = ("pose", "twist", "nominal", "effects", "engine")


def to_tensors(nominal_fit: NominalFit) -> dict[str, Any]:
    """Return what a fit consists of beside what it was made from."""
    experiment, segments = nominal_fit.experiment, nominal_fit.experiment.predictor.segments
    state = {name: getattr(segments, name) for name in WINDOWS}
    state |= {f"grid.{name}": getattr(experiment.predictor.timeline.grid, name) for name in GRID}
    if (late := experiment.predictor.late) is not None:
        state |= {f"late.{name}": getattr(late.grid, name) for name in GRID}
    state |= {f"point.{name}": getattr(nominal_fit.fit.point, name) for name in POINT}
    state |= {name: getattr(experiment, name) for name in ("scale", "engine", "follow")}
    state |= {name: getattr(experiment.directions, name) for name in DIRECTIONS}
    state |= {"phases": nominal_fit.phases, "events": nominal_fit.events}
    state |= {"noise": (nominal_fit.noise.rotation, nominal_fit.noise.position)}
    error = nominal_fit.noise.error
    state |= {"factors": error.factors if isinstance(error, TrackingError) else None}
    state |= {"correlated": dataclasses.astuple(error) if isinstance(error, CorrelatedNoise) else None}
    state |= {"steps": nominal_fit.steps and _without_grids(nominal_fit.steps)}
    if nominal_fit.steps is not None:
        state |= {f"chosen.{name}": getattr(nominal_fit.steps.timeline.grid, name) for name in GRID}
    state |= {"simulators": list(nominal_fit.settings.replay.simulators)}
    return state


def from_tensors(state: Mapping[str, Any], inputs: Inputs, settings: Settings) -> NominalFit:
    """Put a fit together again from what `to_tensors` returned, and from what it was made from."""
    observations, settings = inputs.observations, settings.changed({"replay.simulators": tuple(state["simulators"])})
    directions = Directions(*(state[name] for name in DIRECTIONS))
    trajectories, frames = observations.pose.shape[:2]
    cut = {name: state[name] for name in WINDOWS}
    segments = Segmentation(trajectories, frames, **cut, lying=directions.planar)
    grids = {
        kind: dataclasses.replace(observations.timeline, grid=StepGrid(*(state[f"{kind}.{name}"] for name in GRID)))
        for kind in ("grid", "late", "chosen")
        if f"{kind}.steps" in state
    }
    predictor = Predictor(inputs.model, grids["grid"], segments, inputs.candidates, late=grids.get("late"))
    experiment = Experiment(
        predictor,
        observations.pose,
        state["scale"],
        observations.fitted,
        directions,
        state["engine"],
        state["follow"],
        settings.least_squares,
        without_outliers(observations, settings.noise).common,
    )
    fit = experiment.linearise(Variants(*(state[f"point.{name}"] for name in POINT)), NONE)
    rotation, position = map(float, state["noise"])
    error: TrackingError | CorrelatedNoise | None = observations.error
    if isinstance(error, TrackingError):
        rotations, positions = map(float, state["factors"])
        error = dataclasses.replace(error, factors=(rotations, positions), sure=settings.noise.sure)
    elif state["correlated"] is not None:
        sizes, (rotation_parts, position_parts), frames, _ = state["correlated"]
        error = CorrelatedNoise(
            sizes, (Correlation(*rotation_parts), Correlation(*position_parts)), frames, settings.noise.sure
        )
    noise = Noise(rotation, position, error, settings.noise.least)
    steps = None if "chosen" not in grids else ChosenSteps(grids["chosen"], *state["steps"])
    return NominalFit(observations, experiment, fit, noise, state["phases"], state["events"], settings, steps)


def _without_grids(steps: ChosenSteps) -> tuple[Any, ...]:
    """Return what is chosen beside the timeline."""
    return steps.mean, steps.largest, steps.error, steps.bias, steps.left, steps.parts
