"""Whether two states of the code agree to the last bit: verdicts, estimates and intervals of fixed recordings.

    python benchmarks/equal_verdicts.py --out before.json          with the code of before (PYTHONPATH=OTHER/src)
    python benchmarks/equal_verdicts.py --out after.json --against before.json

Recordings are made, fitted and diagnosed through the command line alone, so that the script does not care where things
stand in the source. Each number is compared as written, with all its digits; paths and times are left out, and what
only the code of after says is counted apart. Both runs
need the same machine, and one thread (other processors add in another order). About six minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

CONFIGS = Path(__file__).resolve().parent.parent / "configs"
SIZE = ("trajectories=10", "steps=80", "video=false", "noise.position=0.0003", "noise.rotation=0.003")
SPLIT = "split={fit: 5, select: 2, report_same: 3}"
DIAGNOSED = {
    "push_none": ("push", "unknown=[block.friction]"),
    "push_drag": ("push", "unknown=[block.friction]", "effects.viscous_drag.coefficient=0.6"),
    "slide_tilt": ("slide", "unknown=[block.friction]", "effects.friction_gradient.x=0.4"),
    "toss_lens": ("toss", "effects.camera_yaw.angle=0.05"),
    "collide_delay": ("collide", "effects.force_gain.gain=0.1"),
}
FITTED = {"push_friction": "push", "slide_friction": "slide", "collide_both": "collide"}
FILMED = ("supervised/push_friction_quick", "self_supervised/push_friction_quick")
SHORT = ("trainer.max_epochs=3", "model.phases.warm_up=1", "model.phases.refine=1")
TIMES = ("seconds", "time", "duration", "rate", "per_second")


def physid(*words: object) -> None:
    """Run a command of physid; its output goes to the terminal only if it fails."""
    command = [sys.executable, "-c", "import sys; from physid.cli import main; sys.exit(main())", *map(str, words)]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "WANDB_MODE": "offline"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, words))}\n{done.stdout}{done.stderr}")


def numbers(value: Any, place: str = "") -> dict[str, str]:
    """List what a document says by its place, every digit of it; times and paths are left out."""
    if isinstance(value, dict):
        return {k: v for key, each in value.items() for k, v in numbers(each, f"{place}/{key}").items()}
    if isinstance(value, list):
        return {k: v for index, each in enumerate(value) for k, v in numbers(each, f"{place}/{index}").items()}
    last = place.rsplit("/", 1)[-1]
    if any(word in last for word in TIMES) or (isinstance(value, str) and "/" in value):
        return {}
    return {place: repr(value)}


def collect(work: Path) -> dict[str, str]:
    """Make the recordings, fit and diagnose them, and list what was found."""
    found: dict[str, str] = {}
    for name, (scene, *rest) in DIAGNOSED.items():
        config = CONFIGS / "generate" / f"{scene}_rich.yaml"
        physid("generate", "--config", config, "--out", work / name, "--quiet", *SIZE, SPLIT, *rest)
        physid("diagnose", work / name, "--out", work / f"{name}.out", "--quiet")
        found |= numbers(json.loads((work / f"{name}.out" / "diagnosis.json").read_text()), name)
        print(f"{name}: {found[f'{name}/verdict']}", flush=True)
    for name, scene in FITTED.items():
        config = CONFIGS / "generate" / f"{scene}.yaml"
        physid("generate", "--config", config, "--out", work / f"{name}.set", "--quiet", *SIZE)
        run = work / f"{name}.run"
        data = f"data.folder={work / name}.set"
        physid("fit", "--config", CONFIGS / "sysid" / f"{name}.yaml", "--run-dir", run, data)
        found |= numbers(json.loads((run / "metrics.json").read_text()), f"sysid/{name}")
        print(f"sysid/{name}: {len(found)} values", flush=True)
    films = work / "films"
    config = CONFIGS / "generate" / "push.yaml"
    physid("generate", "--config", config, "--out", films, "--quiet", "trajectories=8", "steps=91")
    for name in FILMED:
        run = work / f"{name.replace('/', '_')}.run"
        physid("fit", "--config", CONFIGS / f"{name}.yaml", "--run-dir", run, f"data.folder={films}", *SHORT)
        found |= numbers(json.loads((run / "metrics.json").read_text()), name)
        print(f"{name}: {len(found)} values", flush=True)
    return found


def main() -> None:
    """Collect, write, and compare where there is something to compare with."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="where the values are written")
    parser.add_argument("--against", type=Path, help="values of another state of the code")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        found = collect(Path(work))
    options.out.write_text(json.dumps(found, indent=1))
    if options.against is None:
        return
    before: dict[str, str] = json.loads(options.against.read_text())
    different = [place for place, value in sorted(before.items()) if value != found.get(place)]
    for place in different[:20]:
        print(f"{place}: {before[place]} -> {found.get(place)}")
    print(f"{len(before)} values, {len(different)} differ; {len(found.keys() - before.keys())} are said beside them")
    sys.exit(bool(different))


if __name__ == "__main__":
    main()
