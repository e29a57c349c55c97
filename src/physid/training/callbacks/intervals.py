"""Say how well each parameter is known once training has ended."""

from __future__ import annotations

import math
from typing import Protocol, final

import lightning as L
import torch

from physid.training.parameters.intervals import Pull, intervals
from physid.training.parameters.physical_parameters import PhysicalParameters


class Pulled(Protocol):
    """A module that can tell how much each trajectory pulls at its parameters."""

    def pull(self) -> Pull:
        """Return gradient and curvature of the loss of each trajectory."""


@final
class Intervals(L.Callback):
    """After the last epoch, log the 90 % interval of each parameter as params/NAME/low and params/NAME/high.

    A parameter of which nothing is known has none. Rollouts of this are no part of the identification, and are not
    counted as evaluations.
    """

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Compute them, if this was the last epoch."""
        if not (trainer.should_stop or trainer.current_epoch + 1 == trainer.max_epochs):
            return
        module: Pulled = pl_module  # type: ignore[assignment]
        pull, estimates = module.pull(), PhysicalParameters.of(pl_module).estimates()
        for name, ends in intervals(estimates, pull.covariance(), len(pull.gradient)).items():
            if math.isfinite(ends[1]):
                for word, value in zip(("low", "high"), ends, strict=True):
                    pl_module.log(f"params/{name}/{word}", torch.tensor(value, dtype=torch.float64))
