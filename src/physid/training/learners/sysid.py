"""System identification: physical parameters from recorded poses and known forces."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Literal, final

import lightning as L
import torch
from torch import Tensor

from physid.estimation.least_squares import FirstGuess
from physid.training.initial_states import (
    AROUND_IMPACTS,
    Cutting,
    Explaining,
    OutlierFrames,
    SegmentedFitSettings,
    answers,
    fit_around_impacts,
    weighed_anew,
)
from physid.training.learners.engine import Engine
from physid.training.learners.judging import judging_callbacks
from physid.training.learners.prediction import PredictingModule
from physid.training.parameters import (
    Identifiability,
    Pieces,
    PoseLoss,
    Response,
    SensorNoise,
    Trajectories,
    judge_last,
    take_back,
    take_step,
    uses_slopes,
)
from physid.training.training_module import Mistakes, OptimizerFactory, TrainingModule

Batch = Mapping[str, Any]
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
        impacts: How trajectories are cut around impacts where initial states are fitted and nobody says how recordings
            were integrated, if bodies tumble in most or no states explain the whole; false to leave them as they are.
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
        impacts: SegmentedFitSettings | bool = True,
        loss: PoseLoss | None = None,
        engine: Engine | None = None,
        optimizer: OptimizerFactory | None = None,
    ) -> None:
        for name, value, least in (("segment", segment, 1), ("test_segment", test_segment, 1), ("seen", seen, 2)):
            if value is not None and value < least:
                raise ValueError(f"model.{name} must be at least {least}, got {value}")
        super().__init__(optimizer)
        self.learn, self.values, self.twist, self.start = learn, values, twist, start
        self.segment, self.test_segment, self.seen = segment, test_segment, seen
        self.guess, self.impacts = guess, (AROUND_IMPACTS if impacts is True else impacts or None)
        self.pieces: Pieces | None = None
        self.outliers: OutlierFrames | None = None
        self.loss, self.engine = loss or PoseLoss(), engine or Engine()
        self._weighs = loss is None
        self._known: tuple[Batch, Trajectories] | None = None  # the last batch, asked for again and again

    def configure_callbacks(self) -> list[L.Callback]:
        """Find intervals, keep the history of the parameters, and warn of what is not identifiable or explained."""
        return judging_callbacks()

    def losses(self, batch: Batch) -> dict[str, Tensor]:
        """Compute the losses of each training segment (see `PoseLoss`), its initial state following the parameters."""
        cut = self.trajectories(batch, self._cutting)
        if self.fits_starts(batch):
            self._weigh(self.trajectories(batch, Cutting(None, self.outliers)))
            afresh = self.current_epoch % AFRESH == AFRESH - 1
            cut, rollouts = answers.improve(self._explaining(cut), self.tracked, afresh=afresh)
            self.count_evaluations(rollouts)
        predicted = cut.rolled(self.layer, self.physical()).pose
        self._evaluated = predicted.detach(), cut
        losses = self.loss.between(predicted, cut.pose, cut.real)
        return {name: loss * cut.share for name, loss in losses.items()}

    @torch.no_grad()
    def quadratic(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Approximate the loss where it was computed last: 2 J^T W J / B (P, P), and its slope -2 J^T W r / B (P,)."""
        explaining, fit = self._training(batch), self.tracked.last
        if fit is None or not explaining.fitted:
            self.count_evaluations(1 + len(self.physical.names))
            fit, _ = self.tracked.linearised(explaining)
        return explaining.quadratic(fit)

    def _training(self, batch: Batch) -> Explaining:
        """Return the training segments of a batch, with initial states to be fitted where they are unknown."""
        return self._explaining(self.trajectories(batch, self._cutting), fitted=self.fits_starts(batch))

    @property
    def _cutting(self) -> Cutting:
        """How trajectories are cut in training."""
        return Cutting(self.pieces if self.segment is None else self.segment, self.outliers)

    def _may_be_cut(self, batch: Batch) -> bool:
        """Return whether whole trajectories of a single batch are fitted, by slopes, and no simulator is known.

        Where the scheme and the steps of a simulator are known, what a fit leaves at impacts is how that simulator
        resolves contact: short segments identify the parameters no better (decision 78).
        """
        cut = self._coarse(batch)
        single = self.trainer.num_training_batches == 1 and len(cut.index.unique()) == len(cut)
        return self.steps.chooses and self.segment is None and single and cut.again is None and uses_slopes(self._kind)

    @property
    def _kind(self) -> Any:
        """The optimizer; None outside of training."""
        return None if self._trainer is None else self.optimizers(use_pl_optimizer=False)

    def indices(self, batch: Batch) -> Tensor:
        """Return the trajectory of each training segment."""
        return self.trajectories(batch, self._cutting).index

    @torch.no_grad()
    def values_at(self, batch: Batch, points: Tensor) -> Tensor:
        """Compute the mean loss at K points (K, P), shape (K,); costs K evaluations."""
        losses, rollouts = self.losses_at(batch, points)
        self.count_evaluations(rollouts)
        return losses.mean(1)

    @torch.no_grad()
    def losses_at(self, batch: Batch, points: Tensor) -> tuple[Tensor, int]:
        """Compute the loss of each segment at K points (K, P), shape (K, B), and count the rollouts."""
        return answers.losses_at(self._training(batch), self.tracked, points)

    def fitted(self) -> tuple[Tensor, Trajectories]:
        """Return the poses that were predicted last in training (B, T, N, 7), and the segments fitted."""
        return self._evaluated

    def identifiability(self, noise: SensorNoise | None = None) -> Identifiability:
        """Judge what some trajectories of the last training batch tell, under their own noise if none is given."""
        return answers.judge(self._training(self._batch), self.tracked, noise)

    def findings_of_fit(self) -> Mistakes:
        """Return what the trajectories of the last training batch show beside the fit; nothing where there was none."""
        limits = (self.impacts or AROUND_IMPACTS).unexplained
        begun = hasattr(self, "_batch")  # not where a run is taken up at its end
        return answers.findings_of_fit(self._training(self._batch), self.tracked, self.pieces, limits) if begun else ()

    @torch.no_grad()
    def response(self) -> Response:
        """Compute how the estimates respond to the trajectories of the last training batch."""
        batch, explaining = self._batch, self._training(self._batch)
        if not uses_slopes(self._kind):
            index = self.indices(batch)
            return answers.respond_coarsely(lambda points: self.losses_at(batch, points)[0], explaining, index)
        cut, response = answers.respond(explaining, self.tracked)
        shared = [] if cut.stretch is None else [response(cut.stretch)]
        if self.steps.chooses:
            shift, chosen = self.steps.remaining(self.layer, self.physical, self._coarse_from(cut), cut.noise, response)
            shared.append(shift)
            self.log_dict({f"steps/{name}": getattr(chosen, name) for name in ("mean", "largest", "bias", "left")})
        return dataclasses.replace(response, shared=torch.stack(shared) if shared else None)

    def _coarse_from(self, cut: Trajectories) -> Trajectories:
        """Return training segments with the longest steps, from the initial states of others."""
        return dataclasses.replace(self._coarse(self._batch, self._cutting), origin=cut.origin)

    @torch.no_grad()
    def _choose_steps(self) -> None:
        """Choose the steps of the training segments; the loss is another one then, and the optimizer begins anew.

        Where it has judged points already, at the best of them: the present one is a try.
        """
        if take_back(self._kind):
            self.tracked.forget_loss()
        if (weighed := self._weighed_here()) is not None:
            self.pieces = weighed
            self.tracked.forget_loss()
        explaining = self._training(self._batch)
        cut, response = explaining.trajectories, Response.unknown(len(self.physical.names))
        if uses_slopes(self._kind):
            cut, response = answers.respond(explaining, self.tracked)
        self.steps.choose(self.layer, self.physical, self._coarse_from(cut), cut.noise, response)
        self._kind.state.clear()

    def _weighed_here(self) -> Pieces | None:
        """Return the pieces, each counting as it is explained here, and agrees with the others; None without any."""
        if self.pieces is None or self.impacts is None:
            return None
        return weighed_anew(self.pieces, self._training(self._batch), self.tracked, self.impacts)

    def settled(self) -> bool:
        """Return whether loss and initial states are final, and steps and weights were chosen near the parameters.

        Initial states take a step in each epoch, and may need more of them than the parameters. Steps of the engine
        and weights that were not chosen near will be chosen before the next epoch.
        """
        states = not self.fits_starts(self._batch) or self.tracked.converged or self.exhausted()
        if not states or not self.steps.settled(self.physical.coordinates):
            return False
        weighed = self._weighed_here()
        return weighed is None or self.pieces is None or weighed.counts_like(self.pieces) or not self.steps.ask()

    def exhausted(self) -> bool:
        """Return whether a fit over pieces finds only ripples any more; its parameters are then the best so far."""
        return self.pieces is not None and self.tracked.exhausted and take_back(self._kind)

    def optimizer_step(self, epoch: int, batch_idx: int, optimizer: Any, optimizer_closure: Any = None) -> None:
        """Give GaussNewton the loss near by, PatternSearch the losses of other points; others step as ever."""
        near, values = partial(self.quadratic, self._batch), partial(self.values_at, self._batch)
        last = self.trainer.num_training_batches == 1 and self.current_epoch + 1 == self.trainer.max_epochs
        take_step(optimizer, optimizer_closure, near, values, self.physical.space.ends)
        if last:  # not an evaluation that identifies: it decides between two points, and is not counted
            judge_last(optimizer, lambda points: self.losses_at(self._batch, points)[0].mean(1))
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
        self._weigh(self.trajectories(batch))
        if self.impacts is not None and self._may_be_cut(batch):
            coarse, whole = self._explaining(self._coarse(batch)), self._training(batch)
            found = fit_around_impacts(coarse, whole, self.impacts, chooses=self.steps.chooses)
            self.outliers, self.pieces = found.outliers, found.pieces
            for sentence in found.described(int(whole.trajectories.real.sum())):
                self.print(sentence)
            if found.states is not None:
                self.tracked.begin(self._training(batch), found.states)
                return
        short = self.trajectories(batch, Cutting(guess.length(self.scene.time_step) - 1, self.outliers))
        self.count_evaluations(answers.guess(self._training(batch), self.tracked, short, guess))

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
        checkpoint |= {"starts": self.tracked.state_dict(self.physical.coordinates), "steps": self.steps.state_dict()}
        checkpoint["pieces"] = {} if self.pieces is None else self.pieces.state_dict()
        checkpoint["outliers"] = {} if self.outliers is None else self.outliers.state_dict()

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Take the initial states of the run that is resumed."""
        super().on_load_checkpoint(checkpoint)
        self.tracked.load_state_dict(checkpoint.get("starts", {}))
        self.steps.load_state_dict(checkpoint.get("steps", {}))
        self.pieces = Pieces.of_state(checkpoint.get("pieces", {}))
        self.outliers = OutlierFrames.of_state(checkpoint.get("outliers", {}))
