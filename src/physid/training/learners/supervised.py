"""Learning from video with known poses: the paper's supervised method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, final

import lightning as L
import torch
from torch import Tensor
from torch.optim import Optimizer

from physid.estimation.measurement.poses import pose_difference
from physid.networks.encoder import as_image
from physid.scenes.scene import Scene
from physid.training.callbacks.parameter_history import ParameterHistory
from physid.training.callbacks.predicted_film import PredictedFilm
from physid.training.learners.base import OptimizerFactory, TrainingModule
from physid.training.learners.engine import Engine
from physid.training.learners.optimisation import DEFAULT_OPTIMIZER, build_optimizer, take_encoder, take_step
from physid.training.learners.phases import Phase, Phases, epochs_of
from physid.training.parameters.physical_parameters import PhysicalParameters
from physid.training.parameters.pose_loss import PoseLoss, mean_over_time
from physid.training.parameters.trajectories import Trajectories
from physid.training.refinement.horizon import Horizon, spread
from physid.training.refinement.refinement import Refinement
from physid.training.vision.initial_state import Start
from physid.training.vision.model import ChartName, VideoModel, at_frames
from physid.training.vision.pose_refinement import PoseRefinement
from physid.training.vision.scores import VideoScores
from physid.training.vision.synthetic_images import SyntheticImages, encoding_losses

Batch = Mapping[str, Any]


@final
class SupervisedID(TrainingModule):
    """Learn an encoder and physical parameters from video whose poses are known in training.

    The paper's loss, e(recorded, encoded) + alpha e(recorded, rolled out from the first encoded pose), after a warm-up
    of the encoder alone (see `Phases`).

    Args:
        learn: Names of the parameters to learn ("block.friction"); None for the scene's unknown ones.
        values: Values that replace the scene's, by name: a first guess, or better knowledge of a fixed parameter.
        chart: Which poses the encoder can express: planar, hovering or spatial (see `chart_of`).
        start: How the initial state follows from the encoded poses; None for a start at rest.
        phases: How long each phase lasts; None for the usual ones.
        loss: What an error of the poses costs; None for the paper's.
        alpha: Weight of the rolled-out poses.
        synthetic_images: Images drawn of the bodies at random poses, from which the encoder learns as well.
        refine: How encoded poses are made better by the decoder where the parameters are refined, and in tests; None
            for not at all.
        horizon: How far, and how many, trajectories are rolled out in training; None for all of them.
        engine: Rules of the physics; None for the layer's own.
        optimizer: AdamW or the like, for the encoder.
        parameter_rate: The parameters' highest rate of learning, about their relative change in a step.
        physics_device: Where trajectories are rolled out.
        fast: Whether the encoder's convolutions compute in bfloat16; None where the device has units for it.
        encoder: Checkpoint of another run with this method, whose encoder a fit begins with; None for a new one.

    Attributes:
        model: Encoder, physics and decoder, once the scene is known.
    """

    model: VideoModel
    scores: VideoScores

    def __init__(
        self,
        learn: Sequence[str] | None = None,
        values: Mapping[str, float] | None = None,
        chart: ChartName = "planar",
        start: Start | None = None,
        phases: Phases | None = None,
        loss: PoseLoss | None = None,
        alpha: float = 0.1,
        synthetic_images: SyntheticImages | None = None,
        horizon: Horizon | None = None,
        pose_refinement: PoseRefinement | None = None,
        engine: Engine | None = None,
        optimizer: OptimizerFactory | None = None,
        parameter_rate: float = 1e-2,
        physics_device: str = "cpu",
        fast: bool | None = None,
        encoder: str | None = None,
    ) -> None:
        super().__init__(optimizer or DEFAULT_OPTIMIZER)
        self.automatic_optimization = False
        self.learn, self.values, self.chart = learn, values, chart
        self.start, self.phases, self.loss = start or Start(), phases or Phases(), loss or PoseLoss()
        self.synthetic_images, self.pose_refinement = (
            synthetic_images or SyntheticImages(),
            pose_refinement or PoseRefinement(),
        )
        self.alpha, self.horizon, self.engine = alpha, horizon or Horizon(), engine or Engine()
        self.refinement = Refinement(self.loss)
        self.parameter_rate, self.physics_device, self.fast = parameter_rate, physics_device, fast
        self.encoder = encoder

    @property
    def physical(self) -> PhysicalParameters:
        """The physical parameters."""
        return self.model.physical

    @property
    def phase(self) -> Phase:
        """The present phase."""
        return self.phases.at(self.trainer.current_epoch, epochs_of(self.trainer))

    def setup(self, stage: str) -> None:
        """Take the scene from the data module, the first time, and look at the bodies before a fit."""
        data = self.trainer.datamodule  # type: ignore[attr-defined]
        if not hasattr(self, "model"):
            self.attach(data.scene)
        if stage == "fit":
            self.phases.check(self.trainer.max_epochs)
            self.model.look_at(data.recordings, data.trajectories("fit"))
            if self.encoder is not None:
                take_encoder(self.model, Path(self.encoder))

    def attach(self, scene: Scene) -> SupervisedID:
        """Build encoder, physics, parameters and metrics for a scene; returns itself."""
        physical, layer = PhysicalParameters(scene, self.learn, self.values), self.engine.layer(scene)
        self.model = VideoModel(
            scene, physical, layer, self.chart, self.start,
            pose_refinement=self.pose_refinement, physics_device=self.physics_device, fast=self.fast,
        )  # fmt: skip
        self.scores = VideoScores(scene)
        return self

    def configure_callbacks(self) -> list[L.Callback]:
        """Keep the history of the parameters, and show what is predicted."""
        return [ParameterHistory(), PredictedFilm()]

    def configure_optimizers(self) -> Optimizer:
        """Build the optimizer of encoder and parameters."""
        return build_optimizer(self._optimizer, self.model, self.parameter_rate)

    def losses(self, batch: Batch) -> dict[str, Tensor]:
        """Compute the losses of each trajectory: of the raw numbers while warming up, then the paper's."""
        background, shown = as_image(batch["background"]), batch["shown"]
        encoding = self.model.encode(as_image(batch["frames"]), background)
        real, recorded = shown < batch["length"][:, None], at_frames(batch["pose"], shown).to(encoding.pose)
        weight = self.loss.rotation_weight
        imagined = self.synthetic_images.losses(self.model, background, weight)
        if self.phase is Phase.WARM_UP:
            values = encoding_losses(self.model, encoding, recorded, weight)
            return {f"encoded_{name}": mean_over_time(value, real) for name, value in values.items()} | imagined
        values = self.loss(pose_difference(encoding.pose, recorded), real)
        self.require_finite({f"encoded_{name}": value for name, value in values.items()}, batch)
        rolled = self.loss(*self._rolled(encoding.pose, batch))
        return (
            {f"encoded_{name}": value for name, value in values.items()}
            | {f"rolled_{name}": self.alpha * spread(value, len(shown)) for name, value in rolled.items()}
            | imagined
        )

    def _rolled(self, encoded: Tensor, batch: Batch) -> tuple[Tensor, Tensor]:
        """Return residuals (b, T, N, 6) of the poses rolled out, and which frames are real (b, T)."""
        part = self.horizon.cut(batch)
        pose = self.model.roll_out(encoded[: len(part["shown"])], part["shown"], part["wrench"]).to(encoded.device)
        residual = pose_difference(pose, part["pose"])
        return residual, torch.arange(pose.shape[1], device=pose.device) < part["length"][:, None]

    def indices(self, batch: Batch) -> Tensor:
        """Return the trajectory of each value of a loss."""
        return torch.as_tensor(batch["index"])

    def on_train_epoch_start(self) -> None:
        """Let the encoder stand still in the last phase."""
        self.model.encoder.train(self.phase is not Phase.REFINE)

    def training_step(self, batch: Batch, batch_idx: int) -> None:  # type: ignore[override]
        """Descend along the gradient of the losses, or add up what the parameters' next step needs."""
        if self.phase is not Phase.REFINE:
            take_step(self, super().training_step(batch, batch_idx), self.phases, batch_idx)
            return
        part = self.horizon.cut(batch, all_trajectories=True)
        known = at_frames(part["pose"], part["shown"])
        real = torch.arange(part["pose"].shape[1], device=known.device) < part["length"][:, None]
        self.refinement.add(self, self.model, known, part, part["pose"], real, from_images=False)

    def predict_step(self, batch: Batch, batch_idx: int) -> Trajectories:
        """Predict whole trajectories from their first frames, under the recorded or the planned wrenches."""
        return self.model.foresee(batch)

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Add the errors of poses and video."""
        self.scores.update(self.model, self.model.predict(batch), batch)

    test_step = validation_step

    def on_validation_epoch_end(self) -> None:
        """Log the errors."""
        self.log_dict(self.scores.take("val"))

    def on_test_epoch_end(self) -> None:
        """Log the errors."""
        self.log_dict(self.scores.take("test"))
