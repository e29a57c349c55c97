"""How often the 90 % intervals of system identification hold the truth, over synthetic recording sets with noise.

    python benchmarks/coverage.py                  100 sets per case
    python benchmarks/coverage.py --sets 10 --cases push_friction
    timeout -s INT 800 python benchmarks/coverage.py ...        as many as there is time for, case by case
    python benchmarks/coverage.py --simulator closed_form --rates 30,60,100,148,240 --jitter 0.2 --missing 0.1
    python benchmarks/coverage.py --simulator mujoco --rates 60 --glitches 0.02 --glitch 8
    python benchmarks/coverage.py --simulator mujoco --rates 60 --noise 0.5 --alike 0.05

Each set has its own seed, forces, starts and noise (1 mm and 10 mrad on every pose unless --noise says otherwise, no
velocities). First guesses are twice the truth, initial states are fitted. "covered" is the share of the intervals that
hold the truth, with Wilson's 95 % interval; "error / half width" is the median; "bias / s.e." the mean error by the
standard error, with the standard error of that mean; "worst" the largest error in a set. With rates, trajectories last
as long as at 240 Hz, and forces change at the rate of --force-rate, another one than that of the poses. With glitches,
that share of the poses is moved by as many millimetres (standard deviation of each coordinate), as trackers do. The
noise is white unless --alike says for how many seconds it is alike: its correlation then falls as exp(-time / alike).
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import math
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, median, stdev
from typing import Any

import h5py
import lightning as L
import numpy as np
import torch
from scipy.signal import lfilter
from tqdm import tqdm

from physid.benchmark.scoring.intervals import wilson
from physid.data import RecordingSet
from physid.data.batches.datamodule import RecordingsDataModule
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig, Noise
from physid.estimation.least_squares.covariance import CONFIDENCE, quantile
from physid.estimation.measurement import moved
from physid.training.callbacks.converged import Converged
from physid.training.learners.sysid import SysID

EPOCHS = 30


@dataclass(frozen=True)
class Case:
    """What is identified.

    Attributes:
        scene: The scene.
        protocol: How it is excited.
        learn: The parameters.
        trajectories: How many of a set.
        steps: Frames of each, at 240 Hz.
        closed: Whether there is a closed form.
        true_values: True values that differ from the scene's.
    """

    scene: str
    protocol: str
    learn: tuple[str, ...]
    trajectories: int = 10
    steps: int = 100
    closed: bool = False
    true_values: tuple[tuple[str, float], ...] = ()


CASES = {
    "push_friction": Case("push", "paper", ("block.friction",)),
    "push_both": Case("push", "paper", ("block.mass", "block.friction")),
    "push_rich_both": Case("push", "rich", ("block.mass", "block.friction")),
    "slide_rich_friction": Case("slide", "rich", ("block.friction",)),
    "toss_rich": Case("toss", "rich", ("block.friction", "block.restitution"), trajectories=16, steps=192),
    "push_straight": Case("push", "straight", ("block.mass", "block.friction"), steps=300, closed=True),
    "slide_straight": Case("slide", "straight", ("block.friction",), steps=300, closed=True),
    "toss_straight": Case("toss", "straight", ("block.friction", "block.restitution"), steps=200, closed=True),
    "collide_straight": Case("collide", "straight", ("block.mass", "block.friction"), steps=200, closed=True),
}


def move_some(folder: Path, share: float, size: float, seed: int) -> None:
    """Move a share of the poses of a set, by normal shifts of a standard deviation [m]."""
    random = np.random.default_rng(seed)
    for path in sorted((folder / "trajectories").glob("*.h5")):
        with h5py.File(path, "r+") as file:
            poses = file["pose"]
            moved = random.random(poses.shape[:2]) < share
            poses[..., :3] += moved[..., None] * random.normal(0, size, (*poses.shape[:2], 3))


def add_alike(folder: Path, noise: Noise, alike: float, seed: int) -> None:
    """Add noise whose correlation falls as exp(-time / alike) [s] to the poses of a set that has none."""
    random = np.random.default_rng(seed)
    size, kept = (
        np.array([noise.rotation] * 3 + [noise.position] * 3),
        math.exp(-RecordingSet(folder).scene.time_step / alike),
    )
    for path in sorted((folder / "trajectories").glob("*.h5")):
        with h5py.File(path, "r+") as file:
            poses = file["pose"][...]
            drive = random.standard_normal((*poses.shape[:2], 6)) * math.sqrt(1 - kept**2)
            drive[0] /= math.sqrt(1 - kept**2)
            change = size * lfilter([1.0], [1.0, -kept], drive, axis=0)
            del file["twist"]  # exact velocities, that no tracker knows
            file["pose"][...] = moved(torch.from_numpy(poses).double(), torch.from_numpy(change)).numpy()


def identify(
    case: Case, seed: int, made: dict[str, Any], noise: Noise, glitches: tuple[float, float], alike: float
) -> dict[str, tuple[float, float, float, float]]:
    """Generate a set and identify it; returns truth, estimate and interval of each parameter.

    Glitches are the share of the poses that are moved, and by how much [m]; noise is alike for so long [s].
    """
    rate = made.get("frame_rate")
    steps = case.steps if rate is None else max(20, round(case.steps * rate / 240))
    common = {
        "trajectories": case.trajectories,
        "steps": steps,
        "split": {"train": 1},
        "noise": noise if not alike else Noise(),
    }
    common |= {"true_values": dict(case.true_values), **made}
    config = GenerateConfig(case.scene, protocol=case.protocol, seed=seed, video=False, unknown=case.learn, **common)
    true = config.true_parameters()
    with tempfile.TemporaryDirectory() as folder:
        generate(config, folder, quiet=True)
        if alike:
            add_alike(Path(folder), noise, alike, seed)
        if glitches[0] > 0:
            move_some(Path(folder), *glitches, seed)
        quiet = {"logger": False, "enable_progress_bar": False, "enable_model_summary": False}
        trainer = L.Trainer(
            max_epochs=EPOCHS, accelerator="cpu", default_root_dir=folder, enable_checkpointing=False,
            callbacks=[Converged()], **quiet,
        )  # fmt: skip
        module = SysID()
        module.print = lambda *_, **__: None  # type: ignore[method-assign]
        trainer.fit(module, RecordingsDataModule(Path(folder), shuffle=False))
    found = {}
    for name, value in module.physical.estimates().items():
        low, high = (float(trainer.callback_metrics.get(f"params/{name}/{end}", math.nan)) for end in ("low", "high"))
        found[name] = (true[name], value, low, high)
    return found


def row(runs: list[tuple[float, float, float, float]], first: int) -> str:
    """Return the figures of a parameter, from truth, estimate and interval in each set; seeds begin at `first`."""
    hits = sum(low <= true <= high for true, _, low, high in runs)
    low, high = wilson(hits, len(runs))
    width = median((high - low) / true for true, _, low, high in runs)
    ratio = median(abs(value - true) / ((high - low) / 2) for true, value, low, high in runs)
    within = quantile(CONFIDENCE)
    errors = [math.log(value / true) / (math.log(high / low) / 2 / within) for true, value, low, high in runs]
    bias, spread = mean(errors), stdev(errors) / math.sqrt(len(errors)) if len(errors) > 1 else math.nan
    shown = f"{hits / len(runs):.1%} | {low:.1%} to {high:.1%} | {width:.2%} | {ratio:.2f}"
    worst = max(range(len(errors)), key=lambda k: abs(errors[k]))
    return f"{len(runs)} | {shown} | {bias:+.2f} +- {spread:.2f} | {errors[worst]:+.1f} (seed {first + worst})"


def main() -> None:
    """Print one line per case, rate and parameter."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="seed of the first set")
    parser.add_argument("--cases", nargs="+", choices=CASES)
    parser.add_argument("--simulator", default="pybullet")
    parser.add_argument("--rates", default="", help="frames per second, with commas between them")
    parser.add_argument("--force-rate", type=float, help="rows of forces per second; that of the poses by default")
    parser.add_argument("--jitter", type=float, default=0.0)
    parser.add_argument("--missing", type=float, default=0.0)
    parser.add_argument("--noise", type=float, default=1.0, help="[mm], and ten times as many mrad")
    parser.add_argument("--glitches", type=float, default=0.0, help="share of the poses that are moved")
    parser.add_argument("--glitch", type=float, default=8.0, help="by so many mm")
    parser.add_argument("--alike", type=float, default=0.0, help="[s] for which the noise is alike; white without")
    options = parser.parse_args()
    warnings.filterwarnings("ignore")
    for name in ("lightning.pytorch", "physid"):
        logging.getLogger(name).setLevel(logging.ERROR)
    closed = options.simulator == "closed_form"
    chosen = options.cases or [name for name, case in CASES.items() if case.closed == closed]
    noise = Noise(position=1e-3 * options.noise, rotation=1e-2 * options.noise)
    glitches = options.glitches, 1e-3 * options.glitch
    print("| case | rate | parameter | sets | covered | Wilson | width | error / half width | bias / s.e. | worst |")
    print("|---|---:|---|---:|---:|---|---:|---:|---:|---:|")
    for name in chosen:
        for rate in options.rates.split(",") if options.rates else [""]:
            made: dict[str, Any] = {"simulator": options.simulator, "frame_rate": float(rate) if rate else None}
            made |= {"jitter": options.jitter, "missing": options.missing, "force_rate": options.force_rate}
            runs: list[dict[str, tuple[float, float, float, float]]] = []
            with contextlib.suppress(KeyboardInterrupt, SystemExit):  # as Lightning ends; what was measured counts
                for seed in tqdm(range(options.first, options.first + options.sets), desc=f"{name} {rate}"):
                    runs.append(identify(CASES[name], seed, made, noise, glitches, options.alike))
            if not runs:
                continue
            for parameter in CASES[name].learn:
                shown = row([run[parameter] for run in runs], options.first)
                print(f"| {name} | {rate or 240} | {parameter} | {shown} |", flush=True)


if __name__ == "__main__":
    main()
