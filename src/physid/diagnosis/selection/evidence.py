"""Which evidence is enough: for a gap, for an effect, for one more, and to tell rivals apart."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from numpy import sign
from scipy.stats import rankdata, wilcoxon
from torch import Tensor

from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.comparison import gain
from physid.diagnosis.selection.materiality import tolerance_of
from physid.diagnosis.testing import Hypothesis, LackOfFit, bootstrap_spread


def sound(nominal: Hypothesis, one: Hypothesis, lack: LackOfFit) -> bool:
    """Return whether a hypothesis explains more than chance, where it was fitted and where it was not."""
    return confirmed(nominal, one) and beyond_chance(nominal, one, lack)


def explained(nominal: Hypothesis, best: Hypothesis, lack: LackOfFit) -> float:
    """Return what the best explains: in squared residual of the fitted trajectories, or by a free residual wrench."""
    return max(gain(nominal, best), lack.excess, 1e-9)


def complete(nominal: Hypothesis, best: Hypothesis, lack: LackOfFit, left: LackOfFit) -> bool:
    """Return whether the best leaves nothing, or so little that laws which differ by a hair account for it.

    More effects follow a foreign law more closely than one: the more are blamed, the less may be left.
    """
    settings = nominal.settings.evidence
    closed = settings.closed * settings.closed_by_more ** (len(best.names) - 1)
    return left.p_value > settings.alpha or left.missing < closed * explained(nominal, best, lack)


def confirmed(nominal: Hypothesis, one: Hypothesis) -> bool:
    """Return whether a hypothesis predicts better than the nominal model where nothing was fitted to."""
    better = _advance(nominal, one)
    return len(better) == 0 or float(better.sum()) > 0


def improves_held_out(nominal: Hypothesis, one: Hypothesis) -> bool:
    """Return whether a hypothesis predicts better there by more than chance lets it."""
    return float(_advance(nominal, one).sum()) > nominal.settings.evidence.least


def _advance(nominal: Hypothesis, one: Hypothesis) -> Tensor:
    """Return how much better each trajectory is predicted that nothing was fitted to, in squared residual."""
    return (nominal.held_out - one.held_out)[~nominal.experiment.fitted]


def beyond_chance(nominal: Hypothesis, one: Hypothesis, lack: LackOfFit) -> bool:
    """Return whether a hypothesis explains more than it does in null simulations."""
    return gain(nominal, one) > lack.reach(one.names)


def evident(nominal: Hypothesis) -> bool:
    """Return whether most trajectories that nothing was fitted to leave the model beyond what any numerics explain.

    After impacts null simulations scatter widely and one effect alone may not stand out from them; the gap does. It is
    that of the median trajectory: an impact that went another way for a hair spoils one of them, and no gap spares the
    others.
    """
    experiment = nominal.experiment
    counts = (experiment.scale > 0).flatten(1).sum(1)
    reported = ~experiment.fitted & (counts > 0)
    squares = nominal.held_out[reported] / counts[reported]
    return bool(reported.any()) and float(squares.median()) > nominal.settings.evidence.evident


def distinguishable(
    nominal: Hypothesis, best: Hypothesis, other: Hypothesis, left: LackOfFit, whole: bool = False
) -> bool:
    """Return whether another hypothesis predicts held-out trajectories clearly worse than the best.

    If the other were true, the squared residuals of both would differ by more than d with a probability of at most
    exp(-d / 2). That bound trusts the noise, and the numerics, which are known to a share of what is explained; where
    the best leaves something (it is not the whole), the difference must exceed that as well, and hold in a paired test
    over trajectories.
    """
    settings, worse = nominal.settings.evidence, other.held_out - best.held_out
    closed = float((nominal.held_out - best.held_out).sum())
    least = max(settings.least, settings.same * closed, 2 * left.excess)
    if left.p_value <= settings.alpha and not whole:
        error = float(worse.std()) * len(worse) ** 0.5
        least = max(least, settings.clear * error)
    return float(worse.sum()) > least


def preferred(one: Hypothesis, other: Hypothesis) -> bool:
    """Return whether trajectories rather prefer a hypothesis to another, by the sum of signed ranks (Wilcoxon 1945).

    Each trajectory is predicted without itself. By how much one prediction is better counts by its rank alone: an
    impact that went another way for a hair costs hundreds of squared residuals, and says nothing of the effect.
    """
    better = (other.held_out - one.held_out).numpy()
    return float((rankdata(abs(better)) * sign(better)).sum()) > 0


def clearly_preferred(one: Hypothesis, other: Hypothesis) -> bool:
    """Return whether trajectories prefer a hypothesis to another beyond chance, by the test of signed ranks.

    What an effect explains shows in the trajectories where it acts, and costs next to nothing in the others. What
    impacts amplify is better here and as much worse there, and its sum may be large.
    """
    better = (other.held_out - one.held_out).numpy()
    chance = float(wilcoxon(better, alternative="greater").pvalue) if better.any() else 1.0
    return chance <= one.settings.evidence.alpha


def least_gain(nominal_fit: NominalFit) -> float:
    """Return what an effect gains by frame that moves predictions by the tolerance d, (d / sigma)^2.

    Of positions or of rotations, whichever is less: it may show in either.

    What a gap must exceed before anything is blamed, each of several effects must add to the others: one that only
    thousands of frames show beside them is as little worth a word as one that they show alone.
    """
    allowed, noise = tolerance_of(nominal_fit), nominal_fit.noise
    return min(allowed.position / noise.position, allowed.rotation / noise.rotation) ** 2


def all_needed(
    more: Hypothesis,
    nominal: Hypothesis,
    fewer: Sequence[Hypothesis],
    left: LackOfFit,
    least: float,
    generator: torch.Generator,
) -> bool:
    """Return whether effects account for most of what one fewer leave, and for more than each choice of one fewer does.

    Each must move predictions by the tolerance beside the others, where effects were fitted and where nothing was:
    what some law takes up of an error of another kind, fitted trajectories alone show. None may have sizes that are
    known no better than that they may be null, by noise or by what impacts amplify.

    Args:
        more: The effects.
        nominal: The model without effects.
        fewer: Hypotheses of fewer effects, the best first.
        left: What the best of these leaves.
        least: What each effect must gain by frame beside the others, see `least_gain`.
        generator: Randomness of the replays that tell what impacts amplify.
    """
    settings = nominal.settings.evidence
    if gain(fewer[0], more) < settings.further_explains * left.missing or more.absent(more.covariance()):
        return False
    clear = max(settings.least, settings.same * float((nominal.held_out - more.held_out).sum()))
    fitted = more.experiment.fitted
    frames = (more.experiment.scale > 0).flatten(2).any(2).sum(1)
    moved, moved_held_out = (least * float(frames[rows].sum()) for rows in (fitted, ~fitted))
    better = all(
        float((one.held_out - more.held_out).sum()) > clear
        and gain(one, more) > max(moved, left.reach(more.names))
        and float(_advance(one, more).sum()) >= moved_held_out
        for one in fewer
        if set(one.names) < set(more.names)
    )
    return better and not more.absent(more.covariance() + bootstrap_spread(more, generator))
