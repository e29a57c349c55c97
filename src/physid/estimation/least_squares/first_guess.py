"""First values of the unknown parameters, found over short segments: a guess that is far off leaves no slope."""

from __future__ import annotations

import torch

from physid.estimation.least_squares.experiment import Experiment, Fit
from physid.estimation.least_squares.levenberg_marquardt import NONE, gauss_newton
from physid.estimation.least_squares.line_search import try_losses
from physid.estimation.prediction.variants import Variants
from physid.setting import Section, setting


class FirstGuess(Section):
    """First values over short segments, each with an initial state of its own: errors have no time to grow in them."""

    seconds: float = setting(30 / 240, "s", "length of the segments", gt=0)
    frames: int = setting(10, "frames", "of these segments at least", ge=3)
    factors: tuple[float, ...] = setting(
        (1.0, 0.5, 0.25, 2.0, 4.0), "-", "times the first guess of an unknown parameter, that are tried"
    )
    steps: int = setting(5, "steps", "most Gauss-Newton steps from the best of them", ge=1)

    def length(self, time_step: float) -> int:
        """Return the frames of a segment at a time between frames [s]."""
        return max(round(self.seconds / time_step), self.frames)

    def fit(self, experiment: Experiment, point: Variants) -> Fit:
        """Fit short segments from the best multiples of the first guesses.

        Args:
            experiment: Short segments.
            point: Guesses of their initial states, and of the parameters.

        Raises:
            SolverError: If the physics has no solution at the point.
        """
        return gauss_newton(experiment, self._scanned(experiment, point), NONE, steps=self.steps)

    def _scanned(self, experiment: Experiment, point: Variants) -> Variants:
        """Try multiples of the first guesses, one unknown parameter after the other."""
        model = experiment.predictor.model
        counts = experiment.fitted[experiment.predictor.segments.trajectory]
        for column in range(len(model.unknown)):
            many = point.repeat(len(self.factors))
            values = model.to_values(many.nominal)
            values[:, column] *= torch.tensor(self.factors, dtype=torch.float64)
            many = many.replace(nominal=model.to_coordinates(values))
            losses = try_losses(experiment, many)[:, counts].clamp_max(1e12).sum(1)
            best = int(losses.argmin())
            point = many[best : best + 1]
        return point
