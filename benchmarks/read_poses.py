"""What errors of poses that were read do to mass and friction of `collide`, and whether the intervals show it.

    python benchmarks/read_poses.py --sets 3

Fresh sets of 48 trajectories with parameters of their own; their poses are known, or those of every tenth frame are off
as refined ones are. The last phase of learning from video is carried out from a tenth above the truth, with so many
frames rolled out.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
import tempfile
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from video_intervals import Bounds, refine

from physid.configuration import compose
from physid.data.batches.datamodule import RecordingsDataModule
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.physics.rotations import exponential, multiply
from physid.scenes import find_setup
from physid.training.learners.supervised import SupervisedID
from physid.training.learners.video import Objective
from physid.training.parameters.pose_loss import PoseLoss
from physid.training.refinement.horizon import Horizon

CONFIG = Path(__file__).parents[1] / "configs" / "generate" / "collide.yaml"
RANGES = {"block.mass": (1.0, 3.0), "block.friction": (0.06, 0.25)}
OFF, TURNED = 1.2e-3, math.radians(0.6)
"""Standard deviations of refined poses in each direction [m], [rad]."""
EVERY = 10
"""Frames between those that are read where no pose is known."""
READ = {False: "poses known", True: "poses read"}


def record(folder: Path, number: int) -> dict[str, float]:
    """Make a set with parameters of its own, and return these."""
    generator = np.random.default_rng(number)
    true = {name: float(generator.uniform(*limits)) for name, limits in RANGES.items()}
    values = ", ".join(f"{name}: {value}" for name, value in true.items())
    settings = ["trajectories=48", "video=false", f"seed={1000 + number}", "guess_factor=1.1"]
    made = compose([str(CONFIG)], [*settings, f"true_values={{{values}}}"], reads=GenerateConfig)
    generate(GenerateConfig.from_mapping(made.values), folder, 1, quiet=True)
    return true


def astray(pose: Tensor) -> Tensor:
    """Add the errors of refined poses to initial poses (B, 1, N, 7)."""
    place = torch.cat([OFF * torch.randn_like(pose[..., :2]), torch.zeros_like(pose[..., :1])], -1)
    turn = torch.cat([torch.zeros_like(place[..., :2]), TURNED * torch.randn_like(place[..., :1])], -1)
    return torch.cat([pose[..., :3] + place, multiply(exponential(turn), pose[..., 3:])], -1)


def identify(data: RecordingsDataModule, frames: int, *, read: bool) -> Bounds:
    """Return estimates and intervals where all poses are known, or every tenth is read."""
    scene = dataclasses.replace(data.scene, camera=find_setup("collide").scene.camera)
    module = SupervisedID(list(RANGES), objective=Objective(PoseLoss(rotation_weight=0.06))).attach(scene)
    batch = Horizon(frames).cut(next(iter(data.train_dataloader())), all_trajectories=True)
    goal = batch["pose"].double()
    batch["shown"] = torch.zeros(len(goal), 1, dtype=torch.long)
    real = torch.ones(goal.shape[:2], dtype=torch.bool)
    if read:
        goal = astray(goal)
        real &= torch.arange(goal.shape[1]) % EVERY == 0
    return refine(module, scene, batch, goal[:, :1], goal, real, from_images=read)


def main() -> None:
    """Print errors and intervals, relative to the truth, and their summary."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=3)
    parser.add_argument("--frames", type=int, nargs="+", default=[60, 100, 150])
    options = parser.parse_args()
    torch.set_num_threads(1)
    off: defaultdict[tuple[int, bool, str], list[float]] = defaultdict(list)
    held = Counter[tuple[int, bool, str]]()
    for number in range(options.sets):
        with tempfile.TemporaryDirectory() as folder:
            true = record(Path(folder), number)
            data = RecordingsDataModule(folder, fit=("train", "test"), shuffle=False)
            for frames, read in itertools.product(options.frames, READ):
                torch.manual_seed(number)
                words = f"{number:3d} {frames:4d} frames, {READ[read]:11s}"
                for name, found in identify(data, frames, read=read).items():
                    error, low, high = (100 * (value / true[name] - 1) for value in found)
                    words += f"   {name} {error:+6.2f} % [{low:+6.2f}, {high:+6.2f}]"
                    off[frames, read, name].append(abs(error))
                    held[frames, read, name] += low <= 0 <= high
                print(words, flush=True)
    for (frames, read, name), errors in sorted(off.items()):
        share = f"{held[frames, read, name]} of {len(errors)} intervals hold the truth"
        print(f"{frames} frames, {READ[read]}, {name}: {share}, mean error {np.mean(errors):.2f} %")


if __name__ == "__main__":
    main()
