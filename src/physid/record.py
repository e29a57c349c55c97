"""What a run depended on besides its configuration: versions, source, data, machine; enough to repeat it elsewhere."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, ClassVar

from physid.typed_files import CLOSED, read_json_as

RECORD = "record.json"
COMMIT = "PHYSID_COMMIT"  # an image has no repository: its build says here what it was made from
THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "CUDA_VISIBLE_DEVICES")


@dataclass(frozen=True)
class Source:
    """The version of physid that ran, its commit (None outside of a repository), and whether files differ from it."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    version: str
    commit: str | None
    changed: bool | None


@dataclass(frozen=True)
class Machine:
    """System, processor, cores that the process may use, memory [GB] and GPUs."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    system: str
    processor: str
    cores: int | None
    memory_gb: float
    gpus: tuple[str, ...]


@dataclass(frozen=True)
class Record:
    """The content of record.json.

    Attributes:
        started: When the run started, ISO 8601 in UTC.
        command: The command line.
        source: The version of physid.
        python: The version of Python.
        packages: Version of every package that is installed, by name.
        data: SHA-256 of the list of checksums of each recording set, by its folder: of what its files should hold.
        machine: Where it ran.
        threads: What the environment said of threads.
        earlier: The sessions that this one resumed, oldest first.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    started: str
    command: str
    source: Source
    python: str
    packages: dict[str, str]
    data: dict[str, str]
    machine: Machine
    threads: dict[str, str]
    earlier: tuple[Record, ...] = ()

    def to_mapping(self) -> dict[str, Any]:
        """Return the record as plain values; a session that resumed none says nothing of earlier ones."""
        plain = asdict(self)
        earlier = [one.to_mapping() for one in plain.pop("earlier") and self.earlier]
        return plain | ({"earlier": earlier} if earlier else {})


def write_record(folder: Path, values: Mapping[str, Any] | Record) -> None:
    """Write record.json into a run folder; the record of a session that is resumed is kept in it.

    Args:
        folder: Run folder.
        values: Resolved configuration; every recording set that it names is recorded by its checksum. Or what
            `describe` said of a run as it started, if the record is to be written once it has ended.

    Raises:
        ValueError: If the record of earlier sessions is damaged.
    """
    from physid.data.files import write_text

    path = folder / RECORD
    record = values if isinstance(values, Record) else describe(values)
    if path.is_file():
        before = read_json_as(Record, path)
        record = replace(record, earlier=(*before.earlier, replace(before, earlier=())))
    write_text(path, json.dumps(record.to_mapping(), indent=2) + "\n")


def describe(values: Mapping[str, Any]) -> Record:
    """Return what a run that starts now depends on.

    Args:
        values: Resolved configuration.
    """
    return Record(
        started=datetime.now(UTC).isoformat(timespec="seconds"),
        command=shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        source=source(),
        python=platform.python_version(),
        packages=packages(),
        data={name: checksum(Path(name)) for name in sorted(set(recording_sets(values)))},
        machine=machine(),
        threads={name: os.environ[name] for name in THREADS if name in os.environ},
    )


@cache
def packages() -> dict[str, str]:
    """Return the version of every package that is installed, by name; those of when a process first asks."""
    described = (each.metadata for each in metadata.distributions())  # a file that is parsed anew at each access
    found = {each["Name"]: each["Version"] for each in described}
    return dict(sorted(found.items(), key=lambda item: item[0].lower()))


def source() -> Source:
    """Return version, commit and whether a tracked file differs from it; commit None outside of a repository."""
    here = Path(__file__)
    version = metadata.version("physid")
    if _git(here.parent, "ls-files", "--error-unmatch", here.name) is None:
        return Source(version, os.environ.get(COMMIT), None)
    changed = _git(here.parent, "status", "--porcelain", "--untracked-files=no", "--", ".")
    return Source(version, _git(here.parent, "rev-parse", "HEAD"), bool(changed))


def recording_sets(values: Any) -> Iterator[str]:
    """Yield every string in a configuration that names the folder of a recording set."""
    from physid.data import DESCRIPTION

    if isinstance(values, Mapping):
        for value in values.values():
            yield from recording_sets(value)
    elif isinstance(values, list | tuple):
        for value in values:
            yield from recording_sets(value)
    elif (
        isinstance(values, str) and len(values) < 4096 and "\n" not in values and (Path(values) / DESCRIPTION).is_file()
    ):
        yield values


def checksum(folder: Path) -> str:
    """Return one SHA-256 for a recording set: of its SHA256SUMS, or of what would stand there.

    Args:
        folder: The recording set.

    Returns:
        Hexadecimal digits; the same wherever the set lies.

    Raises:
        ValueError: If SHA256SUMS is damaged.
    """
    from physid.data.format import SUMS, list_sums, read_sums

    text = read_sums(folder) if (folder / SUMS).is_file() else list_sums(folder)
    return hashlib.sha256(text.encode()).hexdigest()


def machine() -> Machine:
    """Return system, processor, cores this process may use, memory [GB] and GPUs."""
    import torch

    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    return Machine(
        system=platform.platform(),
        processor=_processor(),
        cores=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        memory_gb=round(memory, 1),
        gpus=tuple(torch.cuda.get_device_name(index) for index in range(torch.cuda.device_count())),
    )


def _processor() -> str:
    """Return the name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _git(folder: Path, *words: str) -> str | None:
    """Return what a git command prints; None where there is no git, or it fails."""
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *words], capture_output=True, text=True, timeout=20, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
