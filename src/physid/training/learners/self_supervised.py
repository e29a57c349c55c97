"""Learning from video alone: the paper's self-supervised method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import lightning as L
from torch import Tensor

from physid.networks import BlurSchedule, GaussianBlur, VariationalPoseEncoder, as_image
from physid.training.callbacks.blur_curriculum import BlurCurriculum
from physid.training.learners.engine import Engine
from physid.training.learners.phases import Phase, Phases
from physid.training.learners.video import Objective, VideoID
from physid.training.refinement import Batch, Readings, spread
from physid.training.training_module import OptimizerFactory
from physid.training.vision import EncoderFactory, PoseCache, Vision, at_frames, left_undrawn, mismatch, over_time


@dataclass(frozen=True)
class ImageObjective(Objective):
    """What is minimised where images are compared.

    Squares are averaged over pixels and colours, where the paper adds them up: beta = 1 / (3 H W) is the paper's weight
    of the divergence.

    Attributes:
        blur: How the blur goes, over the epochs in which images are compared.
        relative: Whether squares are divided by those that the empty scene leaves, blurred alike: 1 is then as good as
            drawing nothing, whatever the blur. Otherwise they fall to a thousandth where kernels grow from 5 to 128,
            and the divergence outweighs them.
    """

    blur: BlurSchedule = BlurSchedule()
    relative: bool = False


@final
class SelfSupervisedID(VideoID):
    """Learn an encoder and physical parameters from video, known forces and the look of the bodies, without poses.

    The paper's loss, |I - decoded(encoded)|^2 + alpha |I - decoded(rolled out)|^2 + beta KL, images blurred less and
    less, after a warm-up of encoder and decoder alone; the paper's encoder is the variational one. Arguments as of
    `VideoID`.

    Attributes:
        blur: The present blur.
    """

    objective: ImageObjective

    def __init__(
        self,
        learn: Sequence[str] | None = None,
        values: Mapping[str, float] | None = None,
        encoder: EncoderFactory | None = None,
        vision: Vision = Vision(),
        objective: ImageObjective = ImageObjective(),
        phases: Phases = Phases(),
        engine: Engine = Engine(),
        optimizer: OptimizerFactory | None = None,
    ) -> None:
        super().__init__(learn, values, encoder, vision, objective, phases, engine, optimizer)
        self.memory, self.blur = PoseCache(), GaussianBlur()

    @classmethod
    def usual_encoder(cls) -> EncoderFactory:
        """Return the variational encoder."""
        return VariationalPoseEncoder

    @property
    def imagines(self) -> bool:
        """Whether the encoder warms up with imagined images alone: without any by reconstruction, as in the paper."""
        return self.objective.synthetic_images.frames > 0

    def configure_callbacks(self) -> list[L.Callback]:
        """Take the blur away while images are compared, keep the history of the parameters, and show predictions."""
        first = self.phases.warm_up if self.imagines else 0
        return [BlurCurriculum(self.objective.blur, first, self.phases.refine), *super().configure_callbacks()]

    def losses(self, batch: Batch) -> dict[str, Tensor]:
        """Compute the losses of each trajectory: of imagined images, of drawn images, of the latent distributions."""
        background, shown = as_image(batch["background"]), batch["shown"]
        values = self.imagined(background)
        if self.imagines and self.phase is Phase.WARM_UP:
            return values
        image = as_image(batch["frames"])
        encoding = self.model.encode(image, background)
        self.require_finite({"encoded": encoding.pose.sum((1, 2, 3))}, batch)
        seen, real = self.blur(image), shown < batch["length"][:, None]
        unit = left_undrawn(self.blur, seen, background, real) if self.objective.relative else 1.0
        values["encoded_image"] = mismatch(self.blur, self.model.decoder(encoding.pose, background), seen, real) / unit
        values |= self.divergence_loss(encoding.divergence, real)
        if self.phase is Phase.JOINT:
            part = self.objective.horizon.cut(batch)
            some, reached = len(part["shown"]), part["shown"] < part["length"][:, None]
            pose = self.model.roll_out(encoding.pose[:some], part["shown"], part["wrench"])
            ahead = at_frames(pose, part["shown"]).to(image)
            rolled = mismatch(self.blur, self.model.decoder(ahead, background[:some]), seen[:some], reached)
            values["rolled_image"] = self.objective.alpha * spread(rolled, len(shown)) / unit
        return values

    def readings(self, part: Batch) -> Readings:
        """Return the poses that are read from the frames shown."""
        pose = self.memory(self.model, part)
        return Readings(pose, *over_time(pose, part), from_images=True)
