"""The phases of learning from video, and the rates of learning: functions of the epoch, so that resuming is exact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import lightning as L


class Phase(Enum):
    """What is learned at present."""

    WARM_UP = "warm-up"
    JOINT = "joint"
    REFINE = "refine"


@dataclass(frozen=True)
class Phases:
    """First the encoder warms up, then encoder and parameters learn together, at last the parameters alone.

    In the last phase the encoder stands still and every epoch is one Gauss-Newton step over all trajectories: errors of
    single poses average out there, while a gradient step on a few trajectories keeps jumping with them.

    Attributes:
        warm_up: Epochs of the first phase.
        refine: Epochs of the last phase.
        rise: Share of the first two phases over which the encoder's rate of learning rises; it falls again afterwards,
            both along half a cosine (Smith & Topin 2019).
        lowest: Rate at the beginning and at the end, relative to the highest.
        parameter_rate: The parameters' highest rate of learning, about their relative change in a step; the encoder's
            is the optimizer's.
    """

    warm_up: int = 10
    refine: int = 3
    rise: float = 0.15
    lowest: float = 1e-3
    parameter_rate: float = 1e-2

    def __post_init__(self) -> None:
        if self.warm_up < 0 or self.refine < 0 or not 0 < self.rise < 1:
            raise ValueError(
                f"phases need warm_up >= 0, refine >= 0 and rise between 0 and 1, got {self.warm_up}, {self.refine} "
                f"and {self.rise}"
            )

    def check(self, epochs: int | None) -> None:
        """Check that the phases fit into the run.

        Raises:
            ValueError: If they do not, or the run has no end.
        """
        if epochs is None or epochs < self.warm_up + self.refine:
            raise ValueError(
                f"trainer.max_epochs must be at least {self.warm_up + self.refine}, warm-up and refinement together, "
                f"got {epochs}; raise it or shorten the phases"
            )

    def at(self, epoch: int, epochs: int) -> Phase:
        """Return the phase of an epoch, of so many in all."""
        if epoch < self.warm_up and epoch < epochs - self.refine:
            return Phase.WARM_UP
        return Phase.JOINT if epoch < epochs - self.refine else Phase.REFINE

    def encoder_share(self, done: float, epochs: int) -> float:
        """Return the encoder's rate of learning after `done` epochs, relative to its highest."""
        share = min(done / max(epochs - self.refine, 1), 1.0)
        height = share / self.rise if share < self.rise else (1 - share) / (1 - self.rise)
        return self.lowest + (1 - self.lowest) * (1 - math.cos(math.pi * height)) / 2

    def parameter_share(self, done: float, epochs: int) -> float:
        """Return the parameters' rate of learning after `done` epochs, relative to its highest: half a cosine."""
        share = (done - self.warm_up) / max(epochs - self.refine - self.warm_up, 1)
        return 0.0 if share < 0 else (1 + math.cos(math.pi * min(share, 1.0))) / 2


def epochs_of(trainer: L.Trainer) -> int:
    """Return how many epochs a run has; 0 where it has no end."""
    return max(trainer.max_epochs or 0, 0)


def epochs_done(trainer: L.Trainer, batch_idx: int) -> float:
    """Return how many epochs are done before a batch, with a fraction."""
    return trainer.current_epoch + batch_idx / max(int(trainer.num_training_batches), 1)
