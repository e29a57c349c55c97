"""Let commands run for hours and watch what they hold: memory, open files, processes and folders of wandb stay flat.

    python benchmarks/long_runs.py                                    two hours of each command, one after the other
    python benchmarks/long_runs.py --commands "fit films" --hours 8 --kept runs/long_runs.jsonl

A command runs on one thread, with no end in sight, and is interrupted when the time is over. Every ten seconds /proc
says what the process and its workers hold together. The slope of memory is that of Theil and Sen (deaf to single
jumps), with its 95 % interval, after the first tenth of the time, in which caches fill and the allocator settles.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.stats import theilslopes

ROOT = Path(__file__).resolve().parents[1]
CONFIGS = ROOT / "configs"
PHYSID = [sys.executable, "-m", "physid"]
EVERY, SETTLING = 10.0, 0.1
"""[s] between two looks; share of the time that the slope leaves out."""
PATIENCE = 120.0
"""[s] for a command to end after an interrupt."""
PAGE = os.sysconf("SC_PAGE_SIZE")
MIB, HOUR = 2.0**20, 3600.0
ENDLESS = 10**6
"""Epochs: more than any time allows."""
MANY = 2000
"""Recording sets of a bank, which are made before the first is diagnosed: half of them in two hours."""


@dataclass(frozen=True)
class Sample:
    """What a command and its workers hold at one time."""

    seconds: float
    memory: int
    """[bytes], resident; pages that several processes share count for each."""
    files: int
    threads: int
    processes: int
    wandb: int
    """Folders that wandb has begun."""
    done: int
    """Lines of the history of a fit, or diagnoses of a bank."""


@dataclass(frozen=True)
class Command:
    """What is run before, and what then runs for hours, in folders of its own."""

    before: tuple[tuple[str, ...], ...]
    words: tuple[str, ...]
    done: str
    """What counts as a step of it: the lines of a file, or the files of a pattern."""


def commands(place: Path) -> dict[str, Command]:
    """Return the commands that can be watched, by name."""
    films, poses = str(place / "films"), str(place / "poses")
    generate = ("generate", "--workers=1", "--quiet", "--config")
    run = f"--run-dir={place / 'run'}"
    return {
        "fit films": Command(
            ((*generate, str(CONFIGS / "generate/push.yaml"), f"--out={films}", "trajectories=8", "steps=60"),),
            (
                *("fit", "--config", str(CONFIGS / "supervised/push_friction_quick.yaml"), run),
                *(f"data.folder={films}", f"trainer.max_epochs={ENDLESS}", f"model.phases.warm_up={ENDLESS - 10}"),
                "model.phases.refine=5",
            ),
            "run/metrics.csv",
        ),
        "fit poses": Command(
            ((*generate, str(CONFIGS / "generate/push.yaml"), f"--out={poses}", "trajectories=8", "video=false"),),
            (
                *("fit", "--config", str(CONFIGS / "sysid/push_friction.yaml"), run, f"data.folder={poses}"),
                *("model.optimizer.class_path=torch.optim.SGD", "model.optimizer.lr=1e-9", "trainer.callbacks=[]"),
                f"trainer.max_epochs={ENDLESS}",
            ),
            "run/metrics.csv",
        ),
        "benchmark": Command(
            (),
            (
                *("benchmark", "diagnosis", f"--out={place / 'bank'}", f"--sets={MANY}", "--trajectories=8"),
                *("--steps=120", "--roles=free,catalogue", "--workers=1"),
            ),
            "bank/**/diagnosis.json",
        ),
    }


def family(process: int) -> Iterator[int]:
    """Yield a process and all that it has begun, and those have begun."""
    yield process
    try:
        for task in Path(f"/proc/{process}/task").iterdir():
            for child in (task / "children").read_text().split():
                yield from family(int(child))
    except OSError:  # it has ended meanwhile
        return


def held(process: int, place: Path, done: str, seconds: float) -> Sample:
    """Return what a process and its workers hold now."""
    memory = files = threads = processes = 0
    for each in family(process):
        try:
            memory += PAGE * int(Path(f"/proc/{each}/statm").read_text().split()[1])
            files += len(os.listdir(f"/proc/{each}/fd"))
            threads += len(os.listdir(f"/proc/{each}/task"))
            processes += 1
        except OSError:
            continue
    found = list(place.glob(done))
    lines = sum(1 for path in found for _ in path.open()) - len(found) if done.endswith(".csv") else len(found)
    return Sample(seconds, memory, files, threads, processes, len(list(place.glob("run/wandb/*run-*"))), lines)


def watch(name: str, command: Command, place: Path, hours: float, kept: Path | None) -> tuple[list[Sample], int]:
    """Run a command for a time; returns what it held and its exit code. Samples are kept as they come."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "WANDB_MODE": "offline", "MPLBACKEND": "agg"}
    for words in command.before:
        subprocess.run([*PHYSID, *words], check=True, cwd=place, env=environment)
    said = place / "said.txt"
    with said.open("w") as file:
        process = subprocess.Popen(
            [*PHYSID, *command.words], cwd=place, env=environment, stdout=file, stderr=file, start_new_session=True
        )
        begun, samples = time.monotonic(), list[Sample]()
        while process.poll() is None and (gone := time.monotonic() - begun) < hours * HOUR:
            samples.append(held(process.pid, place, command.done, gone))
            if kept:
                with kept.open("a") as table:
                    table.write(json.dumps({"command": name} | asdict(samples[-1])) + "\n")
            time.sleep(EVERY)
        early = process.poll() is not None
        process.send_signal(signal.SIGINT)
        try:
            code = process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            code = process.wait()
    if early:
        lines = [line for line in said.read_text(errors="replace").replace("\r", "\n").splitlines() if line.strip()]
        print(f"{name} ended after {samples[-1].seconds / HOUR:.2f} h: {lines[-1] if lines else ''}", file=sys.stderr)
    return samples, code


def row(name: str, samples: list[Sample], code: int) -> str:
    """Return a line of the table: memory at both ends, its slope, and what else changed."""
    last = samples[-1].seconds
    settled = [each for each in samples if each.seconds > SETTLING * last]
    memory = np.array([each.memory / MIB for each in settled])
    slope, _, low, high = theilslopes(memory, [each.seconds / HOUR for each in settled])

    def span(field: str) -> str:
        every = [asdict(each)[field] for each in settled]
        return f"{min(every)}" if min(every) == max(every) else f"{min(every)} to {max(every)}"

    return (
        f"| {name} | {last / HOUR:.2f} | {samples[-1].done} | {memory.min():.0f} to {memory.max():.0f} "
        f"| {slope:+.2f} ({low:+.2f} to {high:+.2f}) | {span('files')} | {span('threads')} | {span('processes')} "
        f"| {span('wandb')} | {code} |"
    )


def main() -> None:
    """Print a line for each command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=2.0, help="of each command")
    parser.add_argument("--commands", default="fit films,fit poses,benchmark", help="which, with commas between")
    parser.add_argument("--kept", type=Path, help="file to which every sample is added")
    chosen = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # what runs in the background is begun to ignore it
    rows = []
    for name in chosen.commands.split(","):
        with tempfile.TemporaryDirectory(prefix="physid-long-", ignore_cleanup_errors=True) as folder:
            place = Path(folder)
            known = commands(place)
            if name not in known:
                parser.error(f"--commands: {name!r} is none of {', '.join(known)}")
            samples, code = watch(name, known[name], place, chosen.hours, chosen.kept)
        rows.append(row(name, samples, code))
    names = ("command", "hours", "steps", "memory [MiB]", "slope [MiB/h]", "files", "threads", "processes", "wandb")
    print(f"| {' | '.join(names)} | ends with |\n{'|---' * (len(names) + 1)}|")
    print("\n".join(rows))


if __name__ == "__main__":
    main()
