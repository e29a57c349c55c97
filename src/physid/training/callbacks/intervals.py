"""Say how well each parameter is known once training has ended."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol, final

import lightning as L

from physid.training.parameters import PhysicalParameters, Posterior, Response


class Responding(Protocol):
    """A module that can tell how its estimates respond to the poses."""

    def response(self) -> Response:
        """Return it, at the present parameters."""


@final
class Intervals(L.Callback):
    """After the last epoch, log the 90 % interval of each parameter as params/NAME/low and params/NAME/high.

    The correlation of each pair is logged as correlation/NAME/OTHER; all of it is kept in posterior.json, from which
    `physid sample` draws.

    A parameter of which nothing is known has none. Rollouts of this are no part of the identification, and are not
    counted as evaluations.
    """

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Compute them, if this was the last epoch."""
        if not (trainer.should_stop or trainer.current_epoch + 1 == trainer.max_epochs):
            return
        module: Responding = pl_module  # type: ignore[assignment]
        response, physical = module.response(), PhysicalParameters.of(pl_module)
        here = physical.coordinates.detach().cpu().clone()
        known = Posterior(physical.names, here, response.covariance().cpu(), len(response.normal.square))
        pl_module.log_dict(known.logged())
        if trainer.is_global_zero:
            known.write(Path(trainer.default_root_dir))
