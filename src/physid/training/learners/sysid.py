"""System identification: physical parameters from recorded poses and known forces."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Literal, final

import lightning as L
import torch
from torch import Tensor

from physid.estimation.measurement.poses import pose_difference
from physid.training.callbacks.identifiability_warning import IdentifiabilityWarning
from physid.training.callbacks.intervals import Intervals
from physid.training.callbacks.parameter_history import ParameterHistory
from physid.training.callbacks.unexplained import Unexplained
from physid.training.identifiability.identifiability import Identifiability, SensorNoise
from physid.training.initial_states.fitted import TrackedFit
from physid.training.initial_states.projection import project_out_initial_states
from physid.training.learners.base import OptimizerFactory, TrainingModule
from physid.training.learners.engine import Engine
from physid.training.learners.prediction import PredictingModule
from physid.training.parameters.gauss_newton import GaussNewton
from physid.training.parameters.intervals import Response
from physid.training.parameters.pattern_search import PatternSearch
from physid.training.parameters.pose_loss import PoseLoss
from physid.training.parameters.sensitivity import residuals, sensitivity
from physid.training.parameters.slopes import slopes
from physid.training.parameters.trajectories import Trajectories

Batch = Mapping[str, Any]
JUDGED = 8  # trajectories that suffice to judge what is identifiable
AFRESH = 3
"""Every so many epochs initial states are also fitted from the first guess again, to leave a local minimum."""


@final
class SysID(TrainingModule, PredictingModule):
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
    """

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

    def configure_callbacks(self) -> list[L.Callback]:
        """Find intervals, keep the history of the parameters, and warn of what is not identifiable or explained."""
        return [Intervals(), ParameterHistory(), IdentifiabilityWarning(), Unexplained()]

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
        return self.loss(pose_difference(predicted, cut.pose), cut.real)

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

    def fitted(self) -> tuple[Tensor, Trajectories]:
        """Return the poses that were predicted last in training (B, T, N, 7), and the segments fitted."""
        return self._evaluated

    def identifiability(self, noise: SensorNoise | None = None) -> Identifiability:
        """Judge what some trajectories of the last training batch tell, under their own noise if none is given."""
        cut = self.trajectories(self._batch, self.segment)
        spread = (noise or cut.noise).spread()
        if self.fits_starts(self._batch):
            cut = self.starts.starts(self._explaining(cut)).of(cut)
        cut = cut.chosen((cut.index[:, None] == cut.index.unique()[:JUDGED]).any(1))
        found = slopes(self.layer, self.physical, cut)
        usable = found.usable | ~found.usable.any()  # better all than none
        cut, answer = cut.chosen(usable), found.sensitivity[:, usable]
        if self.fits_starts(self._batch):
            answer = project_out_initial_states(self.layer, self.physical, cut, answer, 1 / spread)
        return Identifiability.of(self.physical.names, answer, cut.real, spread)

    @torch.no_grad()
    def response(self) -> Response:
        """Compute how the estimates respond to the trajectories of the last training batch."""
        batch, index = self._batch, self.indices(self._batch)
        if isinstance(self.optimizers(use_pl_optimizer=False), PatternSearch):
            here = self.physical.logarithm.detach()
            return Response.coarse(lambda points: self.losses_at(batch, points)[0], here, index)
        cut, slopes, residual = self._followed(batch)
        response = Response.of(self.loss, residual, slopes, cut, cut.noise)
        if not self.steps.chooses:
            return response
        shift, chosen = self.steps.remaining(self.layer, self.physical, self._coarse_from(cut), cut.noise, response)
        for name, value in (("mean", chosen.mean), ("most", chosen.largest), ("bias", chosen.bias)):
            self.log(f"steps/{name}", float(value))
        return dataclasses.replace(response, shift=shift)

    def _followed(self, batch: Batch) -> tuple[Trajectories, Tensor, Tensor]:
        """Return training segments from states fitted for the present parameters, their answer and residuals."""
        follow = None
        if self.fits_starts(batch):
            # Not the states themselves: a run that goes on must not depend on where it was looked at.
            explaining = self._explaining(self.trajectories(batch, self.segment))
            follow, _ = copy.copy(self.starts).improve(explaining, afresh=False)
        cut, slopes = self.answer(batch, follow)
        return cut, slopes, residuals(self.layer, self.physical, cut)

    def _coarse_from(self, cut: Trajectories) -> Trajectories:
        """Return training segments with the longest steps, from the initial states of others."""
        return dataclasses.replace(self._coarse(self._batch, self.segment), origin=cut.origin)

    @torch.no_grad()
    def _choose_steps(self) -> None:
        """Choose the steps of the training segments; the loss is another one then, and the optimizer begins anew."""
        cut = self.trajectories(self._batch, self.segment)
        kind: Any = self.optimizers(use_pl_optimizer=False)
        noise, response = cut.noise, Response.unknown(len(self.physical.names))
        if not isinstance(kind, PatternSearch):
            cut, slopes, residual = self._followed(self._batch)
            response = Response.of(self.loss, residual, slopes, cut, noise)
        self.steps.choose(self.layer, self.physical, self._coarse_from(cut), noise, response)
        kind.state.clear()
        self.print(self.steps.report)

    def settled(self) -> bool:
        """Return whether the steps of the engine were chosen near the present parameters; if not, they will be."""
        return self.steps.settled(self.physical.logarithm)

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
        """Keep the batch for the optimizer, and choose the steps of the engine where that is due."""
        self._batch = batch
        if self.steps.due(self.current_epoch):
            self._choose_steps()
            if batch_idx + 1 == self.trainer.num_training_batches:
                self.steps.reviewed()

    def on_train_batch_end(self, outputs: Any, batch: Batch, batch_idx: int) -> None:
        """Add the errors of the last evaluation."""
        predicted, cut = self._evaluated
        self.errors["fitted"].update(predicted, cut.pose, cut.real)  # type: ignore[operator]

    def on_train_epoch_end(self) -> None:
        """Log them."""
        self._log_errors("train/", "fitted")

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keep the initial states too: a resumed run begins from them."""
        super().on_save_checkpoint(checkpoint)
        checkpoint["starts"] = self.starts.state_dict(self.physical.logarithm)
        checkpoint["steps"] = self.steps.state_dict()

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Take the initial states of the run that is resumed."""
        self.starts.load_state_dict(checkpoint.get("starts", {}))
        self.steps.load_state_dict(checkpoint.get("steps", {}))
