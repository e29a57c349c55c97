"""How often the 90 % intervals of system identification hold the truth, over synthetic recording sets with noise.

    python benchmarks/coverage.py                  100 sets per case
    python benchmarks/coverage.py --sets 10 --cases push_friction

Each set has its own seed, forces, starts and noise (1 mm and 10 mrad on every pose, no velocities). First guesses are
twice the truth, initial states are fitted. "covered" is the share of the intervals that hold the truth, with Wilson's
95 % interval; "error / half width" is the median.
"""

from __future__ import annotations

import argparse
import logging
import math
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import lightning as L
from tqdm import tqdm

from physid.data.datamodule import RecordingsDataModule
from physid.data.generate import generate
from physid.data.generation import GenerateConfig, Noise
from physid.training.learners.sysid import SysID

NOISE = Noise(position=1e-3, rotation=1e-2)
EPOCHS = 15


@dataclass(frozen=True)
class Case:
    """What is identified.

    Attributes:
        scene: The scene.
        protocol: How it is excited.
        learn: The parameters.
        trajectories: How many of a set.
        steps: Frames of each.
    """

    scene: str
    protocol: str
    learn: tuple[str, ...]
    trajectories: int = 10
    steps: int = 100


CASES = {
    "push_friction": Case("push", "paper", ("block.friction",)),
    "push_both": Case("push", "paper", ("block.mass", "block.friction")),
    "push_rich_both": Case("push", "rich", ("block.mass", "block.friction")),
    "slide_rich_friction": Case("slide", "rich", ("block.friction",)),
}


def identify(case: Case, seed: int) -> dict[str, tuple[float, float, float, float]]:
    """Generate a set and identify it; returns truth, estimate and interval of each parameter."""
    common = {"trajectories": case.trajectories, "steps": case.steps, "split": {"train": 1}, "noise": NOISE}
    config = GenerateConfig(case.scene, case.protocol, seed=seed, video=False, unknown=case.learn, **common)
    true = config.true_parameters()
    with tempfile.TemporaryDirectory() as folder:
        generate(config, folder, quiet=True)
        quiet = {"logger": False, "enable_progress_bar": False, "enable_model_summary": False}
        trainer = L.Trainer(
            max_epochs=EPOCHS, accelerator="cpu", default_root_dir=folder, enable_checkpointing=False, **quiet
        )
        module = SysID()
        trainer.fit(module, RecordingsDataModule(Path(folder), shuffle=False))
    found = {}
    for name, value in module.physical.estimates().items():
        low, high = (float(trainer.callback_metrics.get(f"params/{name}/{end}", math.nan)) for end in ("low", "high"))
        found[name] = (true[name], value, low, high)
    return found


def wilson(impacts: int, count: int, quantile: float = 1.96) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a share (1927)."""
    share, square = impacts / count, quantile**2 / count
    middle = (share + square / 2) / (1 + square)
    half = quantile * math.sqrt(share * (1 - share) / count + square / (4 * count)) / (1 + square)
    return middle - half, middle + half


def main() -> None:
    """Print one line per case and parameter."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    options = parser.parse_args()
    warnings.filterwarnings("ignore")
    logging.getLogger("lightning.pytorch").setLevel(logging.ERROR)
    logging.getLogger("physid").setLevel(logging.ERROR)
    print("| case | parameter | sets | covered | Wilson | width | error / half width |")
    print("|---|---|---:|---:|---|---:|---:|")
    for name in options.cases:
        runs = [identify(CASES[name], seed) for seed in tqdm(range(options.sets), desc=name)]
        for parameter in CASES[name].learn:
            rows = [run[parameter] for run in runs]
            impacts = sum(low <= true <= high for true, _, low, high in rows)
            low, high = wilson(impacts, len(rows))
            width = median((high - low) / true for true, _, low, high in rows)
            ratio = median(abs(value - true) / ((high - low) / 2) for true, value, low, high in rows)
            shown = f"{impacts / len(rows):.1%} | {low:.1%} to {high:.1%} | {width:.2%} | {ratio:.2f}"
            print(f"| {name} | {parameter} | {len(rows)} | {shown} |", flush=True)


if __name__ == "__main__":
    main()
