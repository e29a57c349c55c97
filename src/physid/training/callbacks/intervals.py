"""Say how well each parameter is known once training has ended."""

from __future__ import annotations

from typing import Protocol, final

import lightning as L

from physid.training.parameters.intervals import Response, intervals, logged
from physid.training.parameters.physical_parameters import PhysicalParameters


class Responding(Protocol):
    """A module that can tell how its estimates respond to the poses."""

    def response(self) -> Response:
        """Return it, at the present parameters."""


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
        module: Responding = pl_module  # type: ignore[assignment]
        response, estimates = module.response(), PhysicalParameters.of(pl_module).estimates()
        pl_module.log_dict(logged(intervals(estimates, response.covariance(), len(response.normal.square))))
