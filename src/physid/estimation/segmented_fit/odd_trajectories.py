"""Trajectories that a model explains with parameters of their own alone: of another body, say, on another ground."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.estimation.least_squares import NONE, Experiment, Fit, gauss_newton
from physid.estimation.prediction import NominalModel
from physid.estimation.segmented_fit.settings import OddSettings


@dataclass(frozen=True)
class OddTrajectory:
    """A trajectory that has parameters of its own.

    Attributes:
        row: Which one.
        own: The model's unknown parameters for it alone, in the coordinates that are fitted, shape (P,).
        others: The parameters of the others, those that are odd left out, shape (P,).
    """

    row: int
    own: Tensor
    others: Tensor

    def compared(self, model: NominalModel) -> tuple[list[str], list[float], list[float]]:
        """Return names of the parameters, their values and those of the others."""
        own, others = (model.to_values(each).tolist() for each in (self.own, self.others))
        return [one.name for one in model.coordinates.unknowns], own, others


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
        among: Trajectories that may be odd; the others are not looked at, shape (R,).
        settings: What is explained, and how many may be odd.

    Returns:
        The odd ones; none where the model explains all, or not the others.
    """
    rows, left = among.nonzero()[:, 0], among.clone()
    without = fit
    if not fit.point.nominal.shape[1] or bool((_misfit(experiment, fit)[rows] <= settings.misfit).all()):
        return ()
    for _ in range(max(1, int(settings.share * len(rows)))):
        left[_worst(_misfit(experiment, without), left)] = False
        if int((left & experiment.fitted).sum()) < settings.others:
            return ()
        without = gauss_newton(experiment.replace(fitted=left & experiment.fitted), without.point, NONE)
        if bool((_misfit(experiment, without)[left] <= settings.misfit).all()):
            break
    else:
        return ()
    found, stands_out = [], _misfit(experiment, without)
    for row in (among & ~left).nonzero()[:, 0].tolist():
        own = torch.zeros_like(left)
        own[row] = True
        alone = gauss_newton(experiment.replace(fitted=own), without.point, NONE)
        if float(_misfit(experiment, alone)[row]) > settings.misfit or stands_out[row] < settings.beyond:
            return ()
        found.append(OddTrajectory(row, alone.point.nominal[0], without.point.nominal[0]))
    return tuple(found)


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
