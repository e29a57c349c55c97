"""Say how well each parameter is known once training has ended, and whether it has arrived there."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, final

import lightning as L
import torch
from torch import Tensor

from physid.strict import shown
from physid.training.parameters import PhysicalParameters, Posterior, Response
from physid.training.training_module import ends_with_epoch

logger = logging.getLogger("physid")
LARGEST_RATIO = 0.9
"""Of a step to the one before: slower ones cannot be distinguished from those that do not shrink."""


class Responding(Protocol):
    """A module that can tell how its estimates respond to the poses."""

    def response(self) -> Response:
        """Return it, at the present parameters."""


@final
class Intervals(L.Callback):
    """After the last epoch, log the 90 % interval of each parameter as params/NAME/low and params/NAME/high.

    The correlation of each pair is logged as correlation/NAME/OTHER; all of it is kept in posterior.json, from which
    `physid sample` draws.

    An interval holds what the recordings leave open, not what a fit that ends too early has still to go (see
    `left_to_go`); that is params/NAME/left_to_go, in standard errors. Where it is more than one, and so was the last
    step, a warning says so.

    A parameter of which nothing is known has none. Rollouts of this are no part of the identification, and are not
    counted as evaluations.
    """

    def __init__(self) -> None:
        self._path: list[Tensor] = []

    def on_train_epoch_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Remember where the parameters are."""
        self._path = [*self._path[-1:], PhysicalParameters.of(pl_module).coordinates.detach().cpu().clone()]

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Compute them, if this was the last epoch."""
        if not ends_with_epoch(trainer):
            return
        module: Responding = pl_module  # type: ignore[assignment]
        response, physical = module.response(), PhysicalParameters.of(pl_module)
        here = physical.coordinates.detach().cpu().clone()
        known = Posterior(physical.space, here, response.covariance().cpu(), len(response.normal.square))
        pl_module.log_dict(known.logged())
        error = known.covariance.diagonal().clamp_min(0).sqrt()
        step = (here - self._path[-1]).abs() / error
        left, shrinks = left_to_go([*self._path, here]) / error, steps_shrink([*self._path, here])
        for name, far, last, shorter in zip(known.names, left, step, shrinks.tolist(), strict=True):
            pl_module.log(f"params/{name}/left_to_go", far)
            if min(float(far), float(last)) > 1:
                where = f"and some {far:.2g} are" if shorter else "and nothing says how many are"
                logger.warning(
                    "%s has not settled: the last epoch moved it by %.2g standard errors, %s still to go, for which "
                    "its interval does not allow; give the fit more epochs (trainer.max_epochs)",
                    name, last, where,
                )  # fmt: skip
        if trainer.is_global_zero:
            known.write(Path(trainer.default_root_dir))

    def state_dict(self) -> dict[str, Any]:
        """Return where the parameters were, so that a resumed run judges as an undisturbed one."""
        return {"path": self._path}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take it from the run that is resumed.

        Raises:
            ValueError: If it is no such sequence.
        """
        path = state_dict["path"]
        if not isinstance(path, list) or not all(isinstance(each, Tensor) and each.dim() == 1 for each in path):
            raise ValueError(f"Intervals.path: expected parameters of the last epochs, found {shown(path)}")
        self._path = path


def left_to_go(path: Sequence[Tensor]) -> Tensor:
    """Estimate how far a sequence still is from where it is going, shape (P,).

    If the last step x is r times the one before, and so on, x r / (1 - r) is left (Aitken 1926). Of a single step, or
    one that is not shorter than the one before, r is taken as 0.9.

    Args:
        path: The last points of the sequence, two or three, shape (P,) each.
    """
    ratio = _ratio(path).clamp(max=LARGEST_RATIO)
    return (path[-1] - path[-2]).abs() * ratio / (1 - ratio)


def steps_shrink(path: Sequence[Tensor]) -> Tensor:
    """Return whether the last step of a sequence was so much shorter than the one before that its end is in sight."""
    return _ratio(path) < LARGEST_RATIO


def _ratio(path: Sequence[Tensor]) -> Tensor:
    """Return the last step over the one before, shape (P,); of a single step, or where nothing moved, the largest."""
    steps = torch.stack(list(path)).diff(dim=0).abs()
    before = steps[-2] if len(steps) > 1 else torch.zeros_like(steps[-1])
    return torch.where(before > 0, steps[-1] / before, LARGEST_RATIO)
