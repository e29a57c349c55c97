"""System identification: physical parameters from recorded poses and known forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Literal, final

import lightning as L
import torch
from torch import Tensor

from physid.physics.layer import PhysicsLayer
from physid.scenes.scene import Scene
from physid.training.base import OptimizerFactory, TrainingModule
from physid.training.callbacks.observability_warning import ObservabilityWarning
from physid.training.callbacks.parameter_history import ParameterHistory
from physid.training.engine import Engine
from physid.training.gauss_newton import GaussNewton
from physid.training.metrics import PoseErrors
from physid.training.observability import Observability, SensorNoise
from physid.training.pattern_search import PatternSearch
from physid.training.physical_parameters import PhysicalParameters
from physid.training.pose_loss import PoseLoss
from physid.training.sensitivity import residuals, sensitivity
from physid.training.trajectories import Trajectories

Batch = Mapping[str, Any]
JUDGED = 8
"""Trajectories that suffice to judge what can be told."""


@final
class SysID(TrainingModule):
    """Identify physical parameters by matching predicted to recorded trajectories.

    The loss is the paper's (see `PoseLoss`), with each trajectory predicted from its first recorded state. With
    `segment` it is cut into short ones, each predicted from its own first recorded state: collisions and tumbling
    amplify every error, so that over long trajectories the loss has no usable slope.

    Args:
        learn: Names of the parameters to learn ("block.friction"); None for the scene's unknown ones.
        values: Values that replace the scene's, by name: a first guess, or better knowledge of a fixed parameter.
        segment: Steps of a segment in training; None for whole trajectories, as in the paper.
        test_segment: The same in validation and test, where errors over whole trajectories are reported as well.
        twist: Where first velocities come from: the recording (estimated where it has none), or always from its poses.
        loss: What an error of the poses costs; None for the paper's loss.
        engine: Rules of the physics; None for the layer's own.
        optimizer: Adam, LBFGS, GaussNewton or PatternSearch; None for GaussNewton.

    Attributes:
        physical: The physical parameters, once the scene is known.
        scene: The scene as far as it is known, once it is known.
        layer: The physics, once the scene is known.
    """

    physical: PhysicalParameters
    scene: Scene
    layer: PhysicsLayer

    def __init__(
        self,
        learn: Sequence[str] | None = None,
        values: Mapping[str, float] | None = None,
        segment: int | None = None,
        test_segment: int | None = None,
        twist: Literal["recorded", "estimated"] = "recorded",
        loss: PoseLoss | None = None,
        engine: Engine | None = None,
        optimizer: OptimizerFactory | None = None,
    ) -> None:
        super().__init__(optimizer or GaussNewton)
        self.learn, self.values = learn, values
        self.segment, self.test_segment, self.twist = segment, test_segment, twist
        self.loss, self.engine = loss or PoseLoss(), engine or Engine()
        self._known: tuple[Batch, Trajectories] | None = None  # the last batch, asked for again and again

    def setup(self, stage: str) -> None:
        """Take the scene from the data module, the first time."""
        if not hasattr(self, "layer"):
            self.attach(self.trainer.datamodule.scene)  # type: ignore[attr-defined]

    def attach(self, scene: Scene) -> SysID:
        """Build physics, parameters and metrics for a scene; returns itself."""
        self.scene, self.layer = scene, self.engine.layer(scene)
        self.physical = PhysicalParameters(scene, self.learn, self.values)
        self.errors = torch.nn.ModuleDict({name: PoseErrors(scene) for name in ("segments", "whole")})
        return self

    def configure_callbacks(self) -> list[L.Callback]:
        """Keep and draw the history of the parameters, and warn of those that cannot be told."""
        return [ParameterHistory(), ObservabilityWarning()]

    def trajectories(self, batch: Batch, segment: int | None = None) -> Trajectories:
        """Return a batch of the data module as trajectories, cut into segments."""
        if self._known is None or self._known[0] is not batch:
            seen = {name: batch[name] for name in batch if name != "twist" or self.twist == "recorded"}
            self._known = (batch, Trajectories.of(seen, self.layer.world.time_step))
        return self._known[1].segments(segment)

    def losses(self, batch: Batch) -> dict[str, Tensor]:
        """Compute the losses of each training segment (see `PoseLoss`)."""
        cut = self.trajectories(batch, self.segment)
        return self.loss(residuals(self.layer, self.physical, cut), cut.real)

    def indices(self, batch: Batch) -> Tensor:
        """Return the trajectory of each training segment."""
        return self.trajectories(batch, self.segment).index

    @torch.no_grad()
    def curvature(self, batch: Batch) -> Tensor:
        """Approximate the second derivative of the loss, (P, P); costs 2 P evaluations."""
        cut = self.trajectories(batch, self.segment)
        self.count_evaluations(2 * len(self.physical.names))
        answer = sensitivity(self.layer, self.physical, cut)
        weighing = residuals(self.layer, self.physical, cut) if self.loss.robust else cut.pose[..., :6]
        return self.loss.curvature(weighing, answer, cut.real)

    @torch.no_grad()
    def values_at(self, batch: Batch, points: Tensor) -> Tensor:
        """Compute the mean loss at K points ln(parameter) (K, P), shape (K,); costs K evaluations."""
        cut = self.trajectories(batch, self.segment)
        self.count_evaluations(len(points))
        each = residuals(self.layer, self.physical, cut.repeated(len(points)), points.repeat_interleave(len(cut), 0))
        losses = self.loss(each, cut.real.repeat(len(points), 1))
        return torch.stack([value.unflatten(0, (len(points), -1)).mean(1) for value in losses.values()]).sum(0)

    def observability(self, noise: SensorNoise) -> Observability:
        """Judge what some trajectories of the last training batch tell about the learned parameters."""
        cut = self.trajectories(self._batch).first(JUDGED).segments(self.segment)
        return Observability.of(self.physical.names, sensitivity(self.layer, self.physical, cut), cut.real, noise)

    def optimizer_step(self, epoch: int, batch_idx: int, optimizer: Any, optimizer_closure: Any = None) -> None:
        """Give GaussNewton the curvature, PatternSearch the losses of other points; others step as ever."""
        kind = getattr(optimizer, "optimizer", optimizer)
        if isinstance(kind, GaussNewton):
            optimizer.step(closure=optimizer_closure, curvature=partial(self.curvature, self._batch))
        elif isinstance(kind, PatternSearch):
            optimizer.step(closure=optimizer_closure, values=partial(self.values_at, self._batch))
        else:
            optimizer.step(closure=optimizer_closure)

    def on_train_batch_start(self, batch: Batch, batch_idx: int) -> None:
        """Keep the batch for the optimizer."""
        self._batch = batch

    def predict_step(self, batch: Batch, batch_idx: int) -> Trajectories:
        """Predict whole trajectories from their first state, under the recorded or the planned wrenches."""
        known = self.trajectories(batch)
        wrench, length = (batch["future"], None) if "future" in batch else (known.wrench, known.length)
        rollout = self.layer.rollout(known.start, wrench[:, :-1], self.physical())
        length = torch.full_like(known.length, wrench.shape[1]) if length is None else length
        return Trajectories(rollout.pose, rollout.twist, wrench, length, known.index)

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Add the errors of the predictions over segments and over whole trajectories."""
        for name, segment in self._shots().items():
            cut = self.trajectories(batch, segment)
            self.errors[name].update(self._predicted(cut), cut.pose, cut.real)  # type: ignore[operator]

    test_step = validation_step

    def on_validation_epoch_end(self) -> None:
        """Log the errors."""
        self._log_errors("val")

    def on_test_epoch_end(self) -> None:
        """Log the errors."""
        self._log_errors("test")

    def _shots(self) -> dict[str, int | None]:
        """Return the segments to predict; whole trajectories once."""
        shots: dict[str, int | None] = {"segments": self.test_segment}
        return shots | {"whole": None} if self.test_segment is not None else shots

    def _predicted(self, trajectories: Trajectories) -> Tensor:
        rollout = self.layer.rollout(trajectories.start, trajectories.wrench[:, :-1], self.physical())
        return rollout.pose

    def _log_errors(self, stage: str) -> None:
        for name in self._shots():
            prefix = f"{stage}/" if name == "segments" else f"{stage}/whole_"
            values = self.errors[name].take()  # type: ignore[operator]
            self.log_dict({f"{prefix}{key}": value.float() for key, value in values.items()})
