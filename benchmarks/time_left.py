"""How honest progress is: what commands say of the time left, against the time that it then took.

    python benchmarks/time_left.py                              generate, track, benchmark, fit, diagnose
    python benchmarks/time_left.py --commands diagnose,fit

Each command runs with one worker, and its bar on a clock of its own: the time that this process has on a processor, so
that what else the machine does plays no part. Whenever a bar is drawn anew and a fifth of the time has passed, what it
promises is compared: the promised whole (time gone, and left) against the true whole. A diagnosis promises by its
percentage. A fit promises the time of all its epochs, at most: it is compared where it takes them all.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import faults

ROOT = Path(__file__).resolve().parents[1]
CONFIGS = ROOT / "configs"
FROM, TO = 0.2, 0.95
"""Of the time; before it, hardly anything is known, and after it nothing is left."""
WANTED = 0.3
SHORTEST = 0.8
"""[s] of what is worth a promise."""
Promise = tuple[float, float]
"""Time [s], and what is promised of the whole [s]."""


@contextlib.contextmanager
def watched() -> Iterator[list[Promise]]:
    """Record what every bar of tqdm promises, on the clock of the processor."""
    import tqdm

    from physid.training.callbacks import progress

    Progress = progress.Progress
    usual, promised, left = tqdm.tqdm, list[Promise](), Progress.left
    start = time.process_time()

    def noted(self: Any, trainer: Any) -> float | None:
        value = left(self, trainer)
        if value is not None:
            promised.append((now := time.process_time() - start, now + value))
        return value

    class Watched(usual):  # type: ignore[misc, valid-type]
        def __init__(self, *words: Any, **options: Any) -> None:
            hidden = bool(options.get("disable"))  # --quiet, as for what a command calls itself
            super().__init__(*words, **{**options, "disable": hidden, "file": io.StringIO(), "mininterval": 0})
            if hidden:
                return
            self._time = time.process_time
            self.start_t = self.last_print_t = start

        def display(self, *_: Any, **__: Any) -> bool:
            now, shown = time.process_time() - start, self.format_dict
            if self.n and self.total:
                rate = shown["rate"] if shown["rate"] and self.total != 100 else self.n / now
                promised.append((now, now + (self.total - self.n) / rate))
            return True

    tqdm.tqdm, Progress.left, progress.clock = Watched, noted, time.process_time
    try:
        yield promised
    finally:
        tqdm.tqdm, Progress.left, progress.clock = usual, left, time.monotonic


def commands(place: Path) -> dict[str, list[str]]:
    """Return the words of each command that is tried; what they read is made by those before them."""
    generate, small = ["generate", "--workers=1", "--config"], ["steps=240", "video=false"]
    noisy = ["noise.position=0.0005", "noise.rotation=0.002", *small, "trajectories=12"]
    long = [
        "model.optimizer.class_path=torch.optim.Adam",
        "model.optimizer.lr=0.001",
        "trainer.max_epochs=40",
        "data.limit=40",
    ]
    fit = [
        "fit",
        "--config",
        "sysid/push_friction",
        "trainer.enable_progress_bar=true",
        f"data.folder={place / 'push'}",
    ]
    return {
        "generate": [*generate, "generate/push", f"--out={place / 'push'}", "trajectories=200", *small],
        "generate films": [*generate, "generate/push", f"--out={place / 'films'}", "trajectories=12", "steps=60"],
        "generate, an effect": [
            *(*generate, "generate/push_rich", f"--out={place / 'drag'}", *noisy),
            "effects={viscous_drag: {coefficient: 0.5}}",
        ],
        "generate, tosses": [*generate, "generate/toss_rich", f"--out={place / 'toss'}", *noisy],
        "generate, no effect": [*generate, "generate/push_rich", f"--out={place / 'none'}", *noisy],
        "benchmark": [
            *("benchmark", "diagnosis", "seal", f"--out={place / 'bank'}", "--sets=24", "--trajectories=8"),
            *("--steps=120", "--roles=free,catalogue", "--seed=3", "--workers=1"),
        ],
        "track": ["track", str(place / "films"), f"--out={place / 'poses'}"],
        "fit, Adam": [*fit, f"--run-dir={place / 'fit'}", *long],
        "diagnose, no effect": ["diagnose", str(place / "none"), f"--out={place / 'd0'}"],
        "diagnose, an effect": ["diagnose", str(place / "drag"), f"--out={place / 'd1'}"],
        "diagnose, tosses": ["diagnose", str(place / "toss"), f"--out={place / 'd2'}"],
    }


def main() -> None:
    """Print a row for each command: its time, and by how much promises were off, in the median and at most."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--commands", default="", help="only those that begin so (and all that generate), commas between"
    )
    parser.add_argument(
        "--stages", action="store_true", help="print where a diagnosis was when, in percent of the time"
    )
    chosen = parser.parse_args()
    os.environ.update({"OMP_NUM_THREADS": "1", "WANDB_MODE": "disabled", "MPLBACKEND": "agg"})
    from physid.cli import main as physid

    faults.import_all()
    wanted = ("generate", *filter(None, chosen.commands.split(","))) if chosen.commands else ("",)
    worst = 0.0
    print(
        "| command | takes [s] | promises | whole off, median | most | share off, points |\n|---|---|---|---|---|---|"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, words in commands(Path(folder)).items():
            if not name.startswith(wanted):
                continue
            with watched() as promised, contextlib.redirect_stdout(io.StringIO()):
                start = time.process_time()
                assert physid(words) == 0
                whole = time.process_time() - start
            reports = [(now, total) for now, total in promised if FROM * whole <= now <= TO * whole]
            if whole < SHORTEST:
                continue
            off = sorted(abs(total / whole - 1) for _, total in reports) or [0.0]
            points = max((abs(now / total - now / whole) for now, total in reports), default=0.0)
            worst = max(worst, points)
            figures = f"{100 * off[len(off) // 2]:.0f} % | {100 * off[-1]:.0f} % | {100 * points:.0f}"
            print(f"| {name} | {whole:.1f} | {len(reports)} | {figures} |", flush=True)
            if chosen.stages:
                print("   ", ", ".join(f"{100 * now / whole:.0f}: {100 * now / total:.0f}" for now, total in promised))
    sys.exit(worst > WANTED)


if __name__ == "__main__":
    main()
