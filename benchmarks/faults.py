"""Kill, interrupt and starve commands at random points: nothing may be lost but the step in flight.

    python benchmarks/faults.py                            5 faults of each kind for each task
    python benchmarks/faults.py --count 10 --seed 1 --tasks "generate;fit"
    python benchmarks/faults.py --minutes 60 --kept runs/faults.jsonl     an hour more of them, added to those in a file

Each task is run once undisturbed. Then it is run again and again in folders of its own: SIGKILL, SIGTERM or SIGINT
comes once to five times, each at a random point of the run; or files may not grow beyond a random size; or the disk is
full (a small tmpfs, where one can be mounted), or nothing can be written at all; or one of the
workers of a command is killed: of its own, one that loads data, or one of a Dask cluster. Then the same command is run
to its end. Every file must have the same bytes as the undisturbed run's (but for times), every message must be one line
without a traceback, and the exit code must say what happened. Everything runs on one thread.

Most of what a short command does is to import torch. So five of six runs are forked from this process, which has
imported it already, and their faults strike what follows; in every sixth, Python starts afresh (`--afresh`: in all).
"""

from __future__ import annotations

import argparse
import atexit
import contextlib
import hashlib
import importlib
import itertools
import json
import os
import random
import re
import resource
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
CONFIGS = ROOT / "configs"
COMMAND = [sys.executable, "-m", "physid"]
SIGNALS = {"SIGKILL": signal.SIGKILL, "SIGTERM": signal.SIGTERM, "SIGINT": signal.SIGINT}
STARVED = ("file size", "full disk", "read-only")
LOST = "lost worker"
CODES = {"SIGKILL": {-9}, "SIGTERM": {143, -15, -2}, "SIGINT": {130, -2}}
"""What a killed command may end with. Before Python listens to signals, the kernel says it; and Python says -SIGINT
of every process in which an interrupt has passed through what a library's C part runs, say while torch is imported."""
PATIENCE = 60.0
"""[s] for a command to end after a signal; the longest step takes less than one."""
ENDING = 1.0, 0.3
"""[s], and of its time, that a command may need to end by itself when all is done but the last: Lightning looks for a
SIGTERM between epochs, and after the last there is none."""
STARTING = 0.5
"""[s] from the start in which Python itself, not physid, answers Ctrl-C, with a traceback."""
UNENDED, LEFT = f"did not end within {PATIENCE:g} s", "left processes behind"
TIMED = {"seconds", "started", "time", "cpu_seconds", "salt"}
"""Keys of what differs between any two runs: times, and the random salt under which labels are sealed."""
SKIPPED = ("wandb", "record.json", "report.html", ".lock", "SHA256SUMS.part")
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
SETTING = {**THREADS, "WANDB_MODE": "disabled", "MPLBACKEND": "agg"}
MOST = 5
"""Signals that come to one folder before the command may end."""


class Forked:
    """A command in a fork of this process, with what is used of subprocess.Popen."""

    def __init__(self, words: list[str], folder: Path, restrict: Callable[[], None]) -> None:
        self.returncode: int | None = None
        sys.stdout.flush()
        self._read, write = os.pipe()
        self.pid = os.fork()
        if self.pid:
            os.close(write)
            return
        code = 1
        try:
            os.setsid()
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            os.dup2(write, 2)
            os.closerange(3, 256)
            os.chdir(folder)
            signal.signal(signal.SIGINT, signal.default_int_handler)
            restrict()
            sys.argv = ["physid", *words]
            _program()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except BaseException:
            traceback.print_exc()
        finally:
            with contextlib.suppress(BaseException):
                threading._shutdown()  # type: ignore[attr-defined]
                atexit._run_exitfuncs()
                sys.stderr.flush()
            os._exit(code)

    def poll(self) -> int | None:
        """Return how it ended, or None."""
        if self.returncode is None:
            done, status = os.waitpid(self.pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if done else None
        return self.returncode

    def wait(self, timeout: float) -> int:
        """Return how it ended; raises TimeoutExpired if it has not by then [s]."""
        end = time.monotonic() + timeout
        while self.poll() is None:
            if time.monotonic() > end:
                raise subprocess.TimeoutExpired("physid", timeout)
            time.sleep(0.005)
        assert self.returncode is not None
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """Wait until nobody holds its stderr; returns what was said there."""
        said, end = b"", None if timeout is None else time.monotonic() + timeout
        while self._read >= 0:
            left = None if end is None else max(0.0, end - time.monotonic())
            if not select.select([self._read], [], [], left)[0]:
                raise subprocess.TimeoutExpired("physid", timeout or 0.0)
            part = os.read(self._read, 65536)
            said += part
            if not part:
                os.close(self._read)
                self._read = -1
        self.wait(PATIENCE if end is None else max(1.0, end - time.monotonic()))
        return "", said.decode(errors="replace")


def _program() -> None:
    from physid.cli import program

    program()


def import_all() -> None:
    """Import what the commands need, for those that are forked from this process."""
    os.environ.update(SETTING)
    for module in (
        *(
            "physid.benchmark.sealing.seal",
            "physid.dashboard.page",
            "physid.diagnosis.diagnose",
            "physid.reproduce.run",
        ),
        *("physid.data.importers.convert", "physid.simulators.bullet.world", "physid.training.runs.run"),
        *("physid.training.learners.sysid", "physid.training.tracking", "physid.commands", "torch.utils.data"),
        *("scipy.optimize", "scipy.stats", "matplotlib.pyplot", "distributed"),
    ):
        importlib.import_module(module)


class Cluster:
    """A Dask cluster on this machine: a scheduler and two workers, of which one may be killed."""

    def __init__(self, place: Path) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.address, self._place = f"tcp://127.0.0.1:{port}", place
        self._scheduler = ("dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
        self._started: list[subprocess.Popen[bytes]] = []

    def _start(self, *words: str) -> None:
        command = [sys.executable, "-W", "ignore", "-m", f"distributed.cli.{words[0]}", *words[1:]]
        null = subprocess.DEVNULL
        started = subprocess.Popen(
            command, stdout=null, stderr=null, env={**os.environ, **SETTING}, start_new_session=True
        )
        self._started.append(started)

    def workers(self) -> list[int]:
        """Return the processes of the workers, after those that are missing were started."""
        from distributed import Client

        self._started = [each for each in self._started if each.poll() is None]
        if not self._started:
            self._start(*self._scheduler)
        quiet = ["--no-nanny", "--no-dashboard", "--nthreads", "1", "--host", "127.0.0.1"]
        while len(self._started) < 3:
            folder = tempfile.mkdtemp(dir=self._place)
            self._start("dask_worker", self.address, *quiet, "--local-directory", folder)
        with Client(self.address, timeout=PATIENCE, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=PATIENCE)
        return [each.pid for each in self._started[1:]]

    def rest(self) -> None:
        """Wait for workers to end what they were about: Dask interrupts no task, whatever became of its command."""
        from distributed import Client

        def busy(dask_worker: Any) -> bool:
            return bool(dask_worker.state.executing)

        with Client(self.address, timeout=PATIENCE, set_as_default=False) as client:
            while any(client.run(busy).values()):
                time.sleep(0.05)

    def close(self) -> None:
        """End all of it."""
        for process in self._started:
            process.kill()
            process.wait()


@dataclass(frozen=True)
class Task:
    """A command and where its result lies.

    Attributes:
        name: What it is called.
        words: The command's words for a folder.
        workers: Whether it has processes of its own, of which one may be lost.
        cluster: Where it runs otherwise.
    """

    name: str
    words: Callable[[Path], list[str]]
    workers: bool = False
    cluster: Cluster | None = None

    def start(self, folder: Path, limit: int | None = None, *, afresh: bool = False) -> subprocess.Popen[str] | Forked:
        """Start the command with its result in a folder; `limit` [bytes] for each file that it writes."""

        def restrict() -> None:
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # a shell lets what runs in the background ignore it
            if limit is not None:
                signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

        if not afresh:
            return Forked(self.words(folder), folder.parent, restrict)
        return subprocess.Popen(
            [*COMMAND, *self.words(folder)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, **SETTING},
            cwd=folder.parent,
            start_new_session=True,
            preexec_fn=restrict,
        )


def tasks(data: Path, cluster: Cluster) -> list[Task]:
    """Return the commands that are tried; what they read lies in a folder."""
    push, fit = str(data / "push"), str(CONFIGS / "sysid" / "push_friction.yaml")
    generating = ["generate", "--config", str(CONFIGS / "generate" / "push.yaml"), "--workers=1", "--quiet"]
    anew = ["fit", "--config", fit, f"data.folder={push}", "data.limit=4", "trainer.max_epochs=5"]
    fitting = [*anew, "--resume"]

    def overwriting(place: Path) -> list[str]:
        """Return the words of a fit in place of an earlier run, which is put there first."""
        if not place.exists():
            try:
                shutil.copytree(data / "run", place)
            except OSError:  # a full or a read-only disk: the fit finds nothing to take the place of
                shutil.rmtree(place, ignore_errors=True)
        return [*anew, "--overwrite", f"--run-dir={place}"]

    return [
        Task("generate", lambda place: [*generating, f"--out={place}", "trajectories=40", "steps=60", "video=false"]),
        Task(
            "generate, 2 workers",
            lambda place: [
                *("generate", "--config", str(CONFIGS / "generate" / "push.yaml"), "--quiet", "--workers=2"),
                *(f"--out={place}", "trajectories=24", "steps=60", "video=false"),
            ],
            workers=True,
        ),
        Task(
            "generate, Dask",
            lambda place: [
                *("generate", "--config", str(CONFIGS / "generate" / "push.yaml"), "--quiet", f"--out={place}"),
                *("trajectories=24", "steps=60", "video=false", "--backend=dask", f"--scheduler={cluster.address}"),
            ],
            workers=True,
            cluster=cluster,
        ),
        Task("generate film", lambda place: [*generating, f"--out={place}", "trajectories=3", "steps=20"]),
        Task("import", lambda place: ["import", "cube-tosses", str(data / "tosses"), f"--out={place}"]),
        Task("fit", lambda place: [*fitting, f"--run-dir={place}"]),
        Task("fit, overwriting", overwriting),
        Task("fit, a loader", lambda place: [*fitting, "data.workers=1", f"--run-dir={place}"], workers=True),
        Task(
            "predict",
            lambda place: ["predict", "--run-dir", str(data / "run"), f"--out={place}", "--overwrite"],
        ),
        Task(
            "reproduce",
            lambda place: [
                *("reproduce", "--cell", "sysid/push_friction", f"--out={place}", f"--configs={CONFIGS}"),
                "--workers=1",
            ],
        ),
        Task("diagnose", lambda place: ["diagnose", str(data / "rich"), f"--out={place}", "--quiet"]),
        Task("track", lambda place: ["track", str(data / "films"), f"--out={place}", "--limit=2", "--quiet"]),
        Task(
            "benchmark",
            lambda place: [
                *("benchmark", "diagnosis", "seal", f"--out={place}", "--sets=3", "--trajectories=6", "--steps=60"),
                *("--roles=free,catalogue", "--seed=3"),
            ],
        ),
        Task("dashboard", lambda place: ["dashboard", str(data), f"--out={place / 'page.html'}"]),
    ]


def prepare(data: Path) -> None:
    """Make what the tasks read: recordings, a run and made-up tosses."""
    import torch

    quiet = {"stdout": subprocess.DEVNULL, "check": True, "env": {**os.environ, **SETTING}}
    for name, more in (("push", []), ("push_rich", ["noise.position=0.0005", "noise.rotation=0.002"])):
        words = ["generate", "--config", str(CONFIGS / "generate" / f"{name}.yaml"), "--workers=1", "--quiet"]
        out = f"--out={data / name.replace('push_rich', 'rich')}"
        small = [out, "trajectories=8", "steps=60", "video=false", *more]
        subprocess.run([*COMMAND, *words, *small], **quiet)  # type: ignore[call-overload]
    films = ["generate", "--config", str(CONFIGS / "generate" / "push.yaml"), "--workers=1", "--quiet"]
    films += [f"--out={data / 'films'}", "trajectories=2", "steps=12"]
    subprocess.run([*COMMAND, *films], **quiet)  # type: ignore[call-overload]
    words = ["fit", "--config", str(CONFIGS / "sysid" / "push_friction.yaml"), f"data.folder={data / 'push'}"]
    subprocess.run([*COMMAND, *words, f"--run-dir={data / 'run'}"], **quiet)  # type: ignore[call-overload]
    (data / "tosses").mkdir()
    time_of = torch.arange(40, dtype=torch.float64) / 148
    for number in range(30):
        rows = torch.zeros(40, 13, dtype=torch.float64)
        rows[:, 0] = 1.0
        rows[:, 6] = 0.0524 + 0.3 * (0.05 - time_of).clamp_min(0)
        rows[:, 4] = 0.01 * number * time_of
        torch.save(rows, data / "tosses" / f"{number}.pt")


def snapshot(folder: Path) -> dict[str, str]:
    """Return a digest of every file of a result, without what differs between any two runs: times."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not any(part in SKIPPED for part in path.relative_to(folder).parts):
            found[path.relative_to(folder).as_posix()] = hashlib.sha256(_content(path, folder)).hexdigest()
    return found


def _content(path: Path, folder: Path) -> bytes:
    content = path.read_bytes().replace(str(folder).encode(), b"FOLDER")
    if path.suffix == ".ckpt":
        import torch

        state = torch.load(path, map_location="cpu", weights_only=True)
        return repr([state[key] for key in ("state_dict", "optimizer_states", "epoch", "global_step")]).encode()
    if path.suffix == ".json":
        return json.dumps(_timeless(json.loads(content))).encode()
    if path.name == "bank.yaml":
        return re.sub(rb"(?m)^seal:.*$", b"", content)
    if path.name in ("results.md", "page.html"):  # a row of the time; when the page was made, and of files copied
        return re.sub(rb'(\| time \||"made":|"date":|written )[^\n,<]*', b"", content)
    return content


def _timeless(value: object) -> object:
    if isinstance(value, dict):
        return {key: _timeless(each) for key, each in value.items() if key not in TIMED}
    if isinstance(value, list):
        return [_timeless(each) for each in value if not (isinstance(each, dict) and each.get("metric") in TIMED)]
    return value


def end(process: subprocess.Popen[str] | Forked, timeout: float) -> str:
    """Wait for a command and whatever it has started, which hold its stderr; returns what they have said."""
    try:
        _, said = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        said = UNENDED if process.poll() is None else LEFT
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    return said


def said_last(said: str) -> str:
    """Return the last line of what a command has said, for a reader of the table."""
    return (said.strip().splitlines() or ["without a word"])[-1][:300]


PROGRESS = "|".join(
    (
        r"^epoch \d+(?:/\d+)?(?:,.*)?$\n?",
        r"^[^\n]*\d+%\|[^\n]*\[\d+:\d\d[^\n]*\]$\n?",
        r"^[^\n]*\d+[a-z]+ \[\d+:\d\d[^\n]*\]$\n?",
        r"^(?:starting|(?:reading|fitting|choosing|replaying|measuring|testing|looking|writing) [^\n]*), \d+ %$\n?",
    )
)
"""What a fit, bars and a diagnosis write into a log: epochs, shares, counts whose end is not known, stages."""


def complaints(said: str, code: int | None, wanted: set[int], early: bool = False) -> list[str]:
    """Say what is wrong with how a disturbed command ended; `early` while Python itself was starting."""
    found = [] if code in wanted else [f"exit code {code}, {said_last(said)}"]
    # Python's tracker of what processes share outlives a kill and says what it cleans up, in two lines each.
    said = re.sub(r".*resource_tracker\.py:\d+: UserWarning:.*\n.*\n?", "", said)
    # And joblib says in two lines that it works alone where no semaphore can be made, as where files may not grow.
    said = re.sub(r".*_multiprocessing_helpers\.py:\d+: UserWarning:.*\n.*\n?", "", said)
    # Without a terminal, how far a command is comes in lines: epochs of a fit, and bars.
    said = re.sub(PROGRESS, "", said, flags=re.MULTILINE)
    lines = [line for line in said.strip().splitlines() if line.strip()]
    if said in (UNENDED, LEFT):
        found.append(said)
    elif "Traceback" in said and not early:
        found.append("traceback: " + lines[-1])
        print(said, file=sys.stderr, flush=True)
    elif len(lines) > 1 and not early:
        found.append(f"{len(lines)} lines: " + " | ".join(lines)[:200])
    return found


def kill(task: Task, folder: Path, name: str, whole: float, draw: random.Random, afresh: bool) -> tuple[int, list[str]]:
    """Send a signal once to five times, each at a random point; returns how often, and what is wrong."""
    found, times = [], 0
    for _ in range(draw.randint(1, MOST)):
        process, delay = task.start(folder, afresh=afresh), draw.uniform(0.05 if afresh else 0.0, whole)
        try:
            process.wait(delay)
        except subprocess.TimeoutExpired:
            process.send_signal(SIGNALS[name])
            times += 1
        sent = time.perf_counter()
        said = end(process, PATIENCE)
        # The command may have ended by itself meanwhile: the resumed run shows whether all was there.
        took = time.perf_counter() - sent
        done = {0} if took < max(ENDING[0], ENDING[1] * whole) else set()
        early = name == "SIGINT" and afresh and delay < STARTING
        wrong = complaints(said, process.returncode, CODES[name] | done, early)
        found += [f"{each}, sent after {delay:.2f} of {whole:.2f} s, {took:.2f} s before it ended" for each in wrong]
    return times, found


def children(process: int) -> list[int]:
    """Return the processes that a process has started, and theirs, without those that only count what is shared."""
    listing = Path(f"/proc/{process}/task/{process}/children")
    direct = [int(each) for each in listing.read_text().split()] if listing.exists() else []
    found = [*direct, *(other for each in direct for other in children(each))]
    return [each for each in found if b"resource_tracker" not in _words(each)]


def _words(process: int) -> bytes:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/cmdline").read_bytes()
    return b""


def lose(task: Task, folder: Path, whole: float, draw: random.Random) -> list[str]:
    """Kill one of the processes that a command has started, at a random point; the command goes on or says so."""
    process = task.start(folder)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(draw.uniform(0.3 * whole, whole))
    workers = children(process.pid) if task.cluster is None else task.cluster.workers()
    if workers:
        with contextlib.suppress(ProcessLookupError):
            os.kill(draw.choice(workers), signal.SIGKILL)
    said = end(process, 600)
    # 1: says that a worker was lost, and how to go on; Dask gives what it held to another
    return complaints(said, process.returncode, {0, 1} if task.cluster is None else {0})


def starve(task: Task, folder: Path, name: str, truth: Undisturbed, draw: random.Random) -> list[str] | None:
    """Run with files that may not grow, on a full disk, or where nothing can be written; None if that cannot be."""
    limit = draw.randrange(0, max(truth.longest, 1)) if name == "file size" else None
    place = folder
    if name == "full disk":
        folder.mkdir()
        size = min(1024 * draw.choice([16, 32, 64]), max(truth.total // 2, 4096))  # too small for what is written
        mounting = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
        if subprocess.run(mounting, capture_output=True, check=False).returncode:
            return None
        place = folder / "result"
    if name == "read-only":
        place = Path("/proc/physid_faults")  # not even root can make a folder there
    process = task.start(folder if place.parent == Path("/proc") else place, limit) if place == folder else None
    if process is None:
        process = Task(task.name, lambda _: task.words(place)).start(folder, limit)
    said = end(process, 600)
    if task.cluster is not None:
        task.cluster.rest()  # or it would write what is left into the folder that comes after this one
    if name == "full disk":
        subprocess.run(["umount", str(folder)], check=True)
        folder.rmdir()
    wanted = {2} if name != "file size" else {0, 2}
    return complaints(said, process.returncode, wanted)


@dataclass(frozen=True)
class Undisturbed:
    """What a task does when nothing disturbs it: the digest of each file, the longest and all [bytes], the time [s].

    The time is that of a run in which Python starts afresh (True) and of one that is forked (False).
    """

    digests: dict[str, str]
    longest: int
    total: int
    seconds: dict[bool, float]


def run(task: Task, work: Path) -> Undisturbed:
    """Run a task without disturbance."""
    seconds = dict[bool, float]()
    for afresh in (True, False):
        if task.cluster is not None:
            task.cluster.workers()
        folder, start = work / task.name.replace(" ", "_").replace(",", ""), time.perf_counter()
        process = task.start(folder, afresh=afresh)
        said = end(process, 600)
        seconds[afresh] = time.perf_counter() - start
        assert process.returncode == 0, f"{task.name}: {said}"
        sizes = [path.stat().st_size for path in folder.rglob("*") if path.is_file()]
        digests = snapshot(folder)
        shutil.rmtree(folder)
    return Undisturbed(digests, max(sizes, default=1), sum(sizes), seconds)


def attack(
    task: Task, name: str, work: Path, truth: Undisturbed, draw: random.Random, afresh: bool
) -> tuple[int, list[str]]:
    """Disturb a task and let it run to its end; returns how often it was disturbed, and what is wrong."""
    if task.cluster is not None:
        task.cluster.workers()
    folder = work / f"{task.name}_{draw.randrange(10**9)}".replace(" ", "_").replace(",", "")
    times, found = 1, None
    if name in SIGNALS:
        times, found = kill(task, folder, name, truth.seconds[afresh], draw, afresh)
    elif name == LOST:
        found = lose(task, folder, truth.seconds[False], draw) if task.workers else None
    else:
        found = starve(task, folder, name, truth, draw)
    if found is None:
        return 0, []
    process = task.start(folder, afresh=afresh)
    said = end(process, 600)
    if process.returncode:
        found.append(f"does not go on: {said_last(said)}")
    else:
        then, now = truth.digests, snapshot(folder)
        other = sorted(key for key in then.keys() | now.keys() if then.get(key) != now.get(key))
        if other:
            found.append(f"other bytes: {', '.join(other)[:200]}")
            if os.environ.get("KEEP"):
                return times, found
    shutil.rmtree(folder, ignore_errors=True)
    return times, found


def main() -> None:
    """Print a row for each task and fault: how often it was tried, and how often something was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=5, help="faults of each kind for each task")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tasks", default="", help="only these, separated by semicolons")
    parser.add_argument("--faults", default="", help="only these, separated by commas")
    parser.add_argument("--afresh", action="store_true", help="let Python start afresh in each run")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no further fault after this time")
    parser.add_argument("--kept", type=Path, help="file of what was tried, to which this call adds")
    chosen = parser.parse_args()
    wanted, begun = [each for each in chosen.tasks.split(";") if each], time.monotonic()
    kinds = [each for each in chosen.faults.split(",") if each] or [*SIGNALS, *STARVED, LOST]
    tried: list[dict[str, Any]] = []
    if chosen.kept and chosen.kept.is_file():
        tried = [json.loads(line) for line in chosen.kept.read_text().splitlines()]
    known = {(row["seed"], row["task"], row["fault"], row["number"]) for row in tried}
    with contextlib.ExitStack() as stack:
        place = tempfile.mkdtemp()  # a TemporaryDirectory would be removed by whatever is forked from here
        stack.callback(shutil.rmtree, place, ignore_errors=True)
        data, work = Path(place) / "data", Path(place) / "work"
        data.mkdir()
        work.mkdir()
        prepare(data)
        import_all()
        cluster = Cluster(Path(place))
        stack.callback(cluster.close)
        truths: dict[str, Undisturbed] = {}
        order = itertools.product(range(chosen.count), tasks(data, cluster), kinds)  # a short time tries all a little
        for number, task, kind in order:
            name = (chosen.seed, task.name, kind, number)
            if name in known or (wanted and task.name not in wanted) or time.monotonic() - begun > 60 * chosen.minutes:
                continue
            truths[task.name] = truths.get(task.name) or run(task, work)
            draw = random.Random(" ".join(map(str, name)))
            afresh = chosen.afresh or draw.randrange(6) == 0
            times, found = attack(task, kind, work, truths[task.name], draw, afresh)
            row = {"seed": chosen.seed, "task": task.name, "fault": kind, "number": number, "afresh": afresh}
            tried.append({**row, "times": times, "wrong": found})
            if chosen.kept:
                with chosen.kept.open("a") as file:
                    file.write(json.dumps(tried[-1]) + "\n")
            if found:
                print(f"    {task.name}, {kind} {number}: {'; '.join(found)}", flush=True)
    report(tried)
    sys.exit(any(row["wrong"] for row in tried))


def report(tried: list[dict[str, Any]]) -> None:
    """Print a row for each task and a column for each fault: how often it struck, and how many runs were wrong."""
    kinds = [kind for kind in (*SIGNALS, *STARVED, LOST) if any(row["fault"] == kind for row in tried)]
    print(f"| task | {' | '.join(kinds)} | runs | wrong |")
    print("|---" * (len(kinds) + 3) + "|")
    for task in (*dict.fromkeys(row["task"] for row in tried), ""):
        rows = [row for row in tried if row["task"] == task or not task]
        counts = [sum(row["times"] for row in rows if row["fault"] == kind) for kind in kinds]
        runs, wrong = sum(row["times"] > 0 for row in rows), sum(bool(row["wrong"]) for row in rows)
        print(f"| {task or 'all'} | {' | '.join(map(str, counts))} | {runs} | {wrong} |")


if __name__ == "__main__":
    main()
