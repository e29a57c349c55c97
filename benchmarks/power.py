"""Whether an effect of the size that a diagnosis says it would have found is found, and one of half the size.

    python benchmarks/power.py --simulator mujoco --seeds 8 --out power.json

For each seed a set without an effect is diagnosed first; `detectable` in its diagnosis.json gives the least size of
each effect that would have been found with a probability of 95 %. Sets of the same seed with effects of that
size, and of half of it, follow. Found is every verdict but `none`. Goes on where it was interrupted.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from physid.data import RecordingSet
from physid.data.files import write_text
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.diagnosis.diagnose import diagnose

EFFECTS = {
    "viscous_drag": "coefficient",
    "friction_gradient": "x",
    "force_lag": "time_constant",
    "tether": "stiffness",
    "anisotropic_friction": "along",
}
FACTORS = (1.0, 0.5)
FRAMES = {"pybullet": {}, "mujoco": {"frame_rate": 60.0, "steps": 60}}
"""MuJoCo records at a rate that users have, over as many seconds as PyBullet at 240 frames a second over 240."""
SETUP: dict[str, Any] = {
    "scene": "push",
    "protocol": "rich",
    "trajectories": 10,
    "steps": 240,
    "video": False,
    "split": {"fit": 6, "select": 1, "report_same": 3},
    "unknown": ("block.friction",),
    "guess_factor": 1.3,
    "noise": {"position": 0.0005, "rotation": 0.002},
}


def judged(simulator: str, seed: int, effects: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """Generate a set, diagnose it, and return the verdict and the sizes that would have been found."""
    from physid.data.generation.settings import Noise

    setup = SETUP | FRAMES[simulator] | {"noise": Noise(**SETUP["noise"])}
    config = GenerateConfig(**setup, simulator=simulator, seed=seed, effects=effects)
    with tempfile.TemporaryDirectory() as folder:
        generate(config, Path(folder) / "set", 1, quiet=True)
        document = diagnose(RecordingSet(Path(folder) / "set"), Path(folder) / "out")
    sizes = {one.effect: one.size for one in document.detectable if EFFECTS.get(one.effect) == one.parameter}
    return {"verdict": document.verdict, "group": list(document.group), "sizes": sizes}


def main() -> None:
    """Run what is missing, and print how many were found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--simulator", choices=tuple(FRAMES), default="mujoco")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--first", type=int, default=300, help="first seed")
    parser.add_argument("--out", type=Path, default=Path("power.json"))
    options = parser.parse_args()
    done: dict[str, Any] = json.loads(options.out.read_text()) if options.out.exists() else {}

    def run(key: str, seed: int, effects: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
        if key not in done:
            done[key] = judged(options.simulator, seed, effects)
            write_text(options.out, json.dumps(done, indent=1))
            print(key, done[key]["verdict"], *done[key]["group"], flush=True)
        found: dict[str, Any] = done[key]
        return found

    for seed in range(options.first, options.first + options.seeds):
        free = run(f"{seed} free", seed, {})
        for name, parameter in EFFECTS.items():
            size = free["sizes"].get(name)
            for factor in FACTORS if size else ():
                run(f"{seed} {name} {factor:g}", seed, {name: {parameter: factor * size}})
    for kind in ("free", *(f"{factor:g}" for factor in FACTORS)):
        verdicts = [one["verdict"] for key, one in done.items() if key.split()[-1] == kind]
        found = sum(verdict != "none" for verdict in verdicts)
        print(f"{kind:>5}: {found} of {len(verdicts)} found")


if __name__ == "__main__":
    main()
