"""What numerics do: which reference simulators count, and how little segments do in which engines part."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import torch
from torch import Tensor

from physid.diagnosis.progress import Progress, Stage
from physid.diagnosis.reference.discrepancy import fit_with_reference
from physid.diagnosis.reference.null_simulations import floors, left_by_states
from physid.diagnosis.reference.replay import Reference, references_of, replay
from physid.diagnosis.settings.settings import Settings
from physid.estimation.least_squares import NONE, Experiment, Fit
from physid.estimation.measurement import pose_difference

MODEL = "model"


def count_numerics(
    experiment: Experiment, fit: Fit, settings: Settings, generator: torch.Generator, say: Progress
) -> tuple[Experiment, Fit, Settings]:
    """Let segments count less by what null simulations show of the numerics there, and fit once more.

    Returns:
        The experiment, the fit, and the settings with the reference simulators that count from here on.
    """
    settings = keep_agreeing(experiment, fit, settings, say)
    say(Stage.MEASURING_NUMERICS)
    extra = (1 + floors(experiment, fit, settings, generator)).rsqrt()
    segments = experiment.predictor.segments
    experiment = experiment.replace(scale=experiment.scale * segments.spread(extra)[..., None, None])
    return *fit_with_reference(experiment, fit, NONE, (), settings, say), settings


def keep_agreeing(experiment: Experiment, fit: Fit, settings: Settings, say: Progress) -> Settings:
    """Leave out reference simulators that stand alone, far off the model and off all others.

    Three independent engines show which one is wrong: where two go the same way from the same states, and the third
    another one by more than the noise, the error is its own, and null simulations of it would hide what the model
    lacks. Where all three differ, each may be right, and all stay. Distances are root mean squares in standard
    deviations of the noise, after initial states are fitted anew; of the segments the median, since after an impact
    any two engines may part for a hair.

    Args:
        experiment: The nominal model, which is one of the engines.
        fit: The states and parameters that all start from.
        settings: Which references there are, and how far one must be off.
        say: Called with what is being done.

    Returns:
        The settings, of which those of the replays name the references that count.
    """
    limits = settings.replay
    model = experiment.predictor.model
    references = references_of(model.scene, limits, model.effects_at(fit.point.nominal))
    kept = tuple(one.name for one in references)
    if len(references) > 1:
        say(Stage.REPLAYING_NOMINAL)
        apart = _distances(experiment, fit, references, settings)
        kept = tuple(name for name in kept if not _alone(name, apart, limits.far, limits.farther)) or kept
    return settings.changed({"replay.simulators": kept})


def _distances(
    experiment: Experiment, fit: Fit, references: Sequence[Reference], settings: Settings
) -> dict[frozenset[str], float]:
    """Return how far each two of the engines are apart."""
    motions = {MODEL: fit.jacobian.base.pose[0]} | {
        one.name: _replayed(experiment, fit, one, settings) for one in references
    }
    return {
        frozenset(pair): _distance(experiment, fit, *(motions[name] for name in pair))
        for pair in combinations(motions, 2)
    }


def _alone(name: str, apart: dict[frozenset[str], float], far: float, farther: float) -> bool:
    """Return whether one engine is far from every other, and farther than these are from each other."""
    own = min(distance for pair, distance in apart.items() if name in pair)
    others = max(distance for pair, distance in apart.items() if name not in pair)
    return own > max(far, farther * others)


def _replayed(experiment: Experiment, fit: Fit, reference: Reference, settings: Settings) -> Tensor:
    """Return what a reference makes of the fit, shape (R, T, N, 7); frames of no segment are as predicted."""
    predictor = experiment.predictor
    made = replay(
        predictor.model, predictor.timeline, predictor.segments, fit.point, settings.replay, reference=reference
    )
    inside = predictor.segments.spread(torch.ones(len(predictor.segments), dtype=torch.bool))
    return torch.where(inside[..., None, None], made, fit.jacobian.base.pose[0])


def _distance(experiment: Experiment, fit: Fit, one: Tensor, other: Tensor) -> float:
    """Return the median over the segments of the root mean square difference, in units of the noise."""
    return float(left_by_states(experiment, fit, pose_difference(one, other)[None]).sqrt().median())
