"""Say so when a fit reports a parameter that its trajectories cannot tell."""

from __future__ import annotations

import logging
from typing import Protocol, final

import lightning as L
import torch

from physid.training.parameters import Identifiability, SensorNoise
from physid.training.training_module import ends_with_epoch

logger = logging.getLogger("physid")


class Judging(Protocol):
    """A module that can tell what its last batch reveals."""

    def identifiability(self, noise: SensorNoise | None) -> Identifiability:
        """Return what is known of the learned parameters."""


@final
class IdentifiabilityWarning(L.Callback):
    """After the last epoch, judge each learned parameter as `physid identifiability` does, and warn of those that fail.

    Logs params/NAME/expected_deviation, relative, for the noise that is assumed, and params/NAME/observable, 1 if the
    parameter is identified, else 0. Its rollouts are no part of the
    identification and are not counted as evaluations.

    Args:
        noise: What the sensor is assumed to add; None for what the recorded poses show.
    """

    def __init__(self, noise: SensorNoise | None = None) -> None:
        self.noise = noise

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Judge, if this was the last epoch."""
        if not ends_with_epoch(trainer):
            return
        judge: Judging = pl_module  # type: ignore[assignment]
        judged = judge.identifiability(self.noise)
        for one, other, correlation in judged.alike():
            logger.warning(
                "these recordings hardly distinguish %s and %s (correlation %+.3f): learn one of them, or record other "
                "motions", one, other, correlation,
            )  # fmt: skip
        for verdict in judged.verdicts():
            deviation = torch.tensor(verdict.deviation, dtype=torch.float64)
            pl_module.log(f"params/{verdict.name}/expected_deviation", deviation)
            identified = verdict.kind == "identified"
            pl_module.log(f"params/{verdict.name}/observable", float(identified))
            if not identified:
                logger.warning("do not rely on the estimate of %s", verdict)
