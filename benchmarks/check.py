"""How often the rules of `physid check` raise a false alarm, and how often they find a clock or a unit that is off.

    python benchmarks/check.py                 48 sets: four protocols, two simulators, three rates, two seeds
    python benchmarks/check.py --seeds 1 --rates 60
    python benchmarks/check.py --folder runs/check           keeps the sets for the next run

The sets have ten trajectories of 1.25 s, 0.5 mm and 4 mrad of noise, and exact clocks; forces are shifted, and units
changed, after that, or frames left out. An alarm is a finding that says "wrong?"; a shift is found where the clocks are
said to differ, a unit where it is named, missing frames where the set is said to lack some.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from tqdm import tqdm

from physid.data import RecordingSet
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig, Noise
from physid.inspection.evidence import Evidence
from physid.inspection.examination import read_posed
from physid.inspection.mistakes import oddities_in
from physid.inspection.rules.clocks import delay, dropped

CASES = (("push", "paper"), ("push", "rich"), ("slide", "rich"), ("collide", "rich"))
SIMULATORS = ("pybullet", "mujoco")
UNKNOWN = {"collide": ("block.mass", "block.friction")}
LOST = 0.05  # share of the frames
SHIFTS = (15, 18, 20, 23, 30, 50)  # [ms]
UNITS = {
    "mm": (1e3, 1.0, ("millimetres",)),
    "cm": (1e2, 1.0, ("centimetres",)),
    "inches": (1 / 0.0254, 1.0, ("inches",)),
    "mN": (1.0, 1e3, ("in mN",)),
    "cm and mN": (1e2, 1e3, ("centimetres", "in mN")),
    "mm and mN": (1e3, 1e3, ("millimetres", "in mN")),
}
"""By name: factors of positions and of forces, and what a finding has to say."""


def recorded(folder: Path, rates: Sequence[float], seeds: int) -> Iterator[tuple[str, Evidence]]:
    """Generate the sets, or take those that are there; yields name and what the rules look at."""
    cases = [*product(CASES, SIMULATORS, rates, range(seeds))]
    for (scene, protocol), simulator, rate, seed in tqdm(cases, desc="sets", leave=False):
        name = f"{scene}_{protocol}_{simulator}_{rate:g}_{seed}"
        config = GenerateConfig(
            scene, protocol=protocol, simulator=simulator, frame_rate=rate, steps=int(1.25 * rate), trajectories=10,
            video=False, noise=Noise(0.0005, 0.004), seed=seed, unknown=UNKNOWN.get(scene, ("block.friction",)),
            split={"train": 1},
        )  # fmt: skip
        generate(config, folder / name, 1, quiet=True)
        recordings = RecordingSet(folder / name)
        seen, _ = read_posed(recordings, range(len(recordings)))
        assert seen is not None
        yield name, seen


def shifted(seen: Evidence, shift: float) -> Evidence:
    """Return recordings whose forces bear stamps that are so much later [s]."""
    step = seen.scene.time_step
    moved = [replace(one, wrench_time=one.wrench_stamps(step) + shift) for one in seen.recordings]
    return replace(seen, recordings=moved)


def in_units(seen: Evidence, length: float, force: float) -> Evidence:
    """Return recordings whose positions and forces are multiplied."""
    scaled = seen.scaled(length)
    forced = [one if one.wrench is None else replace(one, wrench=force * one.wrench) for one in scaled.recordings]
    return replace(scaled, recordings=forced)


def thinned(seen: Evidence) -> Evidence:
    """Return recordings without some of their frames, and the forces with them, as a log without stamps loses them."""
    kept = []
    for index, one in zip(seen.indices, seen.recordings, strict=True):
        keep = np.random.default_rng(index).random(one.length) > LOST
        assert one.pose is not None
        wrench = None if one.wrench is None else one.wrench[keep]
        kept.append(replace(one, pose=one.pose[keep], wrench=wrench, twist=None))
    return replace(seen, recordings=kept)


def wrong(seen: Evidence) -> list[str]:
    """Return what looks wrong."""
    return [one.what for one in oddities_in(seen) if one.wrong]


def main() -> None:
    """Print false alarms, shifts that are found and units that are named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rates", default="30,60,240", help="frames per second, with commas between them")
    parser.add_argument("--seeds", type=int, default=2, help="of each case")
    parser.add_argument("--folder", type=Path, help="where the sets are kept; nowhere by default")
    options = parser.parse_args()
    rates, sets, found, named = [float(rate) for rate in options.rates.split(",")], 0, Counter[int](), Counter[str]()
    alarms, lost = list[str](), 0
    with tempfile.TemporaryDirectory() as nowhere:
        for name, seen in recorded(options.folder or Path(nowhere), rates, options.seeds):
            sets += 1
            alarms += [f"{name}: {what}" for what in wrong(seen)]
            for shift, sign in product(SHIFTS, (1, -1)):
                found[shift] += delay(shifted(seen, sign * shift / 1000)) is not None
            lost += dropped(thinned(seen)) is not None
            for unit, (length, force, words) in UNITS.items():
                said = wrong(in_units(seen, length, force))
                named[unit] += all(any(word in what for what in said) for word in words)
    print(f"{sets} sets, {len(alarms)} false alarms", *alarms, sep="\n")
    print(f"\n{lost} of {sets} sets without {LOST:.0%} of their frames are said to lack some")
    print("\n| forces late or early by | found |\n|---|---:|")
    print(*(f"| {shift} ms | {found[shift]} of {2 * sets} |" for shift in SHIFTS), sep="\n")
    print("\n| unit | named |\n|---|---:|")
    print(*(f"| {unit} | {named[unit]} of {sets} |" for unit in UNITS), sep="\n")


if __name__ == "__main__":
    main()
