"""How the encoder's errors fall with the number of imagined images it has learned from.

    python benchmarks/encoder_curve.py                      with deep supervision, as it ships
    python benchmarks/encoder_curve.py --scene collide      of two blocks (slide: of one that falls)
    python benchmarks/encoder_curve.py --encoder paper      with the paper's layers
    python benchmarks/encoder_curve.py --features constant  features count as much to the end
    python benchmarks/encoder_curve.py --features off       the encoder's own outputs alone
    python benchmarks/encoder_curve.py --edges soft         no images with hard edges

Films are made first: 16 give the look of the blocks, 16 others what the encoder has to read. Errors are means
over 512 imagined images, and over 10 frames of each of these films; positions in percent of the block.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from unittest import mock

import torch
from torch import Tensor

from physid.configuration import compose
from physid.data import RecordingSet
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.networks import PoseEncoder, as_image
from physid.networks.voting import VotingPoseEncoder
from physid.training.learners.optimisation import DEFAULT_OPTIMIZER, LARGEST_GRADIENT, build_optimizers
from physid.training.learners.phases import Phases
from physid.training.learners.supervised import SupervisedID
from physid.training.parameters.metrics import PoseErrors
from physid.training.vision.drawing import synthetic_images as synthetic_images
from physid.training.vision.drawing.synthetic_images import SyntheticImages
from physid.training.vision.first_look import look_at
from physid.training.vision.model import VideoModel
from physid.training.vision.reading import ChartName, EncoderFactory, Vision

CONFIGS = Path(__file__).parents[1] / "configs" / "generate"
CHARTS: dict[str, ChartName] = {"push": "planar", "slide": "hovering", "collide": "planar"}
ENCODERS: dict[str, EncoderFactory] = {"voting": VotingPoseEncoder, "paper": PoseEncoder}
LOOKED_AT = 16
FRAMES = range(0, 300, 30)
BATCH = 32
LINES = 8


def recorded(films: RecordingSet) -> tuple[Tensor, Tensor, Tensor]:
    """Return images (B, f, 3, H, W), backgrounds (B, 3, H, W) and poses (B, f, N, 7) of the films to be read."""
    images, backgrounds, poses = [], [], []
    for index in range(LOOKED_AT, len(films)):
        image, _, background = films.film(index, list(FRAMES))
        pose = films.read(index).pose
        assert pose is not None
        images.append(as_image(torch.from_numpy(image)))
        backgrounds.append(as_image(torch.from_numpy(background)))
        poses.append(torch.from_numpy(pose[list(FRAMES)]))
    return torch.stack(images), torch.stack(backgrounds), torch.stack(poses)


@torch.no_grad()
def errors(films: RecordingSet, model: VideoModel, image: Tensor, background: Tensor, pose: Tensor) -> str:
    """Return position and rotation error of what the encoder says."""
    scores = PoseErrors(films.scene)
    real = torch.ones(pose.shape[:2], dtype=torch.bool)
    scores.update(model.encode(image, background).pose.double(), pose.double(), real)
    found = scores.take()
    return f"{100 * found['position_error']:8.1f} % {found['rotation_error']:6.1f} deg"


def learn(films: RecordingSet, encoder: EncoderFactory, images: int, *, features: bool) -> None:
    """Learn from imagined images and print a line now and then."""
    vision = Vision(chart=CHARTS[films.scene.name])
    model = SupervisedID(["block.friction"], encoder=encoder, vision=vision).attach(films.scene).model
    look_at(model, films, list(range(LOOKED_AT)))
    seen = recorded(films)
    background = seen[1][:1]
    known = SyntheticImages(frames=512).draw_poses(model, 1)
    shown = SyntheticImages(frames=512).draw_images(model, known, background), background, known
    optimizer, phases, steps = build_optimizers(DEFAULT_OPTIMIZER, model, 0.0)[0], Phases(0, 0), images // BATCH
    start = time.process_time()
    print("  images        imagined             recorded       CPU s")
    for step in range(1, steps + 1):
        for group in optimizer.param_groups:
            group["lr"] = phases.encoder_share(step, steps) * group["highest"]
        losses = SyntheticImages(frames=BATCH).losses(model, background, 0.06)
        kept = [value.mean() for name, value in losses.items() if features or name != "imagined_features"]
        optimizer.zero_grad()
        torch.stack(kept).sum().backward()
        torch.nn.utils.clip_grad_norm_(optimizer.param_groups[0]["params"], LARGEST_GRADIENT)
        optimizer.step()
        if step % max(steps // LINES, 1) == 0:
            spent = time.process_time() - start
            print(
                f"{step * BATCH:8d} {errors(films, model, *shown)} {errors(films, model, *seen)} {spent:8.0f}",
                flush=True,
            )


def main() -> None:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", choices=CHARTS, default="push")
    parser.add_argument("--encoder", choices=ENCODERS, default="voting")
    parser.add_argument("--images", type=int, default=24576)
    parser.add_argument("--features", choices=("on", "constant", "off"), default="on")
    parser.add_argument("--edges", choices=("both", "soft"), default="both")
    options = parser.parse_args()
    torch.manual_seed(0)
    torch.set_num_threads(1)
    config = CONFIGS / f"{options.scene}.yaml"
    with tempfile.TemporaryDirectory() as place:
        generate(
            GenerateConfig.from_mapping(compose([str(config)], ["trajectories=32"], reads=GenerateConfig).values),
            Path(place) / "films",
            1,
        )
        hard = synthetic_images.HARD if options.edges == "both" else 1.0
        constant = {"unknown_share": lambda *_: 1.0} if options.features == "constant" else {}
        with mock.patch.multiple(synthetic_images, HARD=hard, **constant):
            films, encoder = RecordingSet(Path(place) / "films"), ENCODERS[options.encoder]
            learn(films, encoder, options.images, features=options.features != "off")


if __name__ == "__main__":
    main()
