"""Effects that recordings cannot tell apart: their signatures point in one direction once all else is refitted."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physid.diagnosis.testing.hypothesis import Hypothesis
from physid.diagnosis.testing.lack_of_fit import LackOfFit
from physid.diagnosis.testing.score_test import Conditional, Group, condition, visible_inverse
from physid.estimation.least_squares import prior


def alike(lack: LackOfFit, best: Hypothesis, tried: Sequence[Hypothesis] = ()) -> tuple[str, ...]:
    """List the effects that could take the place of a part of the best hypothesis, see `twins`."""
    return tuple(dict.fromkeys(rival for _, rival in twins(lack, best, tried)))


def twins(lack: LackOfFit, best: Hypothesis, tried: Sequence[Hypothesis] = ()) -> list[tuple[str, str]]:
    """List parts of the best hypothesis, each with an effect that could take its place, to first order.

    Only contact-free segments count, for where an impact falls in time is beyond a linear model: a clock that runs fast
    and a stronger gravity are one in every flight, and differ in impacts that fall into another step.

    Args:
        lack: The nominal model, linearised with all candidates.
        best: The hypothesis, whose fitted values give the direction of each part.
        tried: Other fitted hypotheses. Laws that start alike may part at the size that the data want, as a lag and a
            delay do: one that is fitted with such an effect in place of the part, and leaves more of the contact-free
            segments, has been distinguished.
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
        rest = set(best.names) - set(part.names)
        found += [
            (part.names[0], one.names[0])
            for one in rivals
            if cosine(calm_of, part, direction, one, visible) >= least
            and not any(set(other.names) == rest | set(one.names) and leaves_more(best, other) for other in tried)
        ]
    return found


def leaves_more(best: Hypothesis, other: Hypothesis) -> bool:
    """Return whether another hypothesis fits contact-free segments worse than the best, by more than chance lets it."""
    calm = ~best.experiment.predictor.segments.contact
    return float((other.fit.loss - best.fit.loss)[calm].sum()) > best.settings.evidence.least


def cosine(given: Conditional, part: Group, direction: Tensor, other: Group, visible: float) -> float:
    """Compute the share of a signature that another effect can make, 1 if they are one (a squared cosine).

    Args:
        given: Normal equations after the nuisances.
        part: The effect.
        direction: Change of its parameters, shape (k,).
        other: The other effect, which may change its parameters at will, as far as they show.
        visible: From how many standard deviations of their largest size on they do.
    """
    across = given.matrix[other.columns][:, part.columns] @ direction
    inverse = visible_inverse(given.matrix[other.columns][:, other.columns], other, visible)
    made = float(across @ inverse @ across)
    return made / max(_energy(given, part, direction), 1e-30)


def _energy(given: Conditional, part: Group, direction: Tensor) -> float:
    return float(direction @ given.matrix[part.columns][:, part.columns] @ direction)
