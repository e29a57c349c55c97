"""What every training module shares: it states its losses, the base sums, checks and logs them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar

import lightning as L
import torch
from torch import Tensor, nn
from torch.optim import LBFGS, Optimizer

from physid.data.batches.datamodule import RecordingsDataModule
from physid.estimation.prediction.coordinates import LEARNED as LEARNED
from physid.inspection.examination import examine, require_usable_set
from physid.inspection.finding import Finding, warn_of
from physid.strict import shown
from physid.training.parameters import GaussNewton, PhysicalParameters

LEAST_BITS = 32
Mistakes = tuple[Finding, ...]
OptimizerFactory = Callable[[Iterable[nn.Parameter]], Optimizer]


class NonFiniteLossError(ValueError):
    """A loss that is not a number; the message names the loss and the trajectories."""


class TrainingModule(L.LightningModule, ABC):
    """A module that is trained by summing the losses that it states.

    Args:
        optimizer: Builds the optimizer from the module's parameters; None for GaussNewton.

    Attributes:
        evaluations: How often the losses of the whole training set were computed, a gradient included; shape ().
        findings: What looks like a mistake in the recordings; None before anybody asked.
    """

    MAY_CHANGE: ClassVar[frozenset[str]] = frozenset()
    """Arguments that may be others in a run that goes on: those that change nothing of what is learned."""
    evaluations: Tensor
    findings: Mistakes | None = None

    def __init__(self, optimizer: OptimizerFactory | None) -> None:
        super().__init__()
        self._optimizer: OptimizerFactory = optimizer or GaussNewton
        self.register_buffer("evaluations", torch.zeros((), dtype=torch.float64))

    @abstractmethod
    def losses(self, batch: Any) -> dict[str, Tensor]:
        """Compute the losses of a batch by name, each of shape (B,): one value for each trajectory."""

    @abstractmethod
    def indices(self, batch: Any) -> Tensor:
        """Return which trajectory of the recording set each value of a loss belongs to, shape (B,)."""

    def findings_of_fit(self) -> Mistakes:
        """Return what looks like a mistake in the recordings once they are fitted."""
        return ()

    def on_fit_start(self) -> None:
        """Refuse recordings that no fit could learn from, and say what else looks like a mistake (see `inspection`)."""
        data = self._data()
        if data is not None:
            self._say(require_usable_set(data.recordings, data.trajectories("fit"), data.trajectories("predict")))

    def on_validation_start(self) -> None:
        """Say what looks like a mistake in recordings that are measured and were not fitted to."""
        self._examine("validate")

    def on_test_start(self) -> None:
        """Say the same of those that are tested on."""
        self._examine("test")

    def on_predict_start(self) -> None:
        """Say the same of those that are predicted."""
        self._examine("predict")

    def _examine(self, use: str) -> None:
        """Say what looks like a mistake, unless a fit has."""
        data = self._data()
        if self.findings is None and data is not None:
            self._say(examine(data.recordings, data.trajectories(use)))

    def _data(self) -> RecordingsDataModule | None:
        """Return the recordings; None where a user's own module serves something else."""
        data = self.trainer.datamodule  # type: ignore[attr-defined]
        return data if isinstance(data, RecordingsDataModule) else None

    def _say(self, findings: Sequence[Finding]) -> None:
        """Keep what was found, and warn the user once, however many processes there are."""
        self.findings = tuple(findings)
        data = self._data()
        if self.trainer.is_global_zero and data is not None:
            warn_of(findings, data.recordings.folder)

    def training_step(self, batch: Any, batch_idx: int) -> Tensor:
        """Return the sum of the losses, averaged over the batch."""
        losses = self.losses(batch)
        self.require_finite(losses, batch)
        self.count_evaluations(1)
        means = {name: value.mean() for name, value in losses.items()}
        total = torch.stack(list(means.values())).sum()
        size = len(next(iter(losses.values())))
        # With one batch an optimizer may evaluate it several times a step: the last value counts, not the mean.
        many = self.trainer.num_training_batches > 1
        for name, value in (means | {"loss": total}).items():
            shown = name == "loss"
            self.log(f"train/{name}", value.detach(), shown, on_step=not many, on_epoch=many, batch_size=size)
        return total

    def count_evaluations(self, copies: int) -> None:
        """Count rollouts of this batch, as shares of the training set."""
        self.evaluations += copies / max(int(self.trainer.num_training_batches), 1)
        self.log("evaluations", self.evaluations.float())

    def configure_optimizers(self) -> Optimizer:
        """Build the optimizer.

        Raises:
            ValueError: If several processes would follow one that judges its steps by its own loss: they would part.
                Or if one that solves equations is to do so with few digits, or with changed gradients.
        """
        optimizer = self._optimizer(self.parameters())
        if isinstance(optimizer, GaussNewton):
            self._require_whole_steps()
        short = [each.dtype for each in self.parameters() if torch.finfo(each.dtype).bits < LEAST_BITS]
        if short and isinstance(optimizer, GaussNewton):
            raise ValueError(
                f"GaussNewton needs numbers of at least {LEAST_BITS} bits, got {short[0]}; set "
                "trainer.precision=32-true or 64-true, or choose an optimizer such as torch.optim.Adam"
            )
        if self.trainer.world_size > 1 and isinstance(optimizer, LBFGS | GaussNewton):
            raise ValueError(
                f"{type(optimizer).__name__} needs all trajectories in one process, got {self.trainer.world_size} "
                "processes; set trainer.devices=1, or choose an optimizer such as torch.optim.Adam"
            )
        return optimizer

    def _require_whole_steps(self) -> None:
        """Refuse settings of the Trainer that are made for steps along a gradient, and would do nothing, or harm.

        Raises:
            ValueError: If there is one; names it.
        """
        trainer = self.trainer
        for name, value, usual in (
            ("precision", trainer.precision, ("32-true", "64-true")),
            ("accumulate_grad_batches", trainer.accumulate_grad_batches, (1,)),
            ("gradient_clip_val", trainer.gradient_clip_val, (None, 0)),
        ):
            if value not in usual:
                raise ValueError(
                    f"trainer.{name}: expected none for GaussNewton, which solves for its steps, got {value}; leave it "
                    "out, or choose an optimizer such as torch.optim.Adam"
                )

    def on_train_start(self) -> None:
        """Refuse several batches where each would judge the step that another has led to.

        Raises:
            ValueError: If the optimizer is GaussNewton and there are several.
        """
        if int(self.trainer.num_training_batches) > 1 and isinstance(self.trainer.optimizers[0], GaussNewton):
            raise ValueError(
                f"GaussNewton needs all trajectories in one batch, got {int(self.trainer.num_training_batches)}; leave "
                "data.batch_size out, or choose an optimizer such as torch.optim.Adam"
            )

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keep the names of the learned parameters: other recordings may not call them unknown."""
        checkpoint[LEARNED] = list(PhysicalParameters.of(self).names)

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Refuse a checkpoint of other parameters (see `require_same_parameters`)."""
        place = self.trainer.ckpt_path if self._trainer is not None else None
        require_same_parameters(self, checkpoint, str(place or "checkpoint"))

    def require_finite(self, losses: Mapping[str, Tensor], batch: Any) -> None:
        """Check losses of a batch, each of shape (B,).

        Raises:
            NonFiniteLossError: If one is not finite; the message names it and the trajectories.
        """
        for name, value in losses.items():
            bad = ~torch.isfinite(value)
            if bool(bad.any()):
                which = sorted(set(self.indices(batch)[bad].tolist()))
                shown = ", ".join(map(str, which[:5])) + (", ..." if len(which) > 5 else "")
                raise NonFiniteLossError(
                    f"the loss {name} of trajectory {shown} is not finite in epoch {self.current_epoch}; lower the "
                    "learning rate, shorten the segments or look at that recording; checkpoints/last.ckpt holds the "
                    "last good state"
                )


def require_same_parameters(module: nn.Module, checkpoint: Mapping[str, Any], place: str) -> None:
    """Refuse a checkpoint of other parameters than a model learns: what it holds is numbers without names.

    Args:
        module: The model, with the scene that it is of.
        checkpoint: What was read.
        place: Where, for the message.

    Raises:
        ValueError: If the names differ, or their order.
    """
    learned, mine = checkpoint.get(LEARNED), list(PhysicalParameters.of(module).names)
    if learned is not None and learned != mine:
        raise ValueError(
            f"{place}: expected a model that learns {', '.join(mine)}, as model.learn or the recordings say, found one "
            f"that has learned {', '.join(map(shown, learned))}; leave model.learn as the run has it, or fit anew"
        )


def ends_with_epoch(trainer: L.Trainer) -> bool:
    """Return whether the epoch that ends is the last one: of all, by the steps allowed, or because a fit stops."""
    out_of_steps = 0 <= trainer.max_steps <= trainer.global_step
    return trainer.should_stop or out_of_steps or trainer.current_epoch + 1 == trainer.max_epochs
