"""How a diagnosis does on recordings that the model's own world did not make, with and without an effect.

    python benchmarks/any_world.py --sets 24 --workers 2

Sets of pushes, slides and tosses are simulated by MuJoCo with fine steps, at 30, 60 and 120 frames a second with noise,
every third with jittered stamps and lost frames. Half of them have no effect: any verdict but `none` is a false alarm.
The others have one of the catalogue at twice its typical size. recording.yaml does not say who made them. Exact: the
effect alone is named. In the right group: it is among those that cannot be distinguished. Blames another: something is
named that is not there.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import yaml

from physid.data.format import RecordingSet
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.diagnosis.diagnose import diagnose
from physid.effects import find

SCENES = {"push": 1.6, "slide": 1.2, "toss": 0.9}
"""Seconds of a trajectory."""
RATES = (30.0, 60.0, 120.0)
EFFECTS = (
    "viscous_drag", "friction_gradient", "force_gain", "force_delay", "observation_latency", "camera_yaw",
    "ground_tilt", "constant_force", "force_misalignment", "gravity_error",
)  # fmt: skip
"""Those that show in the motion of a single body."""
WITHOUT_FORCES = {"force_gain", "force_delay", "force_misalignment"}
SIZE = 2.0  # times the typical size
SPLIT = {"fit": 6, "select": 2, "report_same": 4}


def draw(number: int, seed: int) -> dict[str, Any]:
    """Draw a set: every second one has an effect."""
    random = np.random.default_rng([seed, number])
    scene = list(SCENES)[number // 2 % len(SCENES)]
    rate = RATES[number // 6 % len(RATES)]
    drawn: dict[str, Any] = {
        "scene": scene, "protocol": "rich", "simulator": "mujoco", "frame_rate": rate, "video": False,
        "trajectories": sum(SPLIT.values()), "steps": round(SCENES[scene] * rate), "split": SPLIT,
        "seed": int(random.integers(2**31)),
        "unknown": ["block.friction"], "noise": {"position": 0.0004, "rotation": 0.003},
    }  # fmt: skip
    if number % 3 == 2:
        drawn |= {"jitter": 0.2, "missing": 0.1}
    if number % 2:
        known = [name for name in EFFECTS if scene == "push" or name not in WITHOUT_FORCES]
        name = known[int(random.integers(len(known)))]
        sizes = {key: SIZE * (each.typical - each.null) + each.null for key, each in find(name).quantities().items()}
        drawn["effects"] = {name: sizes}
    return drawn


def judge(number: int, seed: int) -> dict[str, Any]:
    """Make a set, diagnose it, and say what came of it."""
    drawn = draw(number, seed)
    hidden = next(iter(drawn.get("effects", {})), None)
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work) / "set"
        generate(
            GenerateConfig.from_mapping(drawn | {"truth_file": str(Path(work) / "truth.yaml")}), folder, quiet=True
        )
        content = yaml.safe_load((folder / "recording.yaml").read_text())
        content["source"] = "somewhere"
        content.pop("integration", None)
        (folder / "recording.yaml").write_text(yaml.safe_dump(content))
        found = diagnose(RecordingSet(folder), Path(work) / "out")
    named = list(found.blamed)
    row = {"number": number, "scene": drawn["scene"], "rate": drawn["frame_rate"], "hidden": hidden}
    row |= {"jitter": "jitter" in drawn, "verdict": found.verdict, "named": named, "group": list(found.group)}
    print(json.dumps(row), flush=True)
    return row


def main() -> None:
    """Judge so many sets and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--sets", type=int, default=24, help="half of them without an effect")
    parser.add_argument("--first", type=int, default=0, help="number of the first set")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.sets)
    rows = joblib.Parallel(n_jobs=options.workers)(joblib.delayed(judge)(number, options.seed) for number in numbers)
    free, hidden = ([row for row in rows if (row["hidden"] is None) is none] for none in (True, False))
    exact = sum(row["named"] == [row["hidden"]] and row["verdict"] == "named" for row in hidden)
    grouped = sum(row["hidden"] in row["group"] for row in hidden)
    beside = sum(bool(set(row["named"]) - set(row["group"] if row["hidden"] in row["group"] else [])) for row in hidden)
    print(f"\nwithout an effect: {sum(row['verdict'] == 'none' for row in free)} of {len(free)} `none`")
    print(f"with one effect: {exact} exact, {grouped} in the right group, {beside} blame another, of {len(hidden)}")


if __name__ == "__main__":
    main()
