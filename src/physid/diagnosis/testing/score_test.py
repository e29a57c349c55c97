"""The score test: how much each candidate would gain if it were added to the fitted nominal model (Rao 1948)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.diagnosis.settings.testing import ScoreTestSettings
from physid.estimation.least_squares import Normal
from physid.estimation.prediction import EffectParameter


@dataclass(frozen=True)
class Group:
    """The columns that belong to one hypothesis: the parameters of one effect, or of several.

    Attributes:
        names: The effects.
        columns: Indices among the shared columns, shape (k,).
        typical: Typical changes from no effect, shape (k,).
        largest: The largest changes from no effect that the ranges admit, shape (k,).
        low: Least admissible changes from the present values, shape (k,).
        high: Largest ones, shape (k,).
    """

    names: tuple[str, ...]
    columns: Tensor
    typical: Tensor
    largest: Tensor
    low: Tensor
    high: Tensor

    def unbounded(self) -> Group:
        """Return the same without ranges."""
        return replace(self, low=torch.full_like(self.low, -torch.inf), high=torch.full_like(self.high, torch.inf))


def joined(groups: Sequence[Group]) -> Group:
    """Return several groups as one hypothesis."""
    parts = (
        torch.cat([getattr(one, name) for one in groups]) for name in ("columns", "typical", "largest", "low", "high")
    )
    return Group(tuple(name for one in groups for name in one.names), *parts)


def groups_of(terms: Sequence[EffectParameter], offset: int, present: Tensor) -> list[Group]:
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
                largest=torch.tensor([one.largest for one in known], dtype=torch.float64),
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
        absorbed: How much of each nuisance column fits each column, shape (n, Q).
        solved: How much of each nuisance column fits the data, shape (n, K).
    """

    matrix: Tensor
    vector: Tensor
    nuisance: Tensor
    absorbed: Tensor
    solved: Tensor


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
    return Conditional(
        matrix - across @ matrix[nuisance],
        vector - across @ vector[nuisance],
        nuisance,
        across.T,
        inner @ vector[nuisance],
    )


def gains(conditional: Conditional, group: Group, settings: ScoreTestSettings) -> tuple[Tensor, Tensor]:
    """Compute what a group explains, 2 b . x - x . A x at its best admissible x.

    Args:
        conditional: Normal equations after the nuisances.
        group: Columns and their ranges.
        settings: Which directions are visible.

    Returns:
        Gains of the squared residual (K,), and the changes (K, k).
    """
    matrix = conditional.matrix[group.columns][:, group.columns]
    return _best(matrix[None], conditional.vector[group.columns].T, group, settings.visible)


def steady_gains(conditional: Conditional, group: Group, impacts: Normal, settings: ScoreTestSettings) -> Tensor:
    """Compute what a group still explains without the impact that says most for it.

    What an effect does shows in many impacts; one impact that goes another way in two engines may look like any effect.

    Args:
        conditional: Normal equations after the nuisances, for K data sets.
        group: Columns and their ranges.
        impacts: Normal equations of all columns for the same data sets, one for each of W segments with an impact:
            matrices (W, P, P) and vectors (W, P, K).
        settings: Whether one impact is left out at all.

    Returns:
        Shape (K,).
    """
    gain, change = gains(conditional, group, settings)
    if len(impacts.vector) == 0 or not settings.steady:
        return gain
    clean = change.new_zeros(impacts.vector.shape[1], len(group.columns))
    clean[group.columns, torch.arange(len(group.columns))] = 1
    clean[conditional.nuisance] -= conditional.absorbed[:, group.columns]
    matrix = clean.T @ impacts.matrix @ clean
    vector = clean.T @ (impacts.vector - impacts.matrix[..., conditional.nuisance] @ conditional.solved)
    bent = torch.einsum("ki,wij,kj->wk", change, matrix, change)
    most = (2 * torch.einsum("wik,ki->wk", vector, change) - bent).argmax(0)
    rest = conditional.matrix[group.columns][:, group.columns] - matrix[most]
    left = conditional.vector[group.columns].T - vector[most, :, torch.arange(len(most))]
    return _best(rest, left, group, settings.visible)[0].minimum(gain)


def signals(conditional: Conditional, group: Group, impacts: Normal, settings: ScoreTestSettings) -> Tensor:
    """Compute the steady gain that each parameter of a group makes at its typical size, alone and without noise.

    For small sizes a gain is the square of how far an effect moves the recordings, in units of the noise and beside
    all that a refit absorbs: s times the typical size gains s^2 as much.

    Args:
        conditional: Normal equations after the nuisances; the data in them do not matter.
        group: Columns of an effect.
        impacts: As in `steady_gains`.
        settings: Whether one impact is left out, and which directions are visible.

    Returns:
        Shape (k,), for the k parameters of the group.
    """
    typical = torch.diag(group.typical)
    made = replace(
        conditional,
        vector=conditional.matrix[:, group.columns] @ typical,
        solved=conditional.absorbed[:, group.columns] @ typical,
    )
    return steady_gains(
        made, group.unbounded(), replace(impacts, vector=impacts.matrix[..., group.columns] @ typical), settings
    )


def _best(matrix: Tensor, vector: Tensor, group: Group, visible: float) -> tuple[Tensor, Tensor]:
    """Return gains (K,) and changes (K, k) for matrices (K or 1, k, k) and vectors (K, k)."""
    inverse = visible_inverse(matrix, group, visible)
    best = (inverse @ vector[..., None])[..., 0]
    change = torch.minimum(torch.maximum(best, group.low), group.high)
    gain = 2 * (change * vector).sum(-1) - (change * (matrix @ change[..., None])[..., 0]).sum(-1)
    return gain.clamp_min(0), change


def visible_inverse(matrix: Tensor, group: Group, visible: float) -> Tensor:
    """Return the inverse of matrices (..., k, k) in the directions that the data can see, 0 in the others.

    A direction counts if the largest sizes that the ranges admit make so many standard deviations there: how large an
    effect is in practice says nothing about what these recordings hold.
    """
    size = group.largest
    values, axes = torch.linalg.eigh((matrix + matrix.mT) / 2 * size[:, None] * size)
    inverse = torch.where(values > visible**2, 1 / values.clamp_min(1e-30), torch.zeros_like(values))
    found: Tensor = size[:, None] * ((axes * inverse[..., None, :]) @ axes.mT) * size
    return found
