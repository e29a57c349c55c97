"""What errors of the first poses do to mass and friction of `collide`, and whether the intervals show it.

    python benchmarks/first_pose_errors.py --sets 3

Fresh sets of 48 trajectories with parameters of their own, known poses as goals, and first poses that are exact, or off
as polished ones are; the last phase of learning from video is carried out from a tenth above the truth, with so many
frames rolled out.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import tempfile
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from physid.configuration import compose
from physid.data.datamodule import RecordingsDataModule
from physid.data.generate import generate
from physid.data.generation import GenerateConfig
from physid.physics.rotations import exponential, multiply
from physid.scenes.catalogue import find_setup
from physid.training.normal_equations import NormalEquations
from physid.training.pose_loss import PoseLoss
from physid.training.supervised import SupervisedID
from physid.training.video.horizon import Horizon
from physid.training.video.refinement import add_to, interval

CONFIG = Path(__file__).parents[1] / "configs" / "generate" / "collide.yaml"
RANGES = {"block.mass": (1.0, 3.0), "block.friction": (0.06, 0.25)}
OFF, TURNED = 1.2e-3, math.radians(0.6)
"""Standard deviations of polished poses in each direction [m], [rad]."""
FRAMES = (150, 60)
STEPS, LONGEST = 14, 0.3


def record(folder: Path, number: int) -> dict[str, float]:
    """Make a set with parameters of its own, and return these."""
    generator = np.random.default_rng(number)
    true = {name: float(generator.uniform(*limits)) for name, limits in RANGES.items()}
    values = ", ".join(f"{name}: {value}" for name, value in true.items())
    settings = ["trajectories=48", "video=false", f"seed={1000 + number}", "guess_factor=1.1"]
    made = compose([str(CONFIG)], [*settings, f"true_values={{{values}}}"])
    generate(GenerateConfig.from_mapping(made.values), folder, 1, quiet=True)
    return true


def astray(pose: Tensor) -> Tensor:
    """Add the errors of polished poses to first poses (B, 1, N, 7)."""
    place = torch.cat([OFF * torch.randn_like(pose[..., :2]), torch.zeros_like(pose[..., :1])], -1)
    turn = torch.cat([torch.zeros_like(place[..., :2]), TURNED * torch.randn_like(place[..., :1])], -1)
    return torch.cat([pose[..., :3] + place, multiply(exponential(turn), pose[..., 3:])], -1)


def identify(data: RecordingsDataModule, frames: int, *, exact: bool) -> dict[str, tuple[float, float, float]]:
    """Return estimates and intervals."""
    scene = dataclasses.replace(data.scene, camera=find_setup("collide").scene.camera)
    module = SupervisedID(list(RANGES), loss=PoseLoss(rotation_weight=0.06)).attach(scene)
    model = module.model
    batch = Horizon(frames).cut(next(iter(data.train_dataloader())), all_trajectories=True)
    goal = batch["pose"]
    batch["shown"] = torch.zeros(len(goal), 1, dtype=torch.long)
    start, real = goal[:, :1], torch.ones(goal.shape[:2], dtype=torch.bool)
    start = start if exact else astray(start)
    bounds: dict[str, float] = {}
    for _ in range(STEPS):
        equations = NormalEquations.empty(len(RANGES))
        add_to(equations, model, module.loss, start, batch, goal, real, from_images=False)
        with torch.no_grad():
            model.physical.logarithm.add_(equations.step(LONGEST))
        bounds = interval(model.physical.estimates(), equations.covariance().diagonal().sqrt().tolist())
    return {
        name: (value, bounds[f"params/{name}/low"], bounds[f"params/{name}/high"])
        for name, value in model.physical.estimates().items()
    }


def main() -> None:
    """Print errors and intervals, relative to the truth."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=3)
    options = parser.parse_args()
    torch.set_num_threads(1)
    for number in range(options.sets):
        with tempfile.TemporaryDirectory() as folder:
            true = record(Path(folder), number)
            data = RecordingsDataModule(folder, fit=("train", "test"), shuffle=False)
            for frames in FRAMES:
                for exact in (True, False):
                    torch.manual_seed(number)
                    words = f"{number:3d} {frames:4d} frames, first poses {'exact' if exact else 'read '}"
                    for name, found in identify(data, frames, exact=exact).items():
                        error, low, high = (100 * (value / true[name] - 1) for value in found)
                        words += f"   {name} {error:+6.2f} % [{low:+6.2f}, {high:+6.2f}]"
                    print(words, flush=True)


if __name__ == "__main__":
    main()
