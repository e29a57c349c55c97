"""The score test: how much each candidate would gain if it were added to the fitted nominal model (Rao 1948)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.diagnosis.linear import Normal
from physid.diagnosis.terms import Term

VISIBLE = 1.0  # a direction in which the typical size stays below so many standard deviations is not tested


@dataclass(frozen=True)
class Group:
    """The columns that belong to one hypothesis: the parameters of one effect, or of several."""

    names: tuple[str, ...]
    columns: Tensor
    typical: Tensor
    low: Tensor
    high: Tensor

    def unbounded(self) -> Group:
        """Return the same without ranges."""
        return replace(self, low=torch.full_like(self.low, -torch.inf), high=torch.full_like(self.high, torch.inf))


def joined(groups: Sequence[Group]) -> Group:
    """Return several groups as one hypothesis."""
    parts = (torch.cat([getattr(one, name) for one in groups]) for name in ("columns", "typical", "low", "high"))
    return Group(tuple(name for one in groups for name in one.names), *parts)


def groups_of(terms: Sequence[Term], offset: int, present: Tensor) -> list[Group]:
    """Make one group per effect, whose columns start at `offset`; changes count from the values `present` (Q,)."""
    groups: dict[str, list[int]] = {}
    for index, term in enumerate(terms):
        groups.setdefault(term.effect.name, []).append(index)
    made = []
    for name, indices in groups.items():
        known = [terms[index].quantity for index in indices]
        chosen = torch.tensor(indices)
        low, high = ([getattr(one, bound) for one in known] for bound in ("low", "high"))
        made.append(
            Group(
                names=(name,),
                columns=chosen + offset,
                typical=torch.tensor([one.typical - one.null for one in known], dtype=torch.float64),
                low=torch.tensor(low, dtype=torch.float64) - present[chosen],
                high=torch.tensor(high, dtype=torch.float64) - present[chosen],
            )
        )
    return made


@dataclass(frozen=True)
class Conditional:
    """Normal equations of all columns after the nuisance columns are solved for.

    Attributes:
        matrix: Shape (Q, Q).
        vector: Shape (Q, K), for K data sets.
        nuisance: Which columns were solved for.
    """

    matrix: Tensor
    vector: Tensor
    nuisance: Tensor


def condition(normal: Normal, nuisance: Tensor, ridge: Tensor) -> Conditional:
    """Solve for the nuisance columns.

    Args:
        normal: Normal equations of the fitted trajectories.
        nuisance: Indices of nuisance columns.
        ridge: Prior precision of the nuisance columns.
    """
    matrix = normal.matrix.sum(0)
    vector = normal.vector.sum(0)
    vector = vector[:, None] if vector.ndim == 1 else vector
    inner = torch.linalg.inv(matrix[nuisance][:, nuisance] + torch.diag(ridge))
    across = matrix[:, nuisance] @ inner
    return Conditional(matrix - across @ matrix[nuisance], vector - across @ vector[nuisance], nuisance)


def gains(conditional: Conditional, group: Group) -> tuple[Tensor, Tensor, Tensor]:
    """Compute what a group explains, 2 b . x - x . A x at its best admissible x.

    Args:
        conditional: Normal equations after the nuisances.
        group: Columns and their ranges.

    Returns:
        Gains of the squared residual (K,), the changes (K, k), and how many standard deviations the typical size
        makes in the directions that the data can see, shape (k,) (0 for the others).
    """
    typical = group.typical
    matrix = conditional.matrix[group.columns][:, group.columns] * typical[:, None] * typical
    vector = conditional.vector[group.columns] * typical[:, None]
    values, axes = torch.linalg.eigh((matrix + matrix.T) / 2)
    seen = values > VISIBLE**2
    inverse = torch.where(seen, 1 / values.clamp_min(1e-30), torch.zeros_like(values))
    best = (axes @ (inverse[:, None] * (axes.T @ vector))).T * typical
    change = torch.minimum(torch.maximum(best, group.low), group.high)
    scaled = change / typical
    gain = 2 * (scaled * vector.T).sum(1) - ((scaled @ matrix) * scaled).sum(1)
    return gain.clamp_min(0), change, torch.where(seen, values.clamp_min(0).sqrt(), torch.zeros_like(values))
