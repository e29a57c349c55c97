"""Where independent tasks run: in processes of this machine, or on the workers of a Dask cluster."""

from __future__ import annotations

import logging
import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from signal import SIGINT, SIGTERM
from typing import Any, Literal

from physid.record import Source, source

Backend = Literal["loky", "dask"]
ANSWER = 10.0  # [s] for a scheduler to answer
WATCH = 0.2  # [s] from one look of a worker at its parent to the next


class WorkerLostError(RuntimeError):
    """A process of this machine that ended in the middle of a task."""


class ClusterError(ValueError):
    """A cluster that cannot be used: which, why, and what to do."""


@contextmanager
def running_on(backend: Backend = "loky", scheduler: str | None = None) -> Iterator[Callable[[Path], Path]]:
    """Let every `joblib.Parallel` in the block run there: trajectories, cells of a reproduction, banks of diagnoses.

    Tasks are independent, write whole files or none, and draw their randomness from their own number, so that neither
    the number of workers nor one that dies changes a result: Dask gives what a dead worker held to another. A process
    of this machine ends when the one that started it has died.

    Args:
        backend: loky for processes of this machine, dask for the workers of a cluster.
        scheduler: Address of Dask's scheduler, tcp://HOST:PORT. Its workers see the same folders at the same paths.

    Yields:
        What makes of a path one that means the same on every worker: absolute for dask, unchanged for loky.

    Raises:
        ClusterError: If there is no scheduler, no worker, or one of them runs another physid.
        WorkerLostError: If a process of this machine was killed.
    """
    import joblib

    if backend == "loky":
        try:
            with (
                joblib.parallel_config(backend="loky", initializer=_end_with, initargs=(os.getpid(),)),
                warnings.catch_warnings(),
            ):
                # One whose memory has grown is replaced by a fresh one, between two tasks: nothing is lost.
                warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
                yield lambda path: path
        except BrokenProcessPool:
            raise WorkerLostError(
                "a worker process was killed, as the system does where memory is short; the same command goes on where "
                "it stopped, with fewer --workers where that was so"
            ) from None
        return
    client = None
    # What a worker loses is computed again, and what fails is said by physid: no line of its own for that.
    logging.getLogger("distributed.client").setLevel(logging.ERROR)
    try:
        with _signals_wait():
            client = _connect(scheduler)
        _require_same_source(client, str(scheduler))
        with joblib.parallel_config(backend="dask", client=client):
            yield Path.absolute
    finally:
        with _signals_wait():
            if client is not None:
                # What is on its way then fails in the client's own thread, which would log each with a traceback.
                logging.getLogger("tornado.application").setLevel(logging.CRITICAL)
                client.close()


def _end_with(parent: int) -> None:
    """Let this worker end once its parent has died: loky's would wait for the next task for 300 s.

    Nothing is lost that a killed parent would not lose: files are written whole or not at all. A thread looks for the
    parent, since prctl(PR_SET_PDEATHSIG) is Linux's alone and watches the thread, not the process, of the parent.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH)
        os._exit(1)

    threading.Thread(target=watch, name="watch the parent", daemon=True).start()


@contextmanager
def _signals_wait() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM come after the block: a client half open or half closed holds its process for 20 s.

    Opening takes no longer than an answer may.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {each: signal.signal(each, lambda number, _: came.append(number)) for each in (SIGINT, SIGTERM)}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
        for number in dict.fromkeys(came):
            signal.raise_signal(number)


def _connect(scheduler: str | None) -> Any:
    """Return a client of the cluster."""
    try:
        from distributed import Client
    except ImportError:
        raise ClusterError("the backend dask needs the extra dask: pip install 'physid[dask]'") from None
    if not scheduler:
        raise ClusterError("the backend dask needs the address of a scheduler: --scheduler tcp://HOST:8786")
    try:
        client = Client(scheduler, timeout=ANSWER, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterError(f"no Dask scheduler answers at {scheduler} within {ANSWER:g} s: {error}") from None
    if not client.scheduler_info(n_workers=-1)["workers"]:
        client.close()
        raise _no_workers(scheduler)
    return client


def _no_workers(scheduler: str) -> ClusterError:
    return ClusterError(f"the scheduler at {scheduler} has no workers: start some with `dask worker {scheduler}`")


def _require_same_source(client: Any, scheduler: str) -> None:
    """Raise if a worker runs another version of physid than this process; those that die when asked take no part."""
    mine, asked = source(), client.run(source, on_error="return")
    answers = {worker: each for worker, each in asked.items() if not isinstance(each, OSError)}  # CommClosedError
    if not answers:
        raise _no_workers(scheduler)
    for worker, theirs in answers.items():
        if isinstance(theirs, Exception):
            raise theirs
        if theirs != mine:
            raise ClusterError(
                f"the worker {worker} runs physid {_name(theirs)}, this process {_name(mine)}: make them equal"
            )


def _name(version: Source) -> str:
    """Return version and commit in a few words."""
    return f"{version.version} ({(version.commit or 'no commit')[:12]}{', changed' if version.changed else ''})"
