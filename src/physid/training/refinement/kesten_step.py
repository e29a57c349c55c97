"""Shorter steps where they turn back: for sums of squares that are not smooth, so that full steps swing."""

from __future__ import annotations

from typing import final

import torch
from torch import Tensor, nn

BACK = 0.5
"""A step turns back if it undoes more than this share of the one before: smaller overshoots die out by themselves."""


@final
class KestenStep(nn.Module):
    """Shortens steps to x / (1 + n), n how many of the full ones x turned back so far (Kesten 1958).

    Where it depends on a parameter whether bodies hit each other, full steps go to and fro within the noise; shortened
    ones end in their middle. Where steps converge, none is shortened. Part of a checkpoint, so that resuming is exact.
    """

    def __init__(self) -> None:
        super().__init__()
        self._last, self._turns = torch.empty(0), 0

    def forward(self, step: Tensor, curvature: Tensor) -> Tensor:
        """Shorten a full step.

        A step x after y turns back if x^T H y < -BACK y^T H y.

        Args:
            step: What solves the normal equations, shape (P,).
            curvature: H, which says how much steps in different parameters weigh, shape (P, P).
        """
        if len(self._last):
            along, whole = (float(one @ curvature @ self._last) for one in (step, self._last))
            self._turns += along < -BACK * whole
        self._last = step.clone()
        return step / (1 + self._turns)

    def get_extra_state(self) -> dict[str, Tensor]:
        """Return the last full step and how many turned back."""
        return {"last": self._last, "turns": torch.tensor(self._turns)}

    def set_extra_state(self, state: dict[str, Tensor]) -> None:
        """Go on after a checkpoint."""
        self._last, self._turns = state["last"], int(state["turns"])
