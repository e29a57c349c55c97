"""Learning from video alone: the paper's self-supervised method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import final

import lightning as L
import torch
from torch import Tensor
from torch.optim import Optimizer

from physid.networks.blur import BlurSchedule, GaussianBlur
from physid.networks.encoder import as_image
from physid.scenes.scene import Scene
from physid.training.callbacks.blur_curriculum import BlurCurriculum
from physid.training.callbacks.parameter_history import ParameterHistory
from physid.training.callbacks.predicted_film import PredictedFilm
from physid.training.learners.base import OptimizerFactory, TrainingModule
from physid.training.learners.engine import Engine
from physid.training.learners.optimisation import DEFAULT_OPTIMIZER, build_optimizer, take_encoder, take_step
from physid.training.learners.phases import Phase, Phases, epochs_of
from physid.training.parameters.physical_parameters import PhysicalParameters
from physid.training.parameters.pose_loss import PoseLoss, mean_over_time
from physid.training.parameters.trajectories import Trajectories
from physid.training.refinement.horizon import Batch, Horizon, spread
from physid.training.refinement.refinement import Refinement
from physid.training.vision.initial_state import Start
from physid.training.vision.model import ChartName, VideoModel, at_frames, over_time
from physid.training.vision.pose_cache import PoseCache
from physid.training.vision.pose_refinement import PoseRefinement
from physid.training.vision.scores import VideoScores
from physid.training.vision.synthetic_images import SyntheticImages


@final
class SelfSupervisedID(TrainingModule):
    """Learn an encoder and physical parameters from video, known forces and the look of the bodies, without poses.

    The paper's loss, |I - decoded(encoded)|^2 + alpha |I - decoded(rolled out)|^2 + beta KL, images blurred less and
    less, after a warm-up of encoder and decoder alone (see `Phases`). Squares are averaged over pixels and colours,
    where the paper adds them up: beta = 1 / (3 H W) is the paper's weight.

    Args:
        learn: Names of the parameters to learn ("block.friction"); None for the scene's unknown ones.
        values: Values that replace the scene's, by name: a first guess, or better knowledge of a fixed parameter.
        chart: Which poses the encoder can express: planar, hovering or spatial (see `chart_of`).
        start: How the initial state follows from the encoded poses; None for a start at rest, as in the paper.
        phases: How long each phase lasts; None for the usual ones.
        loss: What an error of rolled-out poses costs while the parameters are refined; its rotation weight holds for
            imagined images, too.
        alpha: Weight of the images drawn from rolled-out poses.
        beta: Weight of the latent distributions' divergence from the standard normal one.
        latent: Length of the latent vector.
        synthetic_images: Images drawn of the bodies at random poses, from which the encoder learns as well; with frames
            = 0 reconstruction is all, as in the paper.
        blur: How the blur goes.
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
        blur: The present blur.
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
        beta: float = 2e-5,
        latent: int = 16,
        synthetic_images: SyntheticImages | None = None,
        blur: BlurSchedule | None = None,
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
        self.alpha, self.beta, self.latent = alpha, beta, latent
        self.synthetic_images, self.pose_refinement = (
            synthetic_images or SyntheticImages(),
            pose_refinement or PoseRefinement(),
        )
        self.schedule = blur or BlurSchedule()
        self.horizon, self.engine = horizon or Horizon(), engine or Engine()
        self.refinement, self.memory, self.blur = Refinement(self.loss), PoseCache(), GaussianBlur()
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

    def attach(self, scene: Scene) -> SelfSupervisedID:
        """Build encoder, physics, parameters and metrics for a scene; returns itself."""
        physical, layer = PhysicalParameters(scene, self.learn, self.values), self.engine.layer(scene)
        self.model = VideoModel(
            scene, physical, layer, self.chart, self.start,
            pose_refinement=self.pose_refinement, latent=self.latent, physics_device=self.physics_device,
            fast=self.fast,
        )  # fmt: skip
        self.scores = VideoScores(scene)
        return self

    def configure_callbacks(self) -> list[L.Callback]:
        """Take the blur away, keep the history of the parameters, and show what is predicted."""
        return [BlurCurriculum(self.schedule, self.phases.refine), ParameterHistory(), PredictedFilm()]

    def configure_optimizers(self) -> Optimizer:
        """Build the optimizer of encoder and parameters."""
        return build_optimizer(self._optimizer, self.model, self.parameter_rate)

    def losses(self, batch: Batch) -> dict[str, Tensor]:
        """Compute the losses of each trajectory: of drawn images, of the latent distributions, of imagined images.

        The encoder warms up with imagined images alone, or, where there are none, by reconstruction as in the paper.
        """
        background, shown = as_image(batch["background"]), batch["shown"]
        values = self.synthetic_images.losses(self.model, background, self.loss.rotation_weight)
        if values and self.phase is Phase.WARM_UP:
            return values
        image = as_image(batch["frames"])
        encoding = self.model.encode(image, background)
        self.require_finite({"encoded": encoding.pose.sum((1, 2, 3))}, batch)
        seen, real = self.blur(image), shown < batch["length"][:, None]
        values["encoded_image"] = mean_over_time(self._mismatch(encoding.pose, seen, background), real)
        values["divergence"] = self.beta * mean_over_time(encoding.divergence, real)
        if self.phase is Phase.JOINT:
            part = self.horizon.cut(batch)
            some, reached = len(part["shown"]), part["shown"] < part["length"][:, None]
            pose = self.model.roll_out(encoding.pose[:some], part["shown"], part["wrench"])
            ahead = at_frames(pose, part["shown"]).to(image)
            rolled = mean_over_time(self._mismatch(ahead, seen[:some], background[:some]), reached)
            values["rolled_image"] = self.alpha * spread(rolled, len(shown))
        return values

    def _mismatch(self, pose: Tensor, seen: Tensor, background: Tensor) -> Tensor:
        """Compare blurred images drawn of poses (B, f, N, 7) with those seen: mean square of the colours, (B, f)."""
        difference: Tensor = self.blur(self.model.decoder(pose, background)) - seen
        return difference.square().mean((-3, -2, -1))

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
        pose = self.memory(self.model, part)
        self.refinement.add(self, self.model, pose, part, *over_time(pose, part), from_images=True)

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
