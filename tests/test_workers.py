"""Independent tasks on a Dask cluster: a scheduler and two workers, each a process of its own, on the loopback."""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from physid.cli import main
from physid.data.format import SUMS
from physid.diagnosis.document.document import read_diagnosis
from physid.workers import ClusterError, WorkerLostError, running_on

GENERATE = ["generate", "--config", str(Path(__file__).parent.parent / "configs" / "generate" / "push.yaml"), "--quiet"]
SET = ["trajectories=24", "steps=40"]  # with video, so that a trajectory takes long enough to be interrupted
PATIENCE = 60.0  # [s]


@dataclass
class Cluster:
    """A scheduler and its workers."""

    address: str
    workers: list[subprocess.Popen[bytes]]


def start(*words: str) -> subprocess.Popen[bytes]:
    """Start one of Dask's programs, silently, in a process of its own."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-W", "ignore", "-m", "distributed.cli." + words[0], *words[1:]]
    return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    pytest.importorskip("distributed", reason="needs the extra dask: pip install 'physid[dask]'")
    from distributed import Client

    address = f"tcp://127.0.0.1:{free_port()}"
    port = address.rpartition(":")[2]
    scheduler = start("dask_scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")
    quiet = ["--no-nanny", "--no-dashboard", "--nthreads", "1", "--host", "127.0.0.1"]
    workers = [start("dask_worker", address, *quiet, "--local-directory", str(tmp_path / name)) for name in "ab"]
    try:
        with Client(address, timeout=PATIENCE, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=PATIENCE)
        yield Cluster(address, workers)
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


def kill_when(process: subprocess.Popen[bytes], ready: Callable[[], bool]) -> Callable[[], None]:
    """Start a thread that kills a process once something is so; returns what waits for it."""
    import threading

    def watch() -> None:
        end = time.monotonic() + PATIENCE
        while not ready() and time.monotonic() < end:
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)

    thread = threading.Thread(target=watch)
    thread.start()
    return thread.join


@pytest.mark.slow
def test_a_worker_that_is_killed_half_way_costs_no_trajectory_and_changes_no_byte(
    cluster: Cluster, tmp_path: Path
) -> None:
    made, expected = tmp_path / "dask", tmp_path / "alone"
    written = lambda: len(list(made.glob("trajectories/*.h5")))  # noqa: E731
    joined = kill_when(cluster.workers[0], lambda: written() >= 6)
    words = ["--backend=dask", f"--scheduler={cluster.address}"]
    assert main([*GENERATE, f"--out={made}", *words, *SET]) == 0
    joined()
    assert cluster.workers[0].poll() == -signal.SIGKILL
    assert cluster.workers[1].poll() is None
    assert main([*GENERATE, f"--out={expected}", "--workers=1", *SET]) == 0
    assert (made / SUMS).read_text() == (expected / SUMS).read_text()
    assert len((made / SUMS).read_text().splitlines()) == 1 + 24


@pytest.mark.slow
def test_a_worker_that_dies_as_it_is_asked_for_its_version_takes_no_part_and_the_last_is_missed(
    cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    import joblib

    from physid.record import Source

    def dies(among: list[int]) -> Callable[[], Source]:
        def asked() -> Source:
            if os.getpid() in among:
                os.kill(os.getpid(), signal.SIGKILL)
            return Source("1", None, False)

        return asked

    first, second = (each.pid for each in cluster.workers)
    monkeypatch.setattr("physid.workers.source", dies([first]))
    with running_on("dask", cluster.address):
        assert joblib.Parallel()(joblib.delayed(abs)(-each) for each in range(3)) == [0, 1, 2]
    assert cluster.workers[0].wait(PATIENCE) == -signal.SIGKILL
    monkeypatch.setattr("physid.workers.source", dies([second]))
    with pytest.raises(ClusterError, match="has no workers: start some"), running_on("dask", cluster.address):
        pass


@pytest.mark.slow
def test_cells_of_a_reproduction_spread_over_the_workers(cluster: Cluster, tmp_path: Path) -> None:
    import json

    configs = GENERATE[2].rpartition("/generate")[0]
    words = ["reproduce", f"--configs={configs}", "--workers=1", "--cell=sysid/push_mass,sysid/push_friction"]
    spread = [f"--out={tmp_path / 'spread'}", "--backend=dask", f"--scheduler={cluster.address}", "--at-once=2"]
    assert main([*words, *spread]) == 0
    assert main([*words, f"--out={tmp_path / 'alone'}"]) == 0
    tables = [json.loads((tmp_path / name / "results.json").read_text()) for name in ("spread", "alone")]
    figures = [[row for row in table if row["metric"] != "time"] for table in tables]
    assert figures[0] == figures[1]
    assert len(figures[0]) > 4


@pytest.mark.slow
def test_a_bank_is_diagnosed_by_the_workers_as_by_one_process_though_one_of_them_is_killed(
    cluster: Cluster, tmp_path: Path
) -> None:
    spread, alone = tmp_path / "spread", tmp_path / "alone"
    words = ["benchmark", "diagnosis"]
    small = ["--sets=3", "--trajectories=6", "--steps=60", "--seed=99", "--workers=1", "--quiet"]
    assert main([*words, "seal", f"--out={spread}", *small]) == 0
    shutil.copytree(spread, alone)
    joined = kill_when(cluster.workers[0], lambda: any(spread.glob("verdicts/*/time.json")))
    assert main([*words, "diagnose", f"--bank={spread}", "--backend=dask", f"--scheduler={cluster.address}"]) == 0
    joined()
    assert cluster.workers[0].poll() == -signal.SIGKILL
    assert main([*words, "diagnose", f"--bank={alone}", "--workers=1", "--quiet"]) == 0
    # Times apart: how long a diagnosis took is no part of what it says (see `Diagnosis.seconds`).
    found = [
        [read_diagnosis(path) for path in sorted(bank.glob("verdicts/*/diagnosis.json"))] for bank in (spread, alone)
    ]
    assert found[0] == found[1]
    assert len(found[0]) == 3


def test_workers_end_soon_after_their_parent_is_killed() -> None:
    """They would wait for tasks that nobody sends, and hold the pipes of whoever reads what the command says."""
    job = "(joblib.delayed(time.sleep)(0.05) for _ in range(4000))"
    lines = (
        *("import joblib, time", "from physid.workers import running_on", "with running_on():"),
        f"    for _ in joblib.Parallel(n_jobs=2, return_as='generator_unordered')({job}): print(1, flush=True)",
    )
    parent = subprocess.Popen([sys.executable, "-c", "\n".join(lines)], stdout=subprocess.PIPE)
    assert parent.stdout is not None
    with parent.stdout as said:
        said.readline()
        started = Path(f"/proc/{parent.pid}/task").glob("*/children")
        workers = [int(each) for path in started for each in path.read_text().split()]
        assert len(workers) >= 2
        parent.kill()
        parent.wait()
        end = time.monotonic() + 10.0
        while (left := [each for each in workers if running(each)]) and time.monotonic() < end:
            time.sleep(0.02)
    for each in left:
        os.kill(each, signal.SIGKILL)
    assert not left


def test_a_worker_of_this_machine_that_is_killed_is_named_with_the_remedy() -> None:
    import joblib

    with pytest.raises(WorkerLostError, match="the same command goes on"), running_on():
        joblib.Parallel(n_jobs=2)(joblib.delayed(signal.raise_signal)(signal.SIGKILL) for _ in range(2))


def running(process: int) -> bool:
    """Tell whether a process is there and has not ended: nobody may collect an orphan in a container."""
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def test_a_cluster_without_an_address_is_refused_with_the_remedy(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("distributed", reason="needs the extra dask: pip install 'physid[dask]'")
    assert main([*GENERATE, "--backend=dask"]) == 2
    assert "--scheduler tcp://HOST:8786" in capsys.readouterr().err


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="needs the extra dask: pip install 'physid[dask]'")
    monkeypatch.setattr("physid.workers.ANSWER", 1.0)
    address = f"tcp://127.0.0.1:{free_port()}"
    with pytest.raises(ClusterError, match=address), running_on("dask", address):
        pass


@pytest.mark.parametrize("when", ["opened", "closed"])
def test_ctrl_c_while_a_client_is_opened_or_closed_comes_once_it_is_and_what_was_on_its_way_says_nothing(
    when: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("distributed", reason="needs the extra dask: pip install 'physid[dask]'")
    done = []

    class Client:
        def __init__(self, *_: object, **__: object) -> None:
            self.step("opened")

        def step(self, name: str) -> None:
            if name == when:
                signal.raise_signal(signal.SIGINT)
            done.append(name)

        def scheduler_info(self, **_: object) -> dict[str, list[str]]:
            return {"workers": ["one"]}

        def run(self, function: Callable[[], object], **_: object) -> dict[str, object]:
            return {"one": function()}

        def close(self) -> None:
            logging.getLogger("tornado.application").error("Exception in callback")
            self.step("closed")

    monkeypatch.setattr("distributed.Client", Client)
    monkeypatch.setattr("joblib.parallel_config", lambda **_: contextlib.nullcontext())
    with pytest.raises(KeyboardInterrupt), running_on("dask", "tcp://127.0.0.1:1"):
        assert when == "closed"
    assert done == ["opened", "closed"]
    assert not caplog.records
