"""Predictions of whole trajectories from their initial states, and how far they are off."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Literal, Self

import lightning as L
import torch

from physid.physics import PhysicsLayer
from physid.scenes import Scene
from physid.training.initial_states import WHOLE, Cutting, Explaining, TrackedFit, fit_beginnings, started_from
from physid.training.learners.engine import Engine
from physid.training.learners.step_control import StepControl
from physid.training.parameters import PhysicalParameters, PoseErrors, PoseLoss, Trajectories

Batch = Mapping[str, Any]


class PredictingModule(L.LightningModule):
    """A module that predicts recorded trajectories, for validation, test and prediction.

    Initial states are those recorded, or fitted to the beginnings of trajectories; steps of the engine those of the
    maker of the recordings, or chosen (see `StepControl`).

    Attributes:
        learn: Names of the parameters to learn; None for the scene's unknown ones.
        values: Values that replace the scene's, by name.
        test_segment: Steps of a segment in validation and test; None for whole trajectories.
        twist: Where initial velocities come from.
        start: Whether initial states are as recorded or fitted.
        seen: Frames (at most half of them) to which initial states are fitted.
        loss: What an error of the poses costs.
        engine: Rules of the physics.
        physical: The physical parameters, once the scene is known.
        scene: The scene as far as it is known, once it is known.
        layer: The physics, once the scene is known.
        tracked: The fit of the training segments.
        steps: The steps of the engine.
    """

    learn: Sequence[str] | None
    values: Mapping[str, float] | None
    test_segment: int | None
    twist: Literal["recorded", "estimated"]
    start: Literal["recorded", "fitted"] | None
    seen: int
    loss: PoseLoss
    engine: Engine
    physical: PhysicalParameters
    scene: Scene
    layer: PhysicsLayer
    tracked: TrackedFit
    steps: StepControl
    _weighs: bool
    _known: tuple[Batch, Trajectories] | None = None  # the last batch, asked for again and again

    def setup(self, stage: str) -> None:
        """Take the scene from the data module, the first time."""
        if not hasattr(self, "layer"):
            self.attach(self.trainer.datamodule.scene)  # type: ignore[attr-defined]

    def attach(self, scene: Scene) -> Self:
        """Build physics, parameters and metrics for a scene; returns itself."""
        self.physical = PhysicalParameters(scene, self.learn, self.values, self.engine.known_effects())
        self.scene, self.layer = scene, self.engine.layer(scene, self.physical.effects)
        self.tracked = TrackedFit()
        self.steps = StepControl(self.engine.chooses(scene), scene.time_step)
        self.errors = torch.nn.ModuleDict({name: PoseErrors(scene) for name in ("fitted", "segments", "whole")})
        return self

    def trajectories(self, batch: Batch, cutting: Cutting = WHOLE) -> Trajectories:
        """Return a batch of the data module as trajectories, cut into segments, with the steps chosen for them."""
        return self.steps.apply(self._coarse(batch, cutting))

    def _coarse(self, batch: Batch, cutting: Cutting = WHOLE) -> Trajectories:
        """Return the same with the longest steps that there may be."""
        if self._known is None or self._known[0] is not batch:
            seen = {name: batch[name] for name in batch if name != "twist" or self.twist == "recorded"}
            world = self.layer.world
            arrival = 0.0 if world.midpoint else world.step
            self._known = (batch, self.steps.lay(Trajectories.of(seen, world.time_step, arrival)))
        return cutting.of(self._known[1])

    def fits_starts(self, batch: Batch) -> bool:
        """Return whether initial states are fitted: where they were not recorded, or not seen."""
        hidden = "twist" not in batch or self.layer.distorts or ("seen" in batch and not bool(batch["seen"].all()))
        return self.start == "fitted" or (self.start is None and hidden)

    def predict_step(self, batch: Batch, batch_idx: int) -> Trajectories:
        """Predict whole trajectories from their initial state, under the recorded or the planned wrenches."""
        known, future = self._started(batch), batch.get("future")
        if future is not None and self.steps.chooses:
            noise, planned = known.noise, known.planned(future, self.scene.time_step)
            known, future = self.steps.choose(self.layer, self.physical, planned, noise), None
        return known.predicted(self.layer, self.physical(), future)

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Add the errors of the predictions over segments and over whole trajectories."""
        for name, segment in self._lengths().items():
            cut = self._started(batch, segment)
            rollout = cut.rolled(self.layer, self.physical())
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

    def _started(self, batch: Batch, segment: int | None = None) -> Trajectories:
        """Return trajectories with initial states from their beginnings alone, and steps, where these are chosen."""
        started = self._from_beginnings(self.trajectories(batch, Cutting(segment)), batch)
        if not self.steps.chooses:
            return started
        coarse = dataclasses.replace(self._coarse(batch, Cutting(segment)), origin=started.origin)
        return self._from_beginnings(self.steps.choose(self.layer, self.physical, coarse, coarse.noise), batch)

    def _from_beginnings(self, cut: Trajectories, batch: Batch) -> Trajectories:
        """Return trajectories with initial states from their beginnings alone, where these are to be fitted."""
        if not self.fits_starts(batch):
            return cut
        self._weigh(self.trajectories(batch))
        return started_from(cut, fit_beginnings(self._explaining(cut.beginnings(self.seen))))

    def _weigh(self, whole: Trajectories) -> None:
        """Weigh rotations by the noise of the poses, if no loss is given."""
        if self._weighs:
            self.loss = PoseLoss.weighed_by(whole.noise)

    def _explaining(self, cut: Trajectories, *, fitted: bool = True) -> Explaining:
        return Explaining(self.layer, self.physical, self.loss, cut, fitted)

    def _log_tested(self, stage: str) -> None:
        for name in self._lengths():
            self._log_errors(f"{stage}/" if name == "segments" else f"{stage}/whole_", name)

    def _log_errors(self, prefix: str, name: str) -> None:
        values = self.errors[name].take()  # type: ignore[operator]
        self.log_dict({f"{prefix}{key}": value.float() for key, value in values.items()})
