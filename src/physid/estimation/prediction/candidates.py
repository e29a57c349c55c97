"""Candidate effects of an experiment, and which of them are at work in its variants."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import torch
from torch import Tensor

from physid.estimation.prediction.effect_parameters import EffectParameter
from physid.estimation.prediction.step_effects import acts_late, has, only_steps, with_values
from physid.physics import Effect

EffectKinds = Sequence[type[Effect]]
"""Classes of effects that may be at work."""


class Candidates:
    """Effects that may be at work.

    Args:
        kinds: Them; their parameters are the columns Q of `Variants.effects`, in this order.

    Attributes:
        kinds: The same.
        terms: Their parameters.
        null: The values at which they do nothing, shape (Q,).
    """

    def __init__(self, kinds: EffectKinds) -> None:
        self.kinds = tuple(kinds)
        self.terms = tuple(EffectParameter(effect, name) for effect in kinds for name in effect.quantities())
        self.null = torch.tensor([term.quantity.null for term in self.terms], dtype=torch.float64)
        ends = list(accumulate(len(kind.quantities()) for kind in self.kinds))
        initial = [0, *ends][:-1]
        self._columns = [(kind, slice(*ends)) for kind, *ends in zip(self.kinds, initial, ends, strict=True)]

    def act_late(self, columns: Tensor) -> bool:
        """Return whether effects of some parameters (indices) move changes of a force in time."""
        return any(acts_late(self.terms[k].effect) for k in columns.tolist())

    def at_work(self, effects: Tensor, hook: str, copies: int) -> list[tuple[Effect, Tensor]]:
        """List the candidates with `hook` that are not null in some variant, and the rows (variant x copy) where."""
        working = []
        for kind, part, on in self._on(effects, hook):
            rows = on.repeat_interleave(copies).nonzero()[:, 0]
            working.append((with_values(kind, part.repeat_interleave(copies, 0)[rows]), rows))
        return working

    def observing(self, effects: Tensor, copies: int) -> list[tuple[Effect, Tensor]]:
        """List those of which a camera reports poses otherwise, but for its clock, and the rows where."""
        observing = self.at_work(effects, "observe", copies)
        return [(effect, rows) for effect, rows in observing if not has(type(effect), "elapse")]

    def at_steps(self, known: Sequence[Effect], effects: Tensor, segments: int) -> list[Effect]:
        """List what acts at the step: known effects, then candidates, with a value for each segment and variant."""
        acting = [only_steps(effect) for effect in known if has(type(effect), "act")]
        return acting + [
            only_steps(with_values(kind, part.repeat(segments, 1))) for kind, part, _ in self._on(effects, "act")
        ]

    def _on(self, effects: Tensor, hook: str) -> list[tuple[type[Effect], Tensor, Tensor]]:
        """List the candidates with `hook` that are not null in some variant, their parameters (C, q), and where."""
        on = effects != self.null
        found = []
        for kind, columns in self._columns:
            if has(kind, hook) and bool(on[:, columns].any()):
                found.append((kind, effects[:, columns], on[:, columns].any(1)))
        return found
