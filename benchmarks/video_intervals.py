"""How often the 90 % interval of a parameter learned from video holds the truth.

One trained encoder and its decoder read many small sets of fresh recordings, each with a true friction of its own; only
the last phase, which gives the interval, is carried out for each.

    python benchmarks/video_intervals.py --run runs/reproduce/supervised/push_friction --sets 20
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
import torch

from physid.configuration import compose
from physid.data.datamodule import RecordingsDataModule
from physid.data.generate import generate
from physid.data.generation import GenerateConfig
from physid.networks.encoder import as_image
from physid.training.normal_equations import NormalEquations
from physid.training.physical_parameters import PhysicalParameters
from physid.training.pose_loss import PoseLoss
from physid.training.supervised import SupervisedID
from physid.training.video.model import VideoModel, over_time
from physid.training.video.polish import Polish
from physid.training.video.refinement import LARGEST_STEP, add_to, interval

CONFIG = Path(__file__).parents[1] / "configs" / "generate" / "push.yaml"
FRICTION = (0.06, 0.25)
PARAMETER = "block.friction"
STEPS = 8
FRAMES = 60
"""Frames between those that are read without supervision."""


def record(folder: Path, number: int, trajectories: int) -> float:
    """Make a set with a friction of its own, and return it."""
    friction = float(np.random.default_rng(number).uniform(*FRICTION))
    settings = [f"trajectories={trajectories}", f"seed={1000 + number}", f"true_values={{{PARAMETER}: {friction}}}"]
    generate(GenerateConfig.from_mapping(compose([str(CONFIG)], settings).values), folder, 1)
    return friction


def load(run: Path) -> VideoModel:
    """Return the model that a supervised run has trained."""
    state = torch.load(run / "checkpoints" / "last.ckpt", map_location="cpu", weights_only=True)["state_dict"]
    arguments = compose([str(run / "config.yaml")]).values
    scene = RecordingsDataModule(arguments["data"]["init_args"]["folder"]).scene
    module = SupervisedID([PARAMETER], polish=Polish(**arguments["model"]["init_args"]["polish"])).attach(scene)
    module.load_state_dict(state, strict=False)
    return module.eval().model


def identify(model: VideoModel, folder: Path, *, from_images: bool) -> tuple[float, float, float]:
    """Return estimate and interval of the friction, with known poses as goals or with those read from images."""
    data = RecordingsDataModule(folder, video="all", every=FRAMES, fit=("train", "test"), shuffle=False)
    model.physical = PhysicalParameters(data.scene, [PARAMETER])
    model.look_at(data.recordings, data.trajectories("fit"))
    batch = next(iter(data.train_dataloader()))
    _, encoded = model.read(as_image(batch["frames"]), as_image(batch["background"]))
    goal, real = over_time(encoded.double(), batch)
    if not from_images:
        goal, real = batch["pose"], torch.ones_like(real)
    bounds: dict[str, float] = {}
    for _ in range(STEPS):
        equations = NormalEquations.empty(1)
        add_to(equations, model, PoseLoss(), encoded, batch, goal, real, from_images=from_images)
        with torch.no_grad():
            model.physical.logarithm.add_(equations.step(LARGEST_STEP))
        bounds = interval(model.physical.estimates(), equations.covariance().diagonal().sqrt().tolist())
    return model.physical.estimates()[PARAMETER], *(bounds[f"params/{PARAMETER}/{end}"] for end in ("low", "high"))


def main() -> None:
    """Print every set and the share of intervals that hold the truth."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", type=Path, required=True, help="a supervised run of push_friction")
    parser.add_argument("--sets", type=int, default=20)
    parser.add_argument("--trajectories", type=int, default=24)
    options = parser.parse_args()
    model, held, errors = load(options.run), {True: 0, False: 0}, {True: [], False: []}
    for number in range(options.sets):
        with tempfile.TemporaryDirectory() as folder:
            true = record(Path(folder), number, options.trajectories)
            for supervised in held:
                estimate, low, high = identify(model, Path(folder), from_images=not supervised)
                held[supervised] += low <= true <= high
                errors[supervised].append(abs(estimate - true) / true)
                name = "supervised" if supervised else "self-supervised"
                print(f"{number:3d} {name:15s} true {true:.5f}  {estimate:.5f} [{low:.5f}, {high:.5f}]", flush=True)
    for supervised, name in ((True, "supervised"), (False, "self-supervised")):
        share, error = held[supervised] / options.sets, float(np.mean(errors[supervised]))
        print(f"{name}: {share:.0%} of {options.sets} intervals hold the truth, mean error {error:.3%}")


if __name__ == "__main__":
    main()
