"""How far gains reach by chance, effect by effect: in null simulations, and where impacts fit badly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Tail:
    """The distribution of a gain under chance: a gamma distribution with the mean and the variance that were seen.

    What k parameters gain from white noise is chi-squared with k degrees of freedom, which is one of these; impacts
    make the tail longer. A multiple of the mean would ask twice as much of three parameters as of one.

    Attributes:
        mean: At least 1.
        variance: At least twice the mean, as for chi-squared.
    """

    mean: Tensor
    variance: Tensor

    @staticmethod
    def of(gains: Tensor) -> Tail:
        """Return the tail of gains in Z data sets, shape (..., Z)."""
        mean = gains.mean(-1).clamp_min(1)
        return Tail(mean, gains.var(-1).maximum(2 * mean))

    def deviation(self, gain: Tensor | float) -> Tensor:
        """Return the standard normal deviation that is as rare as a gain (Wilson and Hilferty 1931).

        z = 3 sqrt(a) ((gain / mean)^(1/3) - 1 + 1 / (9 a)), where a = mean^2 / variance.
        """
        shape = self._shape
        return 3 * shape.sqrt() * ((gain / self.mean).pow(1 / 3) - 1 + 1 / (9 * shape))

    def gain(self, deviation: Tensor | float) -> Tensor:
        """Return the gain that is as rare as a deviation, the inverse of `deviation`; at least 0."""
        shape = self._shape
        root = deviation / (3 * shape.sqrt()) + 1 - 1 / (9 * shape)
        return self.mean * root.clamp_min(0) ** 3

    def __getitem__(self, place: int) -> Tail:
        return Tail(self.mean[place], self.variance[place])

    @property
    def _shape(self) -> Tensor:
        return self.mean**2 / self.variance


def together(tails: Sequence[Tail]) -> Tail:
    """Return the tail of a sum of gains that know nothing of each other; of none, that of one parameter."""
    if not tails:
        return Tail(torch.ones((), dtype=torch.float64), torch.full((), 2.0, dtype=torch.float64))
    means, variances = ([getattr(one, name) for one in tails] for name in ("mean", "variance"))
    return Tail(torch.stack(means).sum(0), torch.stack(variances).sum(0))
