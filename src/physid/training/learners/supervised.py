"""Learning from video with known poses: the paper's supervised method."""

from __future__ import annotations

from typing import final

import torch
from torch import Tensor

from physid.networks import PoseEncoder, as_image
from physid.training.learners.phases import Phase
from physid.training.learners.video import VideoID
from physid.training.parameters import mean_over_time
from physid.training.refinement import Batch, Readings, spread
from physid.training.vision import EncoderFactory, at_frames, encoding_losses


@final
class SupervisedID(VideoID):
    """Learn an encoder and physical parameters from video whose poses are known in training.

    The paper's loss, e(recorded, encoded) + alpha e(recorded, rolled out from the first encoded pose), after a warm-up
    of the encoder alone; the paper's encoder is the plain one. Arguments as of `VideoID`.
    """

    @classmethod
    def usual_encoder(cls) -> EncoderFactory:
        """Return the plain encoder."""
        return PoseEncoder

    def losses(self, batch: Batch) -> dict[str, Tensor]:
        """Compute the losses of each trajectory: of encoded poses, of the latent distributions, of rolled-out poses."""
        background, shown, loss = as_image(batch["background"]), batch["shown"], self.objective.pose_loss
        encoding = self.model.encode(as_image(batch["frames"]), background)
        real, recorded = shown < batch["length"][:, None], at_frames(batch["pose"], shown).to(encoding.pose)
        imagined = self.imagined(background)
        if self.phase is Phase.WARM_UP and self.objective.deep_supervision:
            apart = encoding_losses(self.model, encoding, recorded, loss.rotation_weight)
            values = {name: mean_over_time(value, real) for name, value in apart.items()}
        else:
            values = loss.between(encoding.pose, recorded, real)
        values = {f"encoded_{name}": value for name, value in values.items()}
        values |= self.divergence_loss(encoding.divergence, real)
        if self.phase is Phase.WARM_UP:
            return values | imagined
        self.require_finite(values, batch)
        rolled = self._rolled(encoding.pose, batch)
        weighed = {f"rolled_{name}": self.objective.alpha * spread(one, len(shown)) for name, one in rolled.items()}
        return values | weighed | imagined

    def _rolled(self, encoded: Tensor, batch: Batch) -> dict[str, Tensor]:
        """Return the losses (b,) of the poses that are rolled out."""
        part = self.objective.horizon.cut(batch)
        pose = self.model.roll_out(encoded[: len(part["shown"])], part["shown"], part["wrench"]).to(encoded.device)
        real = torch.arange(pose.shape[1], device=pose.device) < part["length"][:, None]
        return self.objective.pose_loss.between(pose, part["pose"], real)

    def readings(self, part: Batch) -> Readings:
        """Return the recorded poses, of every frame."""
        known = at_frames(part["pose"], part["shown"])
        real = torch.arange(part["pose"].shape[1], device=known.device) < part["length"][:, None]
        return Readings(known, part["pose"], real, from_images=False)
