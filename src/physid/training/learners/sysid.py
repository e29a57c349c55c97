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

from physid.estimation.least_squares.first_guess import FirstGuess
from physid.estimation.measurement.poses import pose_difference
from physid.training.callbacks.identifiability_warning import IdentifiabilityWarning
from physid.training.callbacks.intervals import Intervals
from physid.training.callbacks.parameter_history import ParameterHistory
from physid.training.callbacks.unexplained import Unexplained
from physid.training.identifiability.identifiability import Identifiability, SensorNoise
from physid.training.initial_states.explaining import started
from physid.training.initial_states.fitted import fit_states, guess_parameters
from physid.training.initial_states.slopes import slopes, without_initial_states
from physid.training.learners.base import OptimizerFactory, TrainingModule
from physid.training.learners.engine import Engine
from physid.training.learners.prediction import PredictingModule
from physid.training.parameters.gauss_newton import GaussNewton
from physid.training.parameters.intervals import Response
from physid.training.parameters.pattern_search import PatternSearch
from physid.training.parameters.pose_loss import PoseLoss
from physid.training.parameters.trajectories import Trajectories

Batch = Mapping[str, Any]
JUDGED = 8  # trajectories that suffice to judge what is identifiable
AFRESH = 3
"""Every so many epochs initial states are also fitted from the first guess again, to leave a local minimum."""

FIRST_GUESS = FirstGuess()


@final
class SysID(TrainingModule, PredictingModule):
    """Identify physical parameters by matching predicted to recorded trajectories.

    The loss is the paper's (see `PoseLoss`), with each trajectory predicted from its initial state. With `segment` it
    is cut into short ones, each predicted from its own initial state: collisions and tumbling amplify every error, so
    that over long trajectories the loss has no usable slope. Initial states are those recorded, or, where only poses
    were recorded, unknowns of each trajectory, fitted anew for every value of the parameters (variable projection,
    Golub & Pereyra 1973): the noise of one pose would otherwise pull the parameters.

    Args:
        learn: Names of the parameters to learn ("block.friction", or of an effect "viscous_drag.coefficient"); None for
            the scene's unknown ones.
        values: Values that replace the scene's, by name: a first guess, or better knowledge of a fixed parameter.
        segment: Steps of a segment in training; None for whole trajectories, as in the paper.
        test_segment: The same in validation and test, where errors over whole trajectories are reported as well.
        twist: Where initial velocities come from: the recording (estimated where it has none), or always from its
            poses.
        start: Whether initial states are as recorded or fitted; None for fitted without twists, or if cameras distort.
        seen: Frames (at most half of them) to which initial states are fitted in tests and predictions.
        loss: What an error of the poses costs; None for the paper's loss.
        guess: How first values are found over short segments where initial states are fitted, so that a first guess
            may be far off; None to begin with the guess itself.
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
        guess: FirstGuess | None = FIRST_GUESS,
        loss: PoseLoss | None = None,
        engine: Engine | None = None,
        optimizer: OptimizerFactory | None = None,
    ) -> None:
        for name, value, least in (("segment", segment, 1), ("test_segment", test_segment, 1), ("seen", seen, 2)):
            if value is not None and value < least:
                raise ValueError(f"model.{name} must be at least {least}, got {value}")
        super().__init__(optimizer or GaussNewton)
        self.learn, self.values = learn, values
        self.segment, self.test_segment, self.twist = segment, test_segment, twist
        self.start, self.seen = start, seen
        self.guess = guess
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
            cut = self._follow(cut)
        predicted = cut.rolled(self.layer, self.physical()).pose
        self._evaluated = predicted.detach(), cut
        return self.loss(pose_difference(predicted, cut.pose), cut.real)

    def _follow(self, cut: Trajectories) -> Trajectories:
        """Return training segments from fitted states, which follow the parameters."""
        explaining = self._explaining(cut)
        _, rollouts = self.tracked.improve(explaining, afresh=self._afresh)
        self.count_evaluations(rollouts)
        return started(cut, *self.tracked.follow(self.physical.coordinates))

    @torch.no_grad()
    def curvature(self, batch: Batch) -> Tensor:
        """Approximate the second derivative of the loss where it was computed last, 2 J^T W J / B, shape (P, P)."""
        cut, fits = self.trajectories(batch, self.segment), self.fits_starts(batch)
        explaining = self._explaining(cut, fitted=fits)
        fit = self.tracked.last
        if fit is None or not fits:
            self.count_evaluations(1 + len(self.physical.names))
            fit, _ = self.tracked.linearised(explaining)
        matrix = fit.normal().matrix.sum(0)[: len(self.physical.names), : len(self.physical.names)]
        return (2 * explaining.unit() / len(cut) * matrix).to(self.physical.coordinates)

    @property
    def _afresh(self) -> bool:
        return self.current_epoch % AFRESH == AFRESH - 1

    @property
    def _kind(self) -> Any:
        """The optimizer; None outside of training."""
        return None if self._trainer is None else self.optimizers(use_pl_optimizer=False)

    def indices(self, batch: Batch) -> Tensor:
        """Return the trajectory of each training segment."""
        return self.trajectories(batch, self.segment).index

    @torch.no_grad()
    def values_at(self, batch: Batch, points: Tensor) -> Tensor:
        """Compute the mean loss at K points (K, P), shape (K,); costs K evaluations."""
        losses, rollouts = self.losses_at(batch, points)
        self.count_evaluations(rollouts)
        return losses.mean(1)

    @torch.no_grad()
    def losses_at(self, batch: Batch, points: Tensor) -> tuple[Tensor, int]:
        """Compute the loss of each segment at K points (K, P), shape (K, B), and count the rollouts."""
        cut, points = self.trajectories(batch, self.segment), self.physical.space.within(points)
        many, every, rollouts = cut.repeated(len(points)), points.repeat_interleave(len(cut), 0), len(points)
        if self.fits_starts(batch):
            explaining = self._explaining(cut)
            states = self.tracked.states(explaining)
            fits = [fit_states(explaining, coordinates=point, states=states) for point in points]
            rollouts += sum(experiment.predictor.simulated[0] for experiment, _ in fits)
            pose, twist = (torch.cat([getattr(fit.point, name)[0] for _, fit in fits]) for name in ("pose", "twist"))
            many = started(many, pose, twist)
        losses = self.loss(many.residual(self.layer, self.physical(every)), many.real)
        return torch.stack(list(losses.values())).sum(0).unflatten(0, (len(points), -1)), rollouts

    def fitted(self) -> tuple[Tensor, Trajectories]:
        """Return the poses that were predicted last in training (B, T, N, 7), and the segments fitted."""
        return self._evaluated

    def identifiability(self, noise: SensorNoise | None = None) -> Identifiability:
        """Judge what some trajectories of the last training batch tell, under their own noise if none is given."""
        cut = self.trajectories(self._batch, self.segment)
        spread, fits = (noise or cut.noise).spread(), self.fits_starts(self._batch)
        cut = self.tracked.started(self._explaining(cut, fitted=fits)).to("cpu")
        cut = cut.chosen((cut.index[:, None] == cut.index.unique()[:JUDGED]).any(1))
        answer, usable = slopes(self.layer, self.physical, cut)
        usable = usable | ~usable.any()  # better all than none
        cut, answer = cut.chosen(usable), answer[:, usable]
        if fits:
            answer = without_initial_states(self.layer, self.physical, cut, answer, spread)
        return Identifiability.of(self.physical.names, answer, cut.real, spread)

    @torch.no_grad()
    def response(self) -> Response:
        """Compute how the estimates respond to the trajectories of the last training batch."""
        batch, index = self._batch, self.indices(self._batch)
        if isinstance(self._kind, PatternSearch):
            here = self.physical.coordinates.detach()
            return Response.coarse(lambda points: self.losses_at(batch, points)[0], here, index)
        cut, response = self._responding(batch)
        if not self.steps.chooses:
            return response
        shift, chosen = self.steps.remaining(self.layer, self.physical, self._coarse_from(cut), cut.noise, response)
        for name, value in (("mean", chosen.mean), ("most", chosen.largest), ("bias", chosen.bias)):
            self.log(f"steps/{name}", float(value))
        return dataclasses.replace(response, shift=shift)

    def _responding(self, batch: Batch) -> tuple[Trajectories, Response]:
        """Return training segments from states fitted for the present parameters, and how estimates respond there."""
        cut = self.trajectories(batch, self.segment)
        explaining = self._explaining(cut, fitted=self.fits_starts(batch))
        # Not the fit that is tracked: a run that goes on must not depend on where it was looked at.
        fit, experiment = copy.copy(self.tracked).linearised(explaining)
        if explaining.fitted:
            cut = started(cut, fit.point.pose[0], fit.point.twist[0])
        return cut, Response.of(experiment, fit, cut.index, cut.noise)

    def _coarse_from(self, cut: Trajectories) -> Trajectories:
        """Return training segments with the longest steps, from the initial states of others."""
        return dataclasses.replace(self._coarse(self._batch, self.segment), origin=cut.origin)

    @torch.no_grad()
    def _choose_steps(self) -> None:
        """Choose the steps of the training segments; the loss is another one then, and the optimizer begins anew.

        Where it has judged points already, at the best of them: the present one is a try.
        """
        if isinstance(self._kind, GaussNewton):
            self._kind.take_back()
            self.tracked.forget_loss()
        cut, response = self.trajectories(self._batch, self.segment), Response.unknown(len(self.physical.names))
        if not isinstance(self._kind, PatternSearch):
            cut, response = self._responding(self._batch)
        self.steps.choose(self.layer, self.physical, self._coarse_from(cut), cut.noise, response)
        self._kind.state.clear()
        self.print(self.steps.report)

    def settled(self) -> bool:
        """Return whether loss and initial states are final, and the engine's steps were chosen near the parameters.

        Initial states take a step in each epoch, and may need more of them than the parameters. Steps of the engine
        that were not chosen near will be chosen before the next epoch.
        """
        fits = self.fits_starts(self._batch)
        return (not fits or self.tracked.converged) and self.steps.settled(self.physical.coordinates)

    def optimizer_step(self, epoch: int, batch_idx: int, optimizer: Any, optimizer_closure: Any = None) -> None:
        """Give GaussNewton the curvature, PatternSearch the losses of other points; others step as ever."""
        kind = getattr(optimizer, "optimizer", optimizer)
        if isinstance(kind, GaussNewton):
            ends = self.physical.space.ends
            optimizer.step(closure=optimizer_closure, curvature=partial(self.curvature, self._batch), ends=ends)
        elif isinstance(kind, PatternSearch):
            optimizer.step(closure=optimizer_closure, values=partial(self.values_at, self._batch))
        else:
            optimizer.step(closure=optimizer_closure)
        self.physical.confine()

    def on_train_batch_start(self, batch: Batch, batch_idx: int) -> None:
        """Keep the batch for the optimizer, and choose the steps of the engine where that is due."""
        self._batch = batch
        if self.guess is not None and self.current_epoch == batch_idx == 0 and self.fits_starts(batch):
            self._guess(batch, self.guess)
        if self.steps.due(self.current_epoch):
            self._choose_steps()
            if batch_idx + 1 == self.trainer.num_training_batches:
                self.steps.reviewed()

    def _guess(self, batch: Batch, guess: FirstGuess) -> None:
        """Find first values of the parameters, and initial states that go with them."""
        self._weigh(batch)
        short = self.trajectories(batch, guess.length(self.scene.time_step) - 1)
        explaining = self._explaining(self.trajectories(batch, self.segment))
        states, rollouts = guess_parameters(explaining, short, guess)
        self.tracked.begin(explaining, states)
        self.count_evaluations(rollouts)

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
        checkpoint["starts"] = self.tracked.state_dict(self.physical.coordinates)
        checkpoint["steps"] = self.steps.state_dict()

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Take the initial states of the run that is resumed."""
        self.tracked.load_state_dict(checkpoint.get("starts", {}))
        self.steps.load_state_dict(checkpoint.get("steps", {}))
