"""Feed damaged and hostile input to every reader: no traceback, no hang, memory in proportion to the input.

    python benchmarks/fuzz.py                              2000 inputs for each target
    python benchmarks/fuzz.py --count 20000 --seed 1 --targets configuration,forces
    python benchmarks/fuzz.py --guided --minutes 30 --kept runs/fuzz     guided by coverage, added to an earlier call

Each input is a valid one that was changed at random: bytes, words, keys and values. What is refused must be refused
with a ValueError or an OSError whose message is short; nothing may take longer than a few seconds, or more than 1 GiB
beyond what Python and its libraries hold. Faults are printed, one of each kind, and kept with --kept.

With --guided (`pip install atheris`) libFuzzer makes the numbers from which the changes are drawn, and prefers those
that have reached new lines of physid; what reached some stays in --kept, and the next call goes on from there.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import FrameType

from fuzzed.targets import CONFIGS, TARGETS, Target

LONGEST = 5.0
"""[s] of computing for one input; the slowest of the valid ones takes one, most less than a tenth."""
WAITING = 6.0
"""Times as long by the clock: one that waits computes nothing, and other work may keep it waiting."""
SLOW = "took more than"
ROOM = 2**30
"""[bytes] of memory for one input."""
LONGEST_MESSAGE, MOST_LINES = 20_000, 3
"""[letters]; the command line cuts its lines to some hundred."""


class Hang(BaseException):
    """An input that took too long."""


class Bytes(random.Random):
    """Random numbers that somebody else has chosen, and after their end those of a fixed seed."""

    def __init__(self, data: bytes) -> None:
        super().__init__(len(data))
        self._data, self._at = data, 0

    def getrandbits(self, k: int) -> int:
        """Return a number of k bits."""
        size = (k + 7) // 8
        part, self._at = self._data[self._at : self._at + size], self._at + size
        return super().getrandbits(k) if len(part) < size else int.from_bytes(part, "little") >> (8 * size - k)

    def random(self) -> float:
        """Return a number from 0 to below 1."""
        return self.getrandbits(16) / 2**16


def attempt(target: Target, draw: random.Random, place: Path) -> tuple[bool, str | None]:
    """Feed one input; tells whether it was accepted, and what is wrong, if anything is."""
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    before = os.getcwd()
    os.chdir(place)
    try:
        target.feed(draw, place)
    except (ValueError, OSError) as error:
        message = str(error)
        lines = message.count("\n") + 1
        if len(message) > LONGEST_MESSAGE or lines > MOST_LINES or not message:
            return False, f"{type(error).__name__} of {len(message)} letters in {lines} lines: {message[:100]!r}"
        return False, None
    except Hang as hang:
        return False, f"{SLOW} {LONGEST:g} s at {hang}"
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if "physid" in frame.filename] or frames
        return False, f"{type(error).__name__}: {str(error)[:150]!r} at {Path(own[-1].filename).name}:{own[-1].lineno}"
    finally:
        os.chdir(before)
    return True, None


def import_all() -> None:
    """Import what the targets need, which takes longer and more memory than an input may."""
    import physid.dashboard.page
    import physid.diagnosis.diagnose
    import physid.simulators.bullet.world
    import physid.training.learners.sysid
    import physid.training.runs.run  # noqa: F401
    from physid.configuration import compose
    from physid.schema.check import check_fit

    check_fit(compose([CONFIGS / "sysid" / "push_friction.yaml"]))


def _stop(number: int, frame: FrameType | None) -> None:
    where = [f"{Path(each.filename).name}:{each.lineno}" for each in traceback.extract_stack(frame)[-4:]]
    raise Hang(" ".join(where))


class Tally:
    """What came of a target's inputs: how many, how many accepted, the slowest [s], and one fault of each kind."""

    def __init__(self, target: Target, place: Path, kept: Path | None) -> None:
        self.target, self.place, self.kept = target, place, kept
        self.inputs, self.accepted, self.slowest, self.faults = 0, 0, 0.0, dict[str, str]()

    def feed(self, draw: Callable[[], random.Random]) -> None:
        """Feed one input, made of random numbers. The first ten import and fill caches, and have no limit of memory."""
        if self.inputs == 10:
            held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (held + ROOM, resource.RLIM_INFINITY))
        taken, fault = self._timed(draw())
        if fault is not None and fault.startswith(SLOW):  # because of the input, or of what else the machine does?
            taken, fault = self._timed(draw())
        self.inputs, self.accepted = self.inputs + 1, self.accepted + taken
        kind = "" if fault is None else fault.partition(" at ")[2] or fault[:20]
        if fault is not None and kind not in self.faults:
            self.faults[kind] = fault
            print(f"    {self.target.name} {self.inputs}: {fault}", flush=True)
            if self.kept:
                shutil.copytree(self.place, self.kept / f"{self.target.name}_{len(self.faults)}", dirs_exist_ok=True)

    def _timed(self, draw: random.Random) -> tuple[bool, str | None]:
        start = time.perf_counter()
        signal.setitimer(signal.ITIMER_PROF, LONGEST)
        signal.setitimer(signal.ITIMER_REAL, WAITING * LONGEST)
        found = attempt(self.target, draw, self.place)
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        self.slowest = max(self.slowest, time.perf_counter() - start)
        return found

    def row(self) -> dict[str, object]:
        """Return what --kept remembers."""
        found = {"inputs": self.inputs, "accepted": self.accepted, "slowest": self.slowest, "wrong": len(self.faults)}
        return {"target": self.target.name, **found}


def by_chance(target: Target, chosen: argparse.Namespace, tally: Tally, end: float) -> None:
    """Feed a target inputs that Python's own random numbers make, until the count or the time is reached."""
    for number in range(chosen.count):
        if time.monotonic() > end:
            break
        tally.feed(partial(random.Random, f"{chosen.seed} {target.name} {number}"))


def by_coverage(target: Target, chosen: argparse.Namespace, tally: Tally, end: float, done: Callable[[], None]) -> None:
    """Feed a target what libFuzzer makes, until the count or the time is reached; ends the process."""
    import atheris

    def one(data: bytes) -> None:
        tally.feed(partial(Bytes, data))
        if tally.inputs >= chosen.count or time.monotonic() > end:
            done()
            os._exit(0)

    corpus = (chosen.kept or tally.place.parent) / "corpus" / target.name
    corpus.mkdir(parents=True, exist_ok=True)
    words = ["-timeout=0", "-rss_limit_mb=0", "-len_control=0", "-max_len=512", f"-seed={chosen.seed + 1}"]
    atheris.Setup([sys.argv[0], *words, "-verbosity=0", str(corpus)], one)
    atheris.Fuzz()


def run(target: Target, chosen: argparse.Namespace, seconds: float) -> None:
    """Feed one target in this process, and add a row about it to the kept ones."""
    with tempfile.TemporaryDirectory() as folder:
        tally = Tally(target, Path(folder) / "input", chosen.kept)

        def done() -> None:
            with (chosen.kept / "rows.jsonl").open("a") as file:
                file.write(json.dumps(tally.row()) + "\n")

        for each in (signal.SIGPROF, signal.SIGALRM):
            signal.signal(each, _stop)
        if chosen.guided:
            import atheris

            silenced = contextlib.redirect_stderr(io.StringIO())  # each module's name
            with silenced, atheris.instrument_imports(include=["physid", "yaml", "omegaconf"]):
                import_all()
            by_coverage(target, chosen, tally, time.monotonic() + seconds, done)
        import_all()
        by_chance(target, chosen, tally, time.monotonic() + seconds)
        done()


def main() -> None:
    """Feed each target in a process of its own; print a row: inputs, how many were accepted and wrong, the slowest."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2000, help="inputs for each target")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--targets", default="", help="only these, separated by commas")
    parser.add_argument("--minutes", type=float, default=0.0, help="share this time among the targets")
    parser.add_argument("--guided", action="store_true", help="prefer inputs that reach new lines")
    parser.add_argument(
        "--kept",
        type=lambda text: Path(text).absolute(),
        help="folder of what went wrong, of counts and of what reached new lines",
    )
    parser.add_argument("--one", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    targets = [each for each in TARGETS if not chosen.targets or each.name in chosen.targets.split(",")]
    seconds = 60 * chosen.minutes / len(targets) if chosen.minutes else float("inf")
    if chosen.one:
        run(next(each for each in TARGETS if each.name == chosen.one), chosen, seconds)
        return
    with tempfile.TemporaryDirectory() as folder:
        kept = chosen.kept or Path(folder)
        kept.mkdir(parents=True, exist_ok=True)
        words = [f"--count={chosen.count}", f"--seed={chosen.seed}", f"--kept={kept}", *["--guided"] * chosen.guided]
        for target in targets:
            share = [f"--minutes={seconds * len(TARGETS) / 60}"] if chosen.minutes else []
            subprocess.run([sys.executable, __file__, *words, *share, f"--one={target.name}"], check=True)
        rows = [json.loads(line) for line in (kept / "rows.jsonl").read_text().splitlines()]
    print(f"{'target':<14} {'inputs':>7} {'accepted':>8} {'wrong':>6} {'slowest':>8}")
    for name in (*dict.fromkeys(row["target"] for row in rows), "all"):
        own = [row for row in rows if name in (row["target"], "all")]
        inputs, accepted, wrong = (sum(row[key] for row in own) for key in ("inputs", "accepted", "wrong"))
        print(f"{name:<14} {inputs:>7} {accepted:>8} {wrong:>6} {max(row['slowest'] for row in own):>7.2f}s")
    sys.exit(any(row["wrong"] for row in rows))


if __name__ == "__main__":
    main()
