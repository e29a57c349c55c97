"""System identification: physical parameters from recorded poses and known forces."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Literal, final

import lightning as L
import torch
from torch import Tensor

from physid.physics.layer import PhysicsLayer
from physid.scenes.scene import Scene
from physid.training.callbacks.identifiability_warning import IdentifiabilityWarning
from physid.training.callbacks.intervals import Intervals
from physid.training.callbacks.parameter_history import ParameterHistory
from physid.training.identifiability.identifiability import Identifiability, SensorNoise
from physid.training.initial_states.fitted import Explaining, Starts, TrackedFit
from physid.training.initial_states.pose_noise import pose_noise, weighed_by
from physid.training.initial_states.projection import project_out_initial_states
from physid.training.initial_states.tracked import TrackedInitialStates
from physid.training.learners.base import OptimizerFactory, TrainingModule
from physid.training.learners.engine import Engine
from physid.training.learners.metrics import PoseErrors
from physid.training.parameters.gauss_newton import GaussNewton
from physid.training.parameters.intervals import Pull, coarse_pull
from physid.training.parameters.pattern_search import PatternSearch
from physid.training.parameters.physical_parameters import PhysicalParameters
from physid.training.parameters.pose_loss import PoseLoss, pose_residual
from physid.training.parameters.sensitivity import residuals, sensitivity
from physid.training.parameters.slopes import slopes
from physid.training.parameters.trajectories import Trajectories

Batch = Mapping[str, Any]
JUDGED = 8  # trajectories that suffice to judge what is identifiable
AFRESH = 3
"""Every so many epochs initial states are also fitted from the first guess again, to leave a local minimum."""


@final
class SysID(TrainingModule):
    """Identify physical parameters by matching predicted to recorded trajectories.

    The loss is the paper's (see `PoseLoss`), with each trajectory predicted from its initial state. With `segment` it
    is cut into short ones, each predicted from its own initial state: collisions and tumbling amplify every error, so
    that over long trajectories the loss has no usable slope. Initial states are those recorded, or, where only poses
    were recorded, unknowns of each trajectory, fitted anew for every value of the parameters (variable projection,
    Golub & Pereyra 1973): the noise of one pose would otherwise pull the parameters.

    Args:
        learn: Names of the parameters to learn ("block.friction"); None for the scene's unknown ones.
        values: Values that replace the scene's, by name: a first guess, or better knowledge of a fixed parameter.
        segment: Steps of a segment in training; None for whole trajectories, as in the paper.
        test_segment: The same in validation and test, where errors over whole trajectories are reported as well.
        twist: Where initial velocities come from: the recording (estimated where it has none), or always from its
            poses.
        start: Whether initial states are as recorded or fitted; None for fitted without twists, or if cameras distort.
        seen: Frames (at most half of them) to which initial states are fitted in tests and predictions.
        loss: What an error of the poses costs; None for the paper's loss.
        warm_up: Where no loss is given and initial states are fitted: epochs with the paper's loss, before its
            rotations are weighed by the noise of the poses. They hold the spin, which would else hide that the friction
            is far off.
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
        start: Literal["recorded", "fitted"] | None = None,
        seen: int = 60,
        loss: PoseLoss | None = None,
        warm_up: int = 4,
        engine: Engine | None = None,
        optimizer: OptimizerFactory | None = None,
    ) -> None:
        for name, value, least in (("segment", segment, 1), ("test_segment", test_segment, 1), ("seen", seen, 2)):
            if value is not None and value < least:
                raise ValueError(f"model.{name} must be at least {least}, got {value}")
        super().__init__(optimizer or GaussNewton)
        self.learn, self.values = learn, values
        self.segment, self.test_segment, self.twist = segment, test_segment, twist
        self.start, self.seen, self.warm_up = start, seen, warm_up
        self.loss, self.engine = loss or PoseLoss(), engine or Engine()
        self._weighs = loss is None
        self._known: tuple[Batch, Trajectories] | None = None  # the last batch, asked for again and again

    def setup(self, stage: str) -> None:
        """Take the scene from the data module, the first time."""
        if not hasattr(self, "layer"):
            self.attach(self.trainer.datamodule.scene)  # type: ignore[attr-defined]

    def attach(self, scene: Scene) -> SysID:
        """Build physics, parameters and metrics for a scene; returns itself."""
        self.scene, self.layer = scene, self.engine.layer(scene)
        self.physical, self.starts = PhysicalParameters(scene, self.learn, self.values), TrackedInitialStates(scene)
        self.errors = torch.nn.ModuleDict({name: PoseErrors(scene) for name in ("fitted", "segments", "whole")})
        return self

    def configure_callbacks(self) -> list[L.Callback]:
        """Find intervals, keep and draw the history of the parameters, and warn of those that are not identifiable."""
        return [Intervals(), ParameterHistory(), IdentifiabilityWarning()]

    def trajectories(self, batch: Batch, segment: int | None = None) -> Trajectories:
        """Return a batch of the data module as trajectories, cut into segments."""
        if self._known is None or self._known[0] is not batch:
            seen = {name: batch[name] for name in batch if name != "twist" or self.twist == "recorded"}
            self._known = (batch, Trajectories.of(seen, self.layer.world.time_step))
        return self._known[1].segments(segment)

    def fits_starts(self, batch: Batch) -> bool:
        """Return whether initial states are fitted."""
        return self.start == "fitted" or (self.start is None and ("twist" not in batch or self.layer.distorts))

    def losses(self, batch: Batch) -> dict[str, Tensor]:
        """Compute the losses of each training segment (see `PoseLoss`), its initial state following the parameters."""
        cut = self.trajectories(batch, self.segment)
        if self.fits_starts(batch):
            self._weigh(batch)
            afresh = self._epochs_after > 0 and self._epochs_after % AFRESH == AFRESH - 1
            follow, rollouts = self.starts.improve(self._explaining(cut), afresh=afresh)
            self.count_evaluations(rollouts)
            cut = follow.at(self.physical.logarithm - self.physical.logarithm.detach()).of(cut)
        predicted = cut.rolled(self.layer, self.physical()).pose
        self._evaluated = predicted.detach(), cut
        return self.loss(pose_residual(predicted, cut.pose), cut.real)

    def indices(self, batch: Batch) -> Tensor:
        """Return the trajectory of each training segment."""
        return self.trajectories(batch, self.segment).index

    @torch.no_grad()
    def curvature(self, batch: Batch) -> Tensor:
        """Approximate the second derivative of the loss where it was computed last, (P, P); costs 2 P evaluations."""
        explaining = self._explaining(self.trajectories(batch, self.segment))
        follow = self.starts.last(explaining, fitted=self.fits_starts(batch))
        if follow is None:
            self.count_evaluations(2 * len(self.physical.names))
        cut, slopes = self.answer(batch, follow)
        weighing = residuals(self.layer, self.physical, cut) if self.loss.robust else cut.pose[..., :6]
        return self.loss.curvature(weighing, slopes, cut.real)

    @torch.no_grad()
    def answer(self, batch: Batch, follow: TrackedFit | None) -> tuple[Trajectories, Tensor]:
        """Return the training segments from their initial states, and their answer to ln(parameter) (P, B, T, N, 6)."""
        cut = self.trajectories(batch, self.segment)
        found = None if follow is None else (follow.starts.of(cut), follow.slopes)
        return found or (cut, sensitivity(self.layer, self.physical, cut))

    @torch.no_grad()
    def values_at(self, batch: Batch, points: Tensor) -> Tensor:
        """Compute the mean loss at K points ln(parameter) (K, P), shape (K,); costs K evaluations."""
        losses, rollouts = self.losses_at(batch, points)
        self.count_evaluations(rollouts)
        return losses.mean(1)

    @torch.no_grad()
    def losses_at(self, batch: Batch, points: Tensor) -> tuple[Tensor, int]:
        """Compute the loss of each segment at K points ln(parameter) (K, P), shape (K, B), and count the rollouts."""
        cut = self.trajectories(batch, self.segment)
        many, every = cut.repeated(len(points)), points.repeat_interleave(len(cut), 0)
        rollouts = 0
        if self.fits_starts(batch):
            begin = self.starts.starts(self._explaining(cut)).repeated(len(points))
            starts, rollouts = self._explaining(many, every).fit(begin)
            many = starts.of(many)
        losses = self.loss(residuals(self.layer, self.physical, many, every), many.real)
        total = torch.stack(list(losses.values())).sum(0).unflatten(0, (len(points), -1))
        return total, len(points) * (rollouts + 1)

    def identifiability(self, noise: SensorNoise | None = None) -> Identifiability:
        """Judge what some trajectories of the last training batch tell, under their own noise if none is given."""
        cut = self.trajectories(self._batch, self.segment)
        noise = noise or pose_noise(cut)
        if self.fits_starts(self._batch):
            cut = self.starts.starts(self._explaining(cut)).of(cut)
        cut = cut.chosen((cut.index[:, None] == cut.index.unique()[:JUDGED]).any(1))
        found = slopes(self.layer, self.physical, cut)
        usable = found.usable | ~found.usable.any()  # better all than none
        cut, answer = cut.chosen(usable), found.sensitivity[:, usable]
        if self.fits_starts(self._batch):
            answer = project_out_initial_states(self.layer, self.physical, cut, answer, noise.weights)
        return Identifiability.of(self.physical.names, answer, cut.real, noise)

    @torch.no_grad()
    def pull(self) -> Pull:
        """Compute how much each trajectory of the last training batch pulls at the parameters."""
        batch, index = self._batch, self.indices(self._batch)
        if isinstance(self.optimizers(use_pl_optimizer=False), PatternSearch):
            here = self.physical.logarithm.detach()
            return coarse_pull(lambda points: self.losses_at(batch, points)[0], here).of_trajectories(index)
        follow = None
        if self.fits_starts(batch):
            # Not the states themselves: a run that goes on must not depend on where it was looked at.
            explaining = self._explaining(self.trajectories(batch, self.segment))
            follow, _ = copy.copy(self.starts).improve(explaining, afresh=False)
        cut, slopes = self.answer(batch, follow)
        return Pull.of(self.loss, residuals(self.layer, self.physical, cut), slopes, cut.real).of_trajectories(index)

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

    def on_train_batch_end(self, outputs: Any, batch: Batch, batch_idx: int) -> None:
        """Add the errors of the last evaluation."""
        predicted, cut = self._evaluated
        self.errors["fitted"].update(predicted, cut.pose, cut.real)  # type: ignore[operator]

    def on_train_epoch_end(self) -> None:
        """Log them."""
        self._log_errors("train/", "fitted")

    def predict_step(self, batch: Batch, batch_idx: int) -> Trajectories:
        """Predict whole trajectories from their initial state, under the recorded or the planned wrenches."""
        known = self._started(self.trajectories(batch), batch)
        return known.predicted(self.layer, self.physical(), batch.get("future"))

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Add the errors of the predictions over segments and over whole trajectories."""
        for name, segment in self._lengths().items():
            cut = self.trajectories(batch, segment)
            rollout = self._started(cut, batch).rolled(self.layer, self.physical())
            self.errors[name].update(rollout.pose, cut.pose, cut.real)  # type: ignore[operator]

    test_step = validation_step

    def on_validation_epoch_end(self) -> None:
        """Log the errors."""
        self._log_tested("val")

    def on_test_epoch_end(self) -> None:
        """Log the errors."""
        self._log_tested("test")

    def _lengths(self) -> dict[str, int | None]:
        """Return the segments to predict; whole trajectories once."""
        return {"segments": self.test_segment} | ({} if self.test_segment is None else {"whole": None})

    def _started(self, cut: Trajectories, batch: Batch) -> Trajectories:
        """Return trajectories with initial states from their beginnings alone, where these are to be fitted."""
        if not self.fits_starts(batch):
            return cut
        self._weigh(batch)
        seen = cut.beginnings(self.seen)
        return self._explaining(seen).fit(Starts.guess(seen, self.scene))[0].of(cut)

    def _weigh(self, batch: Batch) -> None:
        """Weigh rotations by the noise of the poses, if no loss is given and the warm-up is over."""
        if self._weighs and self._epochs_after >= 0:
            self.loss = weighed_by(pose_noise(self.trajectories(batch)))

    @property
    def _epochs_after(self) -> int:
        """How many epochs of training came after the warm-up; negative before its end, 1 outside of training."""
        return self.current_epoch - self.warm_up if self._trainer is not None and self._trainer.training else 1

    def _explaining(self, cut: Trajectories, logarithm: Tensor | None = None) -> Explaining:
        return Explaining(self.layer, self.physical, self.loss, cut, logarithm)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keep the initial states too: a resumed run begins from them."""
        super().on_save_checkpoint(checkpoint)
        checkpoint["starts"] = self.starts.state_dict(self.physical.logarithm)

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Take the initial states of the run that is resumed."""
        self.starts.load_state_dict(checkpoint.get("starts", {}))

    def _log_tested(self, stage: str) -> None:
        for name in self._lengths():
            self._log_errors(f"{stage}/" if name == "segments" else f"{stage}/whole_", name)

    def _log_errors(self, prefix: str, name: str) -> None:
        values = self.errors[name].take()  # type: ignore[operator]
        self.log_dict({f"{prefix}{key}": value.float() for key, value in values.items()})
