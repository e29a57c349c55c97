"""Trajectories as an experiment of `physid.estimation`, which fits parameters and initial states."""

from __future__ import annotations

import copy
import dataclasses
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor

from physid.estimation.least_squares import Experiment, Fit, best_guess, lay_out
from physid.estimation.prediction import Predictor, Timeline, Variants
from physid.physics import PhysicsLayer
from physid.training.parameters import PhysicalParameters, PoseLoss, Trajectories

States = tuple[Tensor, Tensor]


@final
@dataclass(frozen=True)
class Explaining:
    """Trajectories, what a model makes of them, and what an error costs.

    Attributes:
        layer: The physics.
        physical: The physical parameters.
        loss: What an error of the poses costs.
        trajectories: What was recorded, B of T frames.
        fitted: Whether initial states are fitted; else they are those of the trajectories.
        counted: Which frames count, shape (B, T); None for all that are real.
    """

    layer: PhysicsLayer
    physical: PhysicalParameters
    loss: PoseLoss
    trajectories: Trajectories
    fitted: bool = True
    counted: Tensor | None = None

    def begin(self, coordinates: Tensor | None = None, states: States | None = None) -> tuple[Experiment, Variants]:
        """Return the experiment, each trajectory whole, and a point to begin with.

        Residuals are in units of the noise of the poses; a loss that weighs rotations in another way keeps its weights
        relative to positions. Where it is robust, frames are weighed by how far they are off at the point.

        Args:
            coordinates: Of the parameters, (P,); None for the present ones.
            states: Poses (B, N, 7) and twists (B, N, 6) to begin with where they are fitted; None for the best guess.
        """
        cut = self.trajectories.stepped(self.layer.world.time_step).to("cpu")
        assert cut.time is not None and cut.grid is not None
        physical = copy.deepcopy(self.physical).cpu()
        nominal = (physical.coordinates.detach() if coordinates is None else coordinates.cpu())[None]
        predictor = Predictor.of_whole(physical.model(self.layer), Timeline(cut.time, cut.grid), cut.length)
        every = torch.ones(len(cut), dtype=torch.bool)
        experiment, initial = lay_out(predictor, cut.pose, self._scale(cut), every, cut.noise.rotation)
        if not self.fitted:
            experiment = experiment.with_known_states()
            states = cut.start.pose, cut.start.twist
        if states is None:
            point = best_guess(experiment, initial, nominal)
        else:
            point = Variants.of_states(states[0][None], states[1][None], nominal, predictor.null[None])
        return self._weighed(experiment, point, cut), point

    def quadratic(self, fit: Fit) -> tuple[Tensor, Tensor]:
        """Return second derivatives (P, P) and slope (P,) of the mean loss near a fit; initial states follow."""
        normal, here = fit.normal(), self.physical.coordinates
        factor, count = 2 * self.unit() / len(self.trajectories), len(here)
        matrix, vector = normal.matrix.sum(0)[:count, :count], normal.vector.sum(0)[:count]
        return (factor * matrix).to(here), (-factor * vector).to(here)

    def unit(self) -> float:
        """Return the loss, summed over trajectories, of a squared residual in units of the noise."""
        cut = self.trajectories.to("cpu")
        return cut.noise.position**2 / self._frames(cut)

    def _frames(self, cut: Trajectories) -> float:
        return float((cut.real if self.counted is None else self.counted.cpu()).sum(1).double().mean())

    def _scale(self, cut: Trajectories, residual: Tensor | None = None) -> Tensor:
        """Return one over the standard deviation of the noise times the root of the weight, shape (B, T, N, 6)."""
        real = cut.real if self.counted is None else self.counted.cpu()
        weights = self.loss.weights(torch.zeros_like(cut.pose[..., :6]) if residual is None else residual, real)
        weights = weights * cut.share[:, None, None, None]
        return (weights * self._frames(cut)).sqrt() / cut.noise.position

    def _weighed(self, experiment: Experiment, point: Variants, cut: Trajectories) -> Experiment:
        if self.loss.robust is None:
            return experiment
        residual = experiment.residual(experiment.predictor.predict(point).pose, point)[0]
        return experiment.replace(scale=self._scale(cut, residual))


def started_from(trajectories: Trajectories, fit: Fit) -> Trajectories:
    """Return trajectories that are predicted from the initial states of a fit."""
    return started(trajectories, fit.jacobian.base.state[0, :, 0], fit.point.twist[0])


def started(trajectories: Trajectories, pose: Tensor, twist: Tensor) -> Trajectories:
    """Return trajectories that are predicted from other states, (B, N, 7) and (B, N, 6)."""
    origin = torch.cat([pose, twist], -1).to(trajectories.pose)
    return dataclasses.replace(trajectories, origin=origin)
