"""Diagnoses of single recording sets by simulators that the model does not imitate, as one table.

    python benchmarks/elsewhere.py --out runs/elsewhere
    python benchmarks/elsewhere.py --out runs/elsewhere --only toss

Each row is two commands, `physid generate` with the words in WORDS and CASES and `physid diagnose`; what is there
already is not made again. The time is that of the processor.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
from pathlib import Path

import yaml

from physid.data.files import write_text
from physid.diagnosis.document.document import FILE, Diagnosis, Estimate, read_diagnosis

WORDS = (
    "simulator=mujoco", "frame_rate=60", "trajectories=16", "steps=150", "video=false",
    "noise.position=0.0006", "noise.rotation=0.004", "unknown=[block.friction]",
    "split={fit: 8, select: 3, report_same: 5}",
)  # fmt: skip
"""Of all sets; those of a case come after them and count more."""
LATE, DRAG = "effects.observation_latency.latency", "effects.viscous_drag.coefficient"
CASES: dict[str, tuple[str, ...]] = {
    "push, nothing": ("push_rich",),
    "toss, nothing": ("toss_rich", "steps=90"),
    "collide, nothing": ("collide_rich",),
    "slide, nothing": ("slide", "steps=75"),
    "push, drag of 0.6 N s/m": ("push_rich", f"{DRAG}=0.6"),
    "push, friction gradient of 0.3 1/m": ("push_rich", "effects.friction_gradient.x=0.3"),
    "push, latency of 20 ms": ("push_rich", f"{LATE}=0.02"),
    "push, force delay of 20 ms": ("push_rich", "effects.force_delay.delay=0.02"),
    "toss at 30 Hz, jitter 20 %, latency of 40 ms": (
        "toss_rich", "frame_rate=30", "steps=45", "jitter=0.2", f"{LATE}=0.04",
    ),
    "push, drag, friction gradient and late forces at once": (
        "push_rich", f"{DRAG}=0.6", "effects.friction_gradient.x=0.3", "effects.force_delay.delay=0.02",
    ),
    "toss, quadratic drag of 0.3 kg/m, length scale of 3 % and centre of mass off by 10 mm at once": (
        "toss_rich", "steps=90", "effects.quadratic_drag.coefficient=0.3", "effects.length_scale.change=0.03",
        "effects.com_offset.x=0.01",
    ),
    "push by PyBullet at 60 Hz, as recording.yaml says, latency of 20 ms": (
        "push_rich", "simulator=pybullet", f"{LATE}=0.02",
    ),
}  # fmt: skip
"""Configurations of configs/generate, and what differs."""


def diagnosed(name: str, words: tuple[str, ...], out: Path) -> tuple[Diagnosis, float, float]:
    """Make a set and diagnose it, unless that is done; return the diagnosis, its time [s], and the true friction."""
    folder = out / "".join(letter if letter.isalnum() else "_" for letter in name)
    recordings, answer, spent = folder / "set", folder / "diagnosis", folder / "seconds.json"
    if not spent.exists():
        config, *changes = words
        _physid("generate", "--config", f"configs/generate/{config}.yaml", "--out", recordings, *WORDS, *changes)
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        _physid("diagnose", recordings, "--out", answer)
        write_text(spent, json.dumps(resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before))
    true = yaml.safe_load((recordings / "truth.yaml").read_text())["parameters"]["block.friction"]
    return read_diagnosis(answer / FILE), float(json.loads(spent.read_text())), float(true)


def _physid(*words: object) -> None:
    subprocess.run([sys.executable, "-m", "physid", *map(str, words)], check=True, stdout=sys.stderr)


def row(name: str, found: Diagnosis, seconds: float, true: float) -> str:
    """Return a row of the table; `true` is the friction that made the recordings."""
    causes = ", ".join(found.group if found.verdict == "group" else found.blamed)
    sizes = "; ".join(f"{key} {_interval(one)}" for effect in found.effects for key, one in effect.parameters.items())
    friction = found.parameters["block.friction"]
    fitted = _interval(friction.with_effect) if friction.with_effect else f"{friction.nominal:.5g}"
    gap, after = found.gap, found.gap.same.after
    error = f"{1e3 * gap.same.before:.3g}" + ("" if after is None else f" -> {1e3 * after:.3g}")
    verdict = f"`{found.verdict}`" + (f": {causes}" if causes else "")
    cells = (name, verdict, sizes or "-", f"{fitted}; {true:g}", f"{error} ({1e3 * gap.floor:.3g})", f"{seconds:.0f}")
    return f"| {' | '.join(cells)} |"


def _interval(one: Estimate) -> str:
    return f"{one.value:.4g} ({one.low:.4g} to {one.high:.4g}) {one.unit}".rstrip(" -")


def main() -> None:
    """Diagnose what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/elsewhere"))
    parser.add_argument("--only", default="", help="cases whose name has this in it")
    options = parser.parse_args()
    print("| recordings | verdict | size (90 %) | friction; true | error before -> after (floor) [mm] | time [s] |")
    print("|---|---|---|---|---|---:|")
    for name, words in CASES.items():
        if options.only in name:
            found, seconds, true = diagnosed(name, words, options.out)
            print(row(name, found, seconds, true), flush=True)


if __name__ == "__main__":
    main()
