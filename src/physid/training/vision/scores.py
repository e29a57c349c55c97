"""How well frames are understood and predicted: poses, and images."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

import torch
from torch import Tensor, nn
from torchmetrics.image import PeakSignalNoiseRatio, StructuralSimilarityIndexMeasure

from physid.networks import as_image
from physid.scenes import Scene
from physid.training.parameters import PoseErrors
from physid.training.vision.model import VideoModel
from physid.training.vision.prediction import Prediction
from physid.training.vision.shown_frames import at_frames


@final
class VideoScores(nn.Module):
    """Errors of encoded poses, of rolled-out poses, and of the video drawn from the rolled-out ones.

    Args:
        scene: Gives the sizes of the bodies.
    """

    def __init__(self, scene: Scene) -> None:
        super().__init__()
        self.poses = nn.ModuleDict({name: PoseErrors(scene) for name in ("refined", "encoded", "predicted")})
        self.images = nn.ModuleDict(
            {
                "psnr": PeakSignalNoiseRatio(data_range=1.0, dim=(1, 2, 3), reduction="elementwise_mean"),
                # Of the mean square over all frames: one frame in which nothing has moved yet has no finite ratio.
                "background_psnr": PeakSignalNoiseRatio(data_range=1.0),
                "held_psnr": PeakSignalNoiseRatio(data_range=1.0),
                "ssim": StructuralSimilarityIndexMeasure(data_range=1.0),
            }
        )

    def update(self, model: VideoModel, prediction: Prediction, batch: Mapping[str, Any]) -> None:
        """Add a batch of trajectories; all but the poses of the recordings comes from their video."""
        shown, there = batch["shown"], batch["pose"].device
        recorded = at_frames(batch["pose"], shown)
        real = shown < batch["length"][:, None]
        predicted = at_frames(prediction.rolled.to(there), shown)
        given = {"refined": prediction.refined, "encoded": prediction.encoded, "predicted": predicted}
        for name, pose in given.items():
            self.poses[name].update(pose.double(), recorded, real)  # type: ignore[operator]
        frames, background = as_image(batch["frames"]), as_image(batch["background"])
        drawn = model.decoder(predicted, background)
        first = frames[torch.arange(len(shown), device=shown.device), shown.argmin(1)]
        others = {
            "background_psnr": background[:, None].expand_as(frames),
            "held_psnr": first[:, None].expand_as(frames),
        }
        for name, metric in self.images.items():
            metric.update(others.get(name, drawn)[real], frames[real])  # type: ignore[operator]

    def take(self, stage: str) -> dict[str, Tensor]:
        """Return all scores, and begin anew.

        Their names are position_error and rotation_error of what is read from the frames, encoded_position_error and so
        on of the encoder alone, predicted_position_error and so on of the rollout, psnr and ssim of the video drawn
        from it; held_psnr is that of the first frame held, background_psnr that of the empty scene.
        """
        values: dict[str, Tensor] = {}
        for kind, prefix in (("refined", ""), ("encoded", "encoded_"), ("predicted", "predicted_")):
            errors = self.poses[kind].take()  # type: ignore[operator]
            values |= {f"{stage}/{prefix}{name}": value for name, value in errors.items()}
        for name, metric in self.images.items():
            values[f"{stage}/{name}"] = metric.compute()  # type: ignore[operator]
            metric.reset()  # type: ignore[operator]
        return {name: torch.as_tensor(value).float() for name, value in values.items()}
