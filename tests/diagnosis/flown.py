"""Diagnoses of boxes in free flight, where all is linear and a replay takes milliseconds."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import torch
from torch import Tensor

from estimation.flights import NOISE, Flights
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


def busy(made: Flights, which: list[int]) -> Flights:
    """Say that some segments have events in them."""
    made.experiment.predictor.segments.contact[which] = True
    return made


def random(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)
