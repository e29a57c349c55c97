"""Diagnose every set of a bank, from its recordings alone; resumable."""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

from physid.benchmark.bank import SEALED, Bank
from physid.benchmark.films import with_poses
from physid.data import RecordingSet
from physid.data.files import write_text
from physid.diagnosis.document.document import FILE, Diagnosis
from physid.progress.bar import progress_bar
from physid.typed_files import CLOSED

logger = logging.getLogger("physid")

TIME, FAILURE = "time.json", "failure.json"


@dataclass(frozen=True)
class Spent:
    """What the diagnosis of a set took: the content of time.json.

    Attributes:
        seconds: How long it took.
        cpu_seconds: How long a processor worked on it.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    seconds: float
    cpu_seconds: float | None = None


Diagnose = Callable[..., Diagnosis]
_closed: list[str] = []  # folders that no Python code of this process may open


def diagnose_bank(
    bank: Bank, workers: int = 1, *, diagnose: Diagnose | None = None, again: bool = False, quiet: bool = False
) -> tuple[int, int]:
    """Diagnose the sets that have no verdict yet.

    Each set is its own task. While one runs, its process cannot open what is sealed. A diagnosis that raises an error
    leaves failure.json instead of a verdict.

    Args:
        bank: The bank.
        workers: Processes.
        diagnose: What to test; `physid.diagnosis.diagnose.diagnose` by default.
        again: Whether to diagnose again what failed before.
        quiet: Whether to hide the progress bar.

    Returns:
        How many were diagnosed by this call, and how many of them failed.
    """
    import joblib

    missing = [name for name in bank.sets if is_open(bank, name, again=again)]
    jobs = (joblib.delayed(diagnose_set)(bank, name, diagnose) for name in missing)
    parallel = joblib.Parallel(n_jobs=workers, return_as="generator_unordered", batch_size=1)
    bar = progress_bar(parallel(jobs), quiet=quiet, total=len(missing), desc="diagnosing", smoothing=0)
    return len(missing), sum(not done for done in bar)


def is_open(bank: Bank, name: str, *, again: bool = False) -> bool:
    """Return whether a set still waits for its verdict."""
    folder = bank.verdict(name)
    failed = (folder / FAILURE).is_file() and not again
    return not (failed or ((folder / FILE).is_file() and (folder / TIME).is_file()))


def diagnose_set(bank: Bank, name: str, diagnose: Diagnose | None = None) -> bool:
    """Diagnose one set, films read first, and keep the time it took; tells whether it succeeded."""
    from physid.diagnosis.diagnose import diagnose as shipped

    tested: Diagnose = diagnose or shipped
    out = bank.verdict(name)
    begun, used = time.perf_counter(), time.process_time()
    try:
        with closed(bank.folder / SEALED):
            tested(RecordingSet(with_poses(bank.recordings(name), out)), out)
    except MemoryError:  # of this machine, and no verdict
        raise
    except Exception as error:  # whatever it is, the other sets of the bank get their verdicts
        if not isinstance(error, ValueError | RuntimeError | OSError):
            logger.exception("%s: a diagnosis failed in a way that nobody foresaw", name)
        write_text(out / FAILURE, json.dumps({"error": f"{type(error).__name__}: {error}"}) + "\n")
        return False
    (out / FAILURE).unlink(missing_ok=True)
    spent = Spent(time.perf_counter() - begun, time.process_time() - used)
    write_text(out / TIME, json.dumps(asdict(spent)) + "\n")
    return True


@contextmanager
def closed(folder: Path) -> Iterator[None]:
    """Let every attempt of this process to open or list something in a folder fail.

    Raises:
        PermissionError: At such an attempt.
    """
    if _refuse not in _hooked:
        sys.addaudithook(_refuse)
        _hooked.append(_refuse)
    _closed.append(str(folder.absolute()))
    try:
        yield
    finally:
        _closed.pop()


def _refuse(event: str, arguments: tuple[Any, ...]) -> None:
    """Look at what Python is about to open (PEP 578)."""
    if not _closed or event not in ("open", "os.listdir", "os.scandir") or not arguments:
        return
    if isinstance(arguments[0], str | Path | bytes):
        asked = Path(arguments[0].decode() if isinstance(arguments[0], bytes) else arguments[0]).absolute()
        if any(asked.is_relative_to(each) for each in _closed):
            raise PermissionError(f"{asked}: expected a diagnosis to see the recordings only, it asked for the labels")


_hooked: list[Callable[[str, tuple[Any, ...]], None]] = []  # an audit hook cannot be taken away: one is enough
