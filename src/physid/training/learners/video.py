"""Learning from video: what the supervised and the self-supervised method share, which is all but the losses."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import torch
from torch import Tensor
from torch.optim import Optimizer

from physid.training.learners.engine import Engine
from physid.training.learners.optimisation import DEFAULT_OPTIMIZER, build_optimizers, take_encoder, take_step
from physid.training.learners.phases import Phase, Phases, epochs_of
from physid.training.learners.video_prediction import VideoPredictingModule
from physid.training.parameters import PoseLoss, mean_over_time
from physid.training.refinement import Batch, Horizon, Readings, Refinement
from physid.training.training_module import OptimizerFactory, TrainingModule
from physid.training.vision import EncoderFactory, SyntheticImages, Vision, look_at


@dataclass(frozen=True)
class Objective:
    """What is minimised.

    Attributes:
        pose_loss: What an error of a pose costs; its rotation weight holds for imagined images, too.
        alpha: Weight of what is rolled out, relative to what is encoded.
        beta: Weight of the divergence of a variational encoder's latent distributions from the standard normal one.
        deep_supervision: Whether known poses teach the early layers headings, too (see `DeepSupervision`), and the
            warm-up compares the raw numbers of rotations, which have no seam. Otherwise it compares poses, as the paper
            does.
        synthetic_images: Images drawn of the bodies at random poses, from which the encoder learns as well; the paper
            has none (frames: 0).
        horizon: How far, and how many, trajectories are rolled out.
    """

    pose_loss: PoseLoss = PoseLoss()
    alpha: float = 0.1
    beta: float = 2e-5
    deep_supervision: bool = True
    synthetic_images: SyntheticImages = SyntheticImages()
    horizon: Horizon = Horizon()


class VideoID(TrainingModule, VideoPredictingModule):
    """Learn an encoder and physical parameters from video, in phases (see `Phases`).

    Args:
        learn: Names of the parameters to learn ("block.friction"); None for the scene's unknown ones.
        values: Values that replace the scene's, by name: a first guess, or better knowledge of a fixed parameter.
        encoder: Builds the encoder; None for the paper's with this method.
        vision: How frames are read.
        objective: What is minimised.
        phases: How long each phase lasts, and the rates of learning.
        engine: Rules of the physics.
        optimizer: AdamW or the like, for the encoder; None for AdamW.

    Attributes:
        model: Encoder, physics and decoder, once the scene is known.
    """

    # A run that goes on has its weights, and may be given longer phases.
    MAY_CHANGE: ClassVar[frozenset[str]] = frozenset({"vision.weights", "phases"})

    def __init__(
        self,
        learn: Sequence[str] | None = None,
        values: Mapping[str, float] | None = None,
        encoder: EncoderFactory | None = None,
        vision: Vision = Vision(),
        objective: Objective = Objective(),
        phases: Phases = Phases(),
        engine: Engine = Engine(),
        optimizer: OptimizerFactory | None = None,
    ) -> None:
        super().__init__(optimizer or DEFAULT_OPTIMIZER)
        self.automatic_optimization = False
        self.learn, self.values, self.phases, self.engine = learn, values, phases, engine
        self.objective, self.vision, self._encoder = objective, vision, encoder or self.usual_encoder()
        self.refinement = Refinement(objective.pose_loss)

    @classmethod
    @abstractmethod
    def usual_encoder(cls) -> EncoderFactory:
        """Return what builds the paper's encoder with this method."""

    @property
    def phase(self) -> Phase:
        """The present phase."""
        return self.phases.at(self.trainer.current_epoch, epochs_of(self.trainer))

    @property
    def by_gradient(self) -> bool:
        """Whether what the parameters are at present, the gradient of the losses has made them."""
        return self.phase is not Phase.REFINE

    def setup(self, stage: str) -> None:
        """Take the scene from the data module, the first time, and look at the bodies before a fit."""
        super().setup(stage)
        if stage == "fit":
            data = self.trainer.datamodule  # type: ignore[attr-defined]
            self.phases.check(self.trainer.max_epochs)
            look_at(self.model, data.recordings, data.trajectories("fit"))
            if self.vision.weights is not None:
                take_encoder(self.model, Path(self.vision.weights))

    def configure_optimizers(self) -> list[Optimizer]:  # type: ignore[override]
        """Build the optimizer that follows the gradient, and the one that takes the steps of the last phase."""
        return build_optimizers(self._optimizer, self.model, self.phases.parameter_rate)

    @abstractmethod
    def readings(self, part: Batch) -> Readings:
        """Return the poses that the parameters are refined with, of the part of a batch that is rolled out."""

    def imagined(self, background: Tensor) -> dict[str, Tensor]:
        """Compute the losses of imagined images on backgrounds (B, 3, H, W), each of shape (B,), if there are any."""
        objective, weight = self.objective, self.objective.pose_loss.rotation_weight
        return objective.synthetic_images.losses(self.model, background, weight, features=objective.deep_supervision)

    def divergence_loss(self, divergence: Tensor, real: Tensor) -> dict[str, Tensor]:
        """Compute what divergences (B, f) of latent distributions cost over real images, (B,), if there are any."""
        if not self.model.encoder.variational:
            return {}
        return {"divergence": self.objective.beta * mean_over_time(divergence, real)}

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
        part = self.objective.horizon.cut(batch, all_trajectories=True)
        self.refinement.add(self, self.model, part, self.readings(part))
