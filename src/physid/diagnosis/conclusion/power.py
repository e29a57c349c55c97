"""What could have been found: the least size of each effect that these recordings show, with a given probability."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from physid.diagnosis.document.document import Detectable
from physid.diagnosis.selection.materiality import Tolerance
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing import LackOfFit, Tail
from physid.estimation.measurement import Noise
from physid.estimation.prediction import EffectParameter


def detectable_sizes(
    lack: LackOfFit, terms: Sequence[EffectParameter], noise: Noise, tolerance: Tolerance, settings: Settings
) -> list[Detectable]:
    """Compute which size of each parameter would have been found, beside what the hypothesis has already.

    An effect is found if its steady gain stands out from those of null simulations (see `LackOfFit.p_best`) and if it
    moves predicted positions by more than the tolerance (see `unexplained_size`). Both are thresholds of a gain, and
    the expected gain grows with the square of the size.

    Args:
        lack: What the hypothesis leaves, linearised with all candidates.
        terms: Parameters of the candidates.
        noise: Of the poses.
        tolerance: Below it nothing is blamed.
        settings: The level of the test, its margin, and the probability.
    """
    rare = float(lack.null_steady.quantile(1 - settings.evidence.alpha / 2))
    material = lack.frames * (tolerance.position / noise.position) ** 2
    known = {(term.effect.name, term.name): term.quantity for term in terms}
    named = {name: [term.name for term in terms if term.effect.name == name] for name, _ in known}
    found = []
    for row in lack.rows:
        threshold = max(settings.lack_of_fit.margin * float(row.steady_tail.gain(rare)), material)
        factors = detectable_factors(row.signal, threshold, row.steady_tail, settings.power.probability)
        for parameter, factor in zip(named[row.names[0]], factors.tolist(), strict=True):
            what = known[row.names[0], parameter]
            typical = abs(what.typical - what.null)
            size = factor * typical
            found.append(
                Detectable(row.names[0], parameter, size if size <= what.largest else None, typical, what.unit)
            )
    return found


def detectable_factors(signal: Tensor, threshold: float, tail: Tail, probability: float) -> Tensor:
    """Compute how many typical sizes gain more than a threshold with a given probability.

    The gain of one parameter is (sqrt(l) + sqrt(c) z)^2, with l the gain without noise, z standard normal and c the
    variance of its null distribution over twice the mean (1 for white noise), hence sqrt(l) = sqrt(threshold) + z_p
    sqrt(c). Further parameters of the effect only add to the gain.

    Args:
        signal: Gain without noise at the typical size, shape (k,).
        threshold: Gain from which on an effect is found.
        tail: Null distribution of the gain.
        probability: Of being found.

    Returns:
        Shape (k,); infinite where the recordings do not show the parameter.
    """
    from scipy.stats import norm

    scale = float(tail.variance / (2 * tail.mean))
    needed = math.sqrt(threshold) + float(norm.ppf(probability)) * math.sqrt(scale)
    return torch.where(signal > 0, needed / signal.clamp_min(1e-30).sqrt(), torch.inf)
