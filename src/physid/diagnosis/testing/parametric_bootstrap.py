"""How far estimates scatter where impacts amplify: recordings replayed with known parameters are fitted."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.diagnosis.reference.null_simulations import jitter
from physid.diagnosis.reference.replay import replay
from physid.diagnosis.testing.hypothesis import Hypothesis


def bootstrap_spread(hypothesis: Hypothesis, generator: torch.Generator) -> Tensor:
    """Estimate how far the shared parameters diverge without any noise of the sensor.

    The reference simulator makes data from initial states and parameters as uncertain as the fit. One Gauss-Newton step
    fits them again; what it misses of the parameters that made the data is what engines differ by, and what impacts
    amplify.

    Args:
        hypothesis: The fit.
        generator: Source of randomness.

    Returns:
        Mean of e e^T with e the errors, in the coordinates of the fit: unknown parameters, engine, effects; (P, P).
        Zero where no segment is busy: there the scatter over trajectories tells all.
    """
    experiment, fit = hypothesis.experiment, hypothesis.fit
    predictor, count = experiment.predictor, fit.point.nominal.shape[1] + 1 + len(hypothesis.columns)
    replays = hypothesis.settings.parametric_bootstrap.replays
    if not replays or not bool(predictor.segments.contact.any()):
        return torch.zeros(count, count, dtype=torch.float64)
    errors = []
    for _ in range(replays):
        point = jitter(experiment, fit, hypothesis.settings, generator)
        made = replay(
            predictor.model,
            predictor.timeline,
            predictor.segments,
            point,
            hypothesis.settings.replay,
            hypothesis.working,
        )
        error = hypothesis.follow(experiment.replace(pose=made).residual(fit.jacobian.base.pose, fit.point)[0])
        unknown = fit.point.nominal.shape[1]
        error[:unknown] -= (point.nominal - fit.point.nominal)[0]
        errors.append(error)
    table = torch.stack(errors)
    return table.T @ table / replays
