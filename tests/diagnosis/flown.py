"""Diagnoses of boxes in free flight, where all is linear and a replay takes milliseconds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch
from torch import Tensor

from estimation.flights import NOISE, Flights
from physid.diagnosis.inputs.observations import Observations
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing import Hypothesis, conclude
from physid.estimation.least_squares.levenberg_marquardt import gauss_newton
from physid.estimation.measurement import Noise
from physid.estimation.segmented_fit import PHASES

QUICK = Settings().changed({"null_simulations.replays": 2})


def hypothesis(made: Flights, names: tuple[str, ...] = (), settings: Settings = QUICK) -> Hypothesis:
    """Fit flights with some of the candidates."""
    terms = made.experiment.predictor.terms
    columns = torch.tensor([k for k, term in enumerate(terms) if term.effect.name in names], dtype=torch.int64)
    return conclude(made.experiment, gauss_newton(made.experiment, made.start, columns), names, settings)


def examined(made: Flights, settings: Settings = QUICK, phases: Tensor | None = None) -> Any:
    """Return what an examination takes of a nominal fit of flights."""
    shape = made.experiment.pose.shape[:3]
    fitted = made.experiment.fitted
    observations = SimpleNamespace(
        reported=(~fitted, torch.zeros_like(fitted)),
        scene=made.experiment.predictor.model.scene,
        timeline=made.experiment.predictor.timeline,
        fitted=fitted,
    )
    nominal = hypothesis(made, (), settings)
    return SimpleNamespace(
        experiment=made.experiment,
        fit=nominal.fit,
        noise=Noise(*NOISE),
        phases=torch.full(shape, PHASES.index("free_fall")) if phases is None else phases,
        settings=settings,
        observations=observations,
        present=torch.ones(shape).double(),
    )


def observed(made: Flights, roles: Sequence[str]) -> Observations:
    """Return flights as if they had been read from a folder of this name."""
    one: Any = SimpleNamespace(folder=Path("data/flights"))
    experiment, rows = made.experiment, range(len(roles))
    return Observations(
        experiment.predictor.model.scene,
        experiment.pose,
        torch.ones(experiment.pose.shape[:3]).double(),
        experiment.predictor.timeline,
        tuple(roles),
        tuple(rows),
        tuple((one, row) for row in rows),
    )


def nominal_fit_of(made: Flights, roles: Sequence[str], settings: Settings = QUICK) -> NominalFit:
    """Fit flights without effects; trajectories play these parts."""
    observations, shape = observed(made, roles), made.experiment.pose.shape[:3]
    experiment = made.experiment.replace(fitted=observations.fitted)
    nominal = hypothesis(Flights(experiment, made.true, made.start), (), settings)
    phases, events = torch.full(shape, PHASES.index("free_fall")), torch.zeros(shape[:2], dtype=torch.bool)
    return NominalFit(observations, experiment, nominal.fit, Noise(*NOISE), phases, events, settings)


def busy(made: Flights, which: list[int]) -> Flights:
    """Say that some segments have events in them."""
    made.experiment.predictor.segments.contact[which] = True
    return made


def random(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)
