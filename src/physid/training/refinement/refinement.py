"""The last phase of learning from video: the encoder stands still, the parameters take Gauss-Newton steps."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast, final

import torch
from torch import Tensor, nn
from torch.optim import Optimizer

from physid.networks import PlanarChart
from physid.training.parameters import PoseLoss, Posterior, Trajectories
from physid.training.refinement.horizon import Batch
from physid.training.refinement.initial_poses import Placing, place
from physid.training.refinement.kesten_step import KestenStep
from physid.training.refinement.normal_equations import NormalEquations
from physid.training.training_module import TrainingModule
from physid.training.vision import LandingHeight, VideoModel, land

LARGEST_STEP = 0.5
"""Of the logarithm of a parameter."""


@final
@dataclass(frozen=True)
class Readings:
    """What is known of the poses of a batch.

    Attributes:
        pose: Poses of the frames that the batch shows, shape (B, f, N, 7).
        goal: The poses that should come out, shape (B, T, N, 7).
        real: Which of them count, shape (B, T).
        from_images: Whether they were read from images: all of them share errors of the camera, and where bodies may
            hover their depth is hardly known.
    """

    pose: Tensor
    goal: Tensor
    real: Tensor
    from_images: bool


@final
class Refinement(nn.Module):
    """One Gauss-Newton step over all trajectories per epoch, each from an initial state that is fitted.

    Steps that turn back are shortened (see `KestenStep`).

    Args:
        loss: What errors of the rolled-out poses cost.
    """

    def __init__(self, loss: PoseLoss) -> None:
        super().__init__()
        self._loss, self._calm = loss, KestenStep()
        self._equations: NormalEquations | None = None

    def add(self, module: TrainingModule, model: VideoModel, batch: Batch, known: Readings) -> None:
        """Add a batch of trajectories, and take the step after the last one of the epoch.

        Args:
            module: Logs the loss, and after the step the 90 % interval of each parameter as params/NAME/low and
                params/NAME/high (see `NormalEquations.covariance`).
            model: Its physics and parameters.
            batch: A batch of the data module, or the part of it that is rolled out.
            known: Its poses.

        Raises:
            NonFiniteLossError: If the loss of a trajectory is not finite.
        """
        # Poses that are not finite have no loss at all: the physics refuses them without naming the trajectory.
        sums = known.pose.double().sum((1, 2, 3)) + known.goal.double().sum((1, 2, 3))
        module.require_finite({"refined": sums}, batch)
        if self._equations is None:
            self._equations = NormalEquations()
        loss = add_to(self._equations, model, self._loss, batch, known)
        module.require_finite({"refined": loss}, batch)
        many = module.trainer.num_training_batches > 1
        module.log("train/loss", loss.mean(), on_step=not many, on_epoch=many, prog_bar=True, batch_size=len(loss))
        if module.trainer.is_last_batch:
            module.log_dict(self._finish(module, model))

    def _finish(self, module: TrainingModule, model: VideoModel) -> dict[str, Tensor]:
        """Take the step, forget the sums, and return the intervals."""
        assert self._equations is not None
        physical = model.physical
        with torch.no_grad():
            step = self._calm(self._equations.step(LARGEST_STEP), self._equations.normal.matrix.sum(0))
        physical.coordinates.grad = -step.to(physical.coordinates)
        cast(Sequence[Optimizer], module.optimizers())[-1].step()
        physical.confine()
        here, spread = physical.coordinates.detach().cpu().clone(), self._equations.covariance().cpu()
        known = Posterior(physical.space, here, spread, len(self._equations.weights))
        if module.trainer.is_global_zero:
            known.write(Path(module.trainer.default_root_dir))
        self._equations = None
        return known.logged()


@torch.no_grad()
def add_to(equations: NormalEquations, model: VideoModel, loss: PoseLoss, batch: Batch, known: Readings) -> Tensor:
    """Add a batch of trajectories to normal equations (see `Refinement.add`); returns the loss of each (B,)."""
    there, from_images = model.physics_device, known.from_images
    state = model.initial_state(known.pose, batch["shown"], batch["wrench"])
    goal, real = torch.cat([state.pose[:, None], known.goal[:, 1:].to(state.pose)], 1), known.real.to(there)
    trajectories = Trajectories(
        pose=goal,
        twist=state.twist[:, None].expand(-1, goal.shape[1], -1, -1),
        wrench=batch["wrench"].to(state.pose),
        length=batch["length"].to(there),
        index=batch["index"].to(there),
    )
    own: LandingHeight | Placing
    if from_images and isinstance(model.chart, PlanarChart) and model.chart.hovering:
        eye = model.decoder.renderer.camera.position
        own = land(model.layer, model.parameters_there(), model.chart, eye, loss, trajectories, real)
    else:
        own = place(model, loss, trajectories, real)
    shifted = _shifted(model, own.trajectories) if from_images else ()
    return equations.add(model.layer, model.physical_there(), loss, own.trajectories, real, own, shifted)


def _shifted(model: VideoModel, trajectories: Trajectories) -> list[Trajectories]:
    """Shift what was read from images by a standard deviation of each error that all of it shares."""
    start, seen = trajectories.start, (model.chart, model.decoder.renderer.camera)
    origins, goals = (model.calibration.shared_errors(*seen, pose) for pose in (start.pose, trajectories.pose))
    return [
        dataclasses.replace(trajectories, pose=there, origin=torch.cat([here, start.twist], -1))
        for here, there in zip(origins, goals, strict=True)
    ]
