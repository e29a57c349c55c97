"""Stop when the physical parameters have settled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import lightning as L
import torch
from torch import Tensor

from physid.strict import whole
from physid.training.parameters import PhysicalParameters


@final
class Converged(L.Callback):
    """End training once an epoch has changed no physical parameter by more than a tolerance.

    A module that chooses the steps of its engine (`settled`) may ask for more: they must have been chosen there. One
    whose loss has ripples may say that nothing else is left (`exhausted`), however parameters still move.

    With `lengthen` segments grow first, each time the parameters have settled: over a long horizon a loss has a
    narrow valley around the truth and ripples beside it, and a fit that starts far away does not come through; from
    where a shorter horizon has led it, it does (continuation).

    Args:
        tolerance: Largest relative change.
        lengthen: Steps of the later segments, None for whole trajectories; the first ones are `model.segment`.
    """

    def __init__(self, tolerance: float = 1e-5, lengthen: Sequence[int | None] = ()) -> None:
        if tolerance <= 0:
            raise ValueError(f"tolerance must be positive, got {tolerance}")
        self.tolerance, self.lengthen = tolerance, tuple(lengthen)
        self._longer = 0  # how often segments have grown
        self._before: Tensor | None = None

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Take up the segments of a run that is resumed."""
        if self._longer:
            self._set(pl_module)

    def on_train_epoch_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Remember the parameters."""
        self._before = PhysicalParameters.of(pl_module).coordinates.detach().clone()

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Compare, and stop."""
        now = PhysicalParameters.of(pl_module).coordinates.detach()
        still = self._before is not None and bool(torch.all((now - self._before).abs() <= self.tolerance))
        still = still or (hasattr(pl_module, "exhausted") and pl_module.exhausted())  # type: ignore[operator]
        if still and (not hasattr(pl_module, "settled") or pl_module.settled()):  # type: ignore[operator]
            if self._longer == len(self.lengthen):
                trainer.should_stop = True
                return
            self._longer += 1
            self._set(pl_module)
            for optimizer in trainer.optimizers:
                optimizer.state.clear()  # what it knows is of another loss

    def _set(self, module: Any) -> None:
        module.segment = self.lengthen[self._longer - 1]

    def state_dict(self) -> dict[str, Any]:
        """Return how often segments have grown."""
        return {"longer": self._longer}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take it from the run that is resumed.

        Raises:
            ValueError: If it is no such number.
        """
        self._longer = whole(state_dict["longer"], "Converged.longer", low=0, high=len(self.lengthen))
