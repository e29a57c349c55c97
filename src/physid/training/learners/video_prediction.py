"""Predictions of films from their first frames: how a model is built for a scene, how far it is off, what is shown."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any, Self

import lightning as L

from physid.scenes import Scene
from physid.training.callbacks.parameter_history import ParameterHistory
from physid.training.callbacks.predicted_film import PredictedFilm
from physid.training.learners.engine import Engine
from physid.training.parameters import PhysicalParameters, Trajectories
from physid.training.refinement import Batch
from physid.training.vision import (
    EncoderFactory,
    VideoModel,
    VideoScores,
    Vision,
    predict,
    predict_trajectories,
)

logger = logging.getLogger("physid")
SHORT = 1 / 480  # [s] steps that miss little of a stop, and cost a film little beside its images


class VideoPredictingModule(L.LightningModule):
    """A module that predicts recorded films, for validation, test and prediction.

    Attributes:
        learn: Names of the parameters to learn; None for the scene's unknown ones.
        values: Values that replace the scene's, by name.
        engine: Rules of the physics.
        vision: How frames are read.
        model: Encoder, physics and decoder, once the scene is known.
        scores: The errors of its predictions, once the scene is known.
    """

    learn: Sequence[str] | None
    values: Mapping[str, float] | None
    engine: Engine
    vision: Vision
    model: VideoModel
    scores: VideoScores
    _encoder: EncoderFactory

    @property
    def physical(self) -> PhysicalParameters:
        """The physical parameters."""
        return self.model.physical

    def setup(self, stage: str) -> None:
        """Take the scene from the data module, the first time."""
        if not hasattr(self, "model"):
            self.attach(self.trainer.datamodule.scene)  # type: ignore[attr-defined]

    def attach(self, scene: Scene) -> Self:
        """Build encoder, physics, parameters and metrics for a scene; returns itself."""
        physical = PhysicalParameters(scene, self.learn, self.values, self.engine.known_effects())
        layer = self.engine.layer(scene, physical.effects)
        if self.engine.chooses(scene):
            logger.warning(
                "what learns from films, or predicts by it, chooses no steps of the engine: it takes one from frame "
                "to frame (%.3g ms), and misses when within it a block stops, turns around or hits; "
                "model.engine.substeps=%d takes steps of about 2 ms",
                1e3 * scene.time_step,
                max(1, round(scene.time_step / SHORT)),
            )
        self.model = VideoModel(scene, physical, layer, self._encoder, self.vision)
        self.scores = VideoScores(scene)
        return self

    def configure_callbacks(self) -> list[L.Callback]:
        """Keep the history of the parameters, and show what is predicted."""
        return [ParameterHistory(), PredictedFilm()]

    def predict_step(self, batch: Batch, batch_idx: int) -> Trajectories:
        """Predict whole trajectories from their first frames, under the recorded or the planned wrenches."""
        return predict_trajectories(self.model, batch)

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Add the errors of poses and video."""
        self.scores.update(self.model, predict(self.model, batch), batch)

    test_step: Any = validation_step

    def on_validation_epoch_end(self) -> None:
        """Log the errors."""
        self.log_dict(self.scores.take("val"))

    def on_test_epoch_end(self) -> None:
        """Log the errors."""
        self.log_dict(self.scores.take("test"))
