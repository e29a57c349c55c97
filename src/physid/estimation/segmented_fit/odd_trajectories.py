"""Trajectories that a model explains with parameters of their own alone: of another body, say, on another ground."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

import torch
from torch import Tensor

from physid.estimation.least_squares import NONE, Experiment, Fit, gauss_newton, search
from physid.estimation.prediction import Variants
from physid.estimation.segmented_fit.settings import OddSettings
from physid.physics import SolverError


@dataclass(frozen=True)
class OddTrajectory:
    """A trajectory that has parameters of its own.

    Attributes:
        row: Which one.
        names: What it has of its own: one parameter if one alone explains it, else all.
        own: Their values, roughly: they are those of one trajectory.
        others: Their values for the others, those that are odd left out.
    """

    row: int
    names: tuple[str, ...]
    own: tuple[float, ...]
    others: tuple[float, ...]


def odd_trajectories(
    experiment: Experiment, fit: Fit, among: Tensor, settings: OddSettings
) -> tuple[OddTrajectory, ...]:
    """Find the few trajectories without which the model explains all others, and which it explains alone.

    The one with the largest misfit is left out, and parameters are fitted to the others, again and again (the forward
    search for outliers of Hadi & Simonoff 1993, from the other end). An effect that the model lacks shows in many
    trajectories, or leaves a misfit that no parameters explain.

    Args:
        experiment: What was fitted.
        fit: The fit.
        among: Trajectories that may be odd; the others are not inspected, shape (R,).
        settings: What is explained, and how many may be odd.

    Returns:
        The odd ones; none where the model explains all, or not the others, or where the physics of a try has no
        solution.
    """
    with contextlib.suppress(SolverError):
        return _odd_trajectories(experiment, fit, among, settings)
    return ()


def _odd_trajectories(
    experiment: Experiment, fit: Fit, among: Tensor, settings: OddSettings
) -> tuple[OddTrajectory, ...]:
    rows, left = among.nonzero()[:, 0], among.clone()
    without = fit
    if (
        not fit.point.nominal.shape[1]
        or len(rows) > settings.among
        or bool((_misfit(experiment, fit)[rows] <= settings.misfit).all())
    ):
        return ()
    for _ in range(min(max(1, int(settings.share * len(rows))), settings.most)):
        left[_worst(_misfit(experiment, without), left)] = False
        if int((left & experiment.fitted).sum()) < settings.others:
            return ()
        others = experiment.replace(fitted=left & experiment.fitted)
        without = gauss_newton(others, without.point, NONE)
        if not bool((_misfit(experiment, without)[left] <= settings.misfit).all()):
            # Initial states may still lie where they explained most with the parameters of the odd one.
            without = gauss_newton(others, search(others, without), NONE)
        if bool((_misfit(experiment, without)[left] <= settings.misfit).all()):
            break
    else:
        return ()
    odd, stands_out = (among & ~left).nonzero()[:, 0].tolist(), _misfit(experiment, without)
    if bool((stands_out[odd] < settings.beyond).any()):
        return ()
    found = [_explained(experiment, without.point, row, settings) for row in odd]
    return tuple(one for one in found if one is not None) if None not in found else ()


def _explained(experiment: Experiment, point: Variants, row: int, settings: OddSettings) -> OddTrajectory | None:
    """Explain a trajectory by one parameter of its own, or else by all; None where that leaves more than noise."""
    alone, model = torch.zeros_like(experiment.fitted), experiment.predictor.model
    alone[row] = True
    others = model.to_values(point.nominal[0]).tolist()

    def by(which: list[int]) -> tuple[float, OddTrajectory]:
        predictor = experiment.predictor.with_model(model.with_unknown(which, point.nominal[0]))
        begun = point.replace(nominal=point.nominal[:, which])
        fit = gauss_newton(experiment.replace(fitted=alone, predictor=predictor), begun, NONE)
        own, names = predictor.model.to_values(fit.point.nominal[0]).tolist(), tuple(model.unknown[k] for k in which)
        return float(_misfit(experiment, fit)[row]), OddTrajectory(
            row, names, tuple(own), tuple(others[k] for k in which)
        )

    misfit, one = min((by([k]) for k in range(len(others))), key=lambda each: each[0])
    if misfit > settings.misfit and len(others) > 1:
        misfit, one = by(list(range(len(others))))
    return one if misfit <= settings.misfit else None


def _worst(misfit: Tensor, among: Tensor) -> int:
    return int(torch.where(among, misfit, -torch.inf).argmax())


def _misfit(experiment: Experiment, fit: Fit) -> Tensor:
    """Return the mean squared residual of each trajectory, in that of the noise, shape (R,).

    Segments with impacts are left out: after these, residuals are those of tiny differences before.
    """
    segments = experiment.predictor.segments
    scale = experiment.scale * ~segments.spread(segments.contact)[..., None, None]
    mean: Tensor = (fit.residual * scale).square().sum((1, 2, 3)) / (scale > 0).sum((1, 2, 3)).clamp_min(1)
    return mean
