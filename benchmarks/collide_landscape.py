"""How the loss of SysID on `collide` lies around the truth: along the mass at several horizons, and along a line.

    python benchmarks/collide_landscape.py

Recordings are made first: 16 trajectories without noise. The first table has the paper's loss at other masses relative
to that at the truth, the friction being true; the second, for two weights of rotations, the loss over 300 steps on the
way from where a direct fit from twice the truth stops (0) to the truth (1) and beyond; the third, in segments of so
many steps, the loss at the truth and where fits with growing segments have ended, early and at the minimum, and in how
many segments the minimum fits better than the truth.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from physid.configuration import compose
from physid.data.batches.datamodule import RecordingsDataModule
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.physics.contact import Penetrating
from physid.training.learners.engine import Engine
from physid.training.learners.sysid import SysID
from physid.training.parameters.pose_loss import PoseLoss

CONFIG = Path(__file__).parents[1] / "configs" / "generate" / "collide.yaml"
NAMES = ["block.mass", "block.friction"]
FACTORS = (0.5, 0.9, 0.98, 1.0, 1.02, 1.1, 2.0)
HORIZONS = (30, 100, 300)
STOPPED = (1.35616, 0.120438)
"""Mass [kg] and friction at which the direct fit comes to a stop."""
ENDED = ((1.471, 0.1025), (1.442, 0.1068))
"""The same of fits with growing segments: one that ended early, and that of `make reproduce` (docs/results.md)."""
SHARES = tuple(share / 4 for share in range(-1, 6))


def losses(batch: dict[str, Any], scene: Any, weight: float, points: Tensor, steps: int) -> list[float]:
    """Return the mean loss over so many steps at points ln(parameter) (K, 2)."""
    engine = Engine(contact=Penetrating(correction=0.2))
    module = SysID(learn=NAMES, loss=PoseLoss(rotation_weight=weight), engine=engine).attach(scene)
    cut = batch | {name: batch[name][:, : steps + 1] for name in ("pose", "twist", "wrench")}
    cut["length"] = cut["length"].clamp_max(steps + 1)
    found: list[float] = module.losses_at(cut, points)[0].mean(1).tolist()
    return found


def losses_in_segments(batch: dict[str, Any], scene: Any, points: Tensor, steps: int) -> Tensor:
    """Return the paper's loss of each segment of so many steps at points ln(parameter) (K, 2), shape (K, segments)."""
    segment = None if steps == max(HORIZONS) else steps
    engine = Engine(contact=Penetrating(correction=0.2))
    module = SysID(learn=NAMES, loss=PoseLoss(rotation_weight=1.0), engine=engine, segment=segment).attach(scene)
    found: Tensor = module.losses_at(batch, points)[0]
    return found


def main() -> None:
    """Print the tables."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    torch.set_num_threads(1)
    torch.set_default_dtype(torch.float64)
    with tempfile.TemporaryDirectory() as folder:
        made = compose([str(CONFIG)], ["trajectories=18", "video=false"], reads=GenerateConfig)
        generate(GenerateConfig.from_mapping(made.values), Path(folder), 1, quiet=True)
        data = RecordingsDataModule(folder, limit=16, shuffle=False)
        batch, scene = next(iter(data.train_dataloader())), data.scene
        first_guess = [math.log(scene.value(name)) for name in NAMES]
    true = torch.tensor(first_guess) - math.log(2)
    print("| steps |", " | ".join(f"mass x {factor:g}" for factor in FACTORS), "|")
    for steps in HORIZONS:
        points = torch.stack([true + torch.tensor([math.log(factor), 0.0]) for factor in FACTORS])
        found = losses(batch, scene, 1.0, points, steps)
        print(f"| {steps} |", " | ".join(f"{value / found[3]:.3g}" for value in found), "|", flush=True)
    print("\n| weight of rotations |", " | ".join(f"{share:g}" for share in SHARES), "|")
    stopped = torch.tensor(STOPPED).log()
    points = stopped + torch.tensor(SHARES)[:, None] * (true - stopped)
    for weight in (1.0, 0.01):
        found = losses(batch, scene, weight, points, max(HORIZONS))
        print(f"| {weight:g} m^2/rad^2 |", " | ".join(f"{value:.2e}" for value in found), "|", flush=True)
    points = torch.stack([true, *torch.tensor(ENDED).log()])
    print("\n| segments of |", " | ".join(f"{m:.4g} kg, {f:.4g}" for m, f in points.exp().tolist()), "| better |")
    for steps in HORIZONS:
        each = losses_in_segments(batch, scene, points, steps)
        better = f"{int((each[-1] < each[0]).sum())} of {each.shape[1]}"
        print(f"| {steps} |", " | ".join(f"{value:.2e}" for value in each.mean(1)), f"| {better} |", flush=True)


if __name__ == "__main__":
    main()
