"""Effects that recordings cannot tell apart: their signatures point in one direction once all else is refitted."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.diagnosis.testing.hypothesis import Hypothesis
from physid.diagnosis.testing.lack_of_fit import LackOfFit
from physid.diagnosis.testing.score_test import Conditional, Group, condition
from physid.estimation.least_squares import prior


def alike(lack: LackOfFit, best: Hypothesis) -> tuple[str, ...]:
    """List the effects that could take the place of a part of the best hypothesis, to first order.

    Only contact-free segments count, for where an impact falls in time is beyond a linear model: a clock that runs fast
    and a stronger gravity are one in every flight, and differ in impacts that fall into another step.

    Args:
        lack: The nominal model, linearised with all candidates.
        best: The hypothesis, whose fitted values give the direction of each part.
    """
    experiment, settings = best.experiment, best.settings
    contact_free = (~experiment.predictor.segments.contact).to(torch.float64)
    whole, quiet = (lack.fit.linear.normal(share).of(experiment.fitted) for share in (None, contact_free))
    offset = lack.fit.point.nominal.shape[1] + 1
    change = best.fit.point.effects[0] - lack.fit.point.effects[0]
    found = []
    for part in (group for group in lack.groups if group.names[0] in best.names):
        others = [group.columns for group in lack.groups if group.names[0] in best.names and group is not part]
        nuisance = torch.cat([torch.arange(offset), *others])
        shared = torch.arange(offset + len(change))
        always = prior(experiment, torch.zeros(0, dtype=torch.int64))
        ridge = torch.cat([always, *(prior(experiment, each - offset)[offset:] for each in others)])
        all_of, calm_of = (condition(normal.select(shared), nuisance, ridge) for normal in (whole, quiet))
        direction = change[part.columns - offset]
        if _energy(calm_of, part, direction) < settings.equivalence.contact_free * _energy(all_of, part, direction):
            continue
        rivals = (group for group in lack.groups if group.names[0] not in best.names)
        visible, least = settings.score_test.visible, settings.equivalence.alike
        found += [one.names[0] for one in rivals if cosine(calm_of, part, direction, one, visible) >= least]
    return tuple(dict.fromkeys(found))


def cosine(given: Conditional, part: Group, direction: Tensor, other: Group, visible: float) -> float:
    """Compute the share of a signature that another effect can make, 1 if they are one (a squared cosine).

    Args:
        given: Normal equations after the nuisances.
        part: The effect.
        direction: Change of its parameters, shape (k,).
        other: The other effect, which may change its parameters at will, as far as they show.
        visible: From how many standard deviations of a typical size on they do.
    """
    size = other.typical
    matrix = given.matrix[other.columns][:, other.columns] * size[:, None] * size
    across = given.matrix[other.columns][:, part.columns] @ direction * size
    values, axes = torch.linalg.eigh((matrix + matrix.T) / 2)
    inverse = torch.where(values > visible**2, 1 / values.clamp_min(1e-30), torch.zeros_like(values))
    made = float(((axes.T @ across).square() * inverse).sum())
    return made / max(_energy(given, part, direction), 1e-30)


def _energy(given: Conditional, part: Group, direction: Tensor) -> float:
    return float(direction @ given.matrix[part.columns][:, part.columns] @ direction)
