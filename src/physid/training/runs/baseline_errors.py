"""The errors of other predictions, beside those of the model."""

from __future__ import annotations

from typing import Any, final

import lightning as L
import torch

from physid.training.learners.sysid import SysID
from physid.training.parameters import PoseErrors
from physid.training.runs import baselines


@final
class BaselineErrors(L.Callback):
    """Log what other predictions of the tested whole trajectories are off by.

    test/bullet_position_error is PyBullet's with the same parameters, test/ballistic_... that of free flight frozen at
    touch-down, test/held_... that of the initial pose held; rotation errors and deviations likewise. PyBullet has none
    where stamps are uneven or bodies were not seen.
    """

    def __init__(self) -> None:
        self._errors: dict[str, PoseErrors] = {}
        self._predicted: set[str] = set()

    def on_test_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Begin anew."""
        if not isinstance(pl_module, SysID):
            raise TypeError(f"BaselineErrors needs SysID, got {type(pl_module).__name__}")
        self._errors = {name: PoseErrors(pl_module.scene) for name in ("bullet", "ballistic", "held")}

    def on_test_batch_end(
        self,
        trainer: L.Trainer,
        pl_module: L.LightningModule,
        outputs: Any,
        batch: Any,
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        """Predict the batch in the other ways."""
        assert isinstance(pl_module, SysID)
        whole = pl_module.trajectories(batch)
        scene = pl_module.physical.estimated_scene()
        world = pl_module.layer.world
        predicted = {
            "ballistic": baselines.ballistic(whole, scene, 0.0 if world.midpoint else scene.time_step),
            "held": baselines.held(whole),
        }
        if whole.seen is None:  # PyBullet predicts even frames only
            substeps = baselines.fine_substeps(scene) if pl_module.steps.chooses else world.substeps
            predicted["bullet"] = baselines.bullet(whole, scene, substeps)
        for name, pose in predicted.items():
            self._errors[name].update(pose, whole.pose, whole.real)
            self._predicted.add(name)

    def on_test_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Log the errors."""
        for name, errors in self._errors.items():
            for key, value in errors.take().items() if name in self._predicted else ():
                pl_module.log(f"test/{name}_{key}", torch.as_tensor(value))
