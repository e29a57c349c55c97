"""Initial poses as unknowns of each trajectory: neither what is read from an image nor a label is ever exact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import torch
from torch import Tensor

from physid.estimation.least_squares import Directions, Experiment, Fit
from physid.networks import PlanarChart
from physid.training.initial_states import Explaining, fit_states, started_from
from physid.training.parameters import PoseLoss, Trajectories

if TYPE_CHECKING:
    from physid.training.vision import VideoModel

MOST = 4
"""Steps of a fit; readings are off by a millimetre, and the second step already changes little."""


@final
@dataclass(frozen=True)
class Placing:
    """Trajectories whose initial poses are fitted to their motion, each to its own.

    A hit makes a small error of a initial pose large and lopsided, which no number of trajectories averages out. First
    poses are therefore unknowns of each trajectory, as in SysID, and what is known of them is one pose among the
    others: the parameters only answer for what no other initial pose explains (variable projection, Golub & Pereyra
    1973).

    Attributes:
        trajectories: With origins at the fitted initial poses.
    """

    trajectories: Trajectories
    _experiment: Experiment
    _fit: Fit

    def reduce(self, answer: Tensor, loss: PoseLoss, real: Tensor) -> Tensor:
        """Take out of the derivatives J (P, B, T, N, 6) what other initial poses would do as well; the same shape."""
        scale = self._experiment.scale
        rest = self._fit.linear.profile(answer.cpu() * scale) / torch.where(scale > 0, scale, 1.0)
        return rest.to(answer)


@torch.no_grad()
def place(model: VideoModel, loss: PoseLoss, trajectories: Trajectories, real: Tensor) -> Placing:
    """Fit the initial poses of trajectories, and their velocities unless these start at rest.

    Args:
        model: Gives physics, parameters, and whether bodies lie on the ground.
        loss: What errors of predicted poses cost.
        trajectories: Initial states, wrenches, and the poses that should come out.
        real: Which frames count, shape (B, T).
    """
    chart, start = model.chart, trajectories.start
    explaining = Explaining(model.layer, model.physical, loss, trajectories, counted=real)
    lying = isinstance(chart, PlanarChart) and not chart.hovering
    up = torch.tensor(model.up, dtype=torch.float64)
    free = Directions.of(up, torch.full(start.pose.shape[:2], lying))
    free = free.without_speed() if model.start.at_rest else free
    experiment, fit = fit_states(explaining, MOST, states=(start.pose.cpu(), start.twist.cpu()), directions=free)
    return Placing(started_from(trajectories, fit), experiment, fit)
