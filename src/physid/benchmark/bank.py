"""A bank: what it shall be, and where its parts lie."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import yaml

from physid.data.files import write_text
from physid.strict import LARGEST, quoted, seen, whole
from physid.typed_files import CLOSED, read_yaml_as

Purpose = Literal["score", "calibration"]
FORMAT, VERSION = "physid-bank", 1
FILE, SETS, VERDICTS, SEALED = "bank.yaml", "sets", "verdicts", "sealed"


@dataclass(frozen=True)
class Size:
    """How large a bank is.

    Attributes:
        sets: Recording sets.
        trajectories: Trajectories of each.
        steps: Frames of each trajectory.
    """

    sets: int = 150
    trajectories: int = 24
    steps: int = 300

    def __post_init__(self) -> None:
        whole(self.sets, "sets", low=1, high=LARGEST["sets"])
        whole(self.trajectories, "trajectories", low=6, high=LARGEST["trajectories"])
        whole(self.steps, "steps", low=60, high=LARGEST["steps"])


QUICK = Size(sets=15, trajectories=12, steps=120)


@dataclass(frozen=True)
class Recorder:
    """Who recorded a set, and how often.

    Attributes:
        simulator: Name of the simulator.
        frame_rate: Frames per second [Hz].
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    simulator: str
    frame_rate: float

    def __post_init__(self) -> None:
        seen(self.simulator, "simulator")


@dataclass(frozen=True)
class Bank:
    """What everybody may know of a bank; nothing of it depends on what is hidden.

    Attributes:
        folder: Where it lies.
        purpose: score, or calibration: the thresholds that ship come from calibration banks alone.
        sets: SHA-256 of each recording set, by name.
        seal: SHA-256 of the labels with their salt.
        recorded: Simulator and frame rate of each recording set, by name; empty for banks that do not say.
    """

    folder: Path
    purpose: Purpose
    sets: Mapping[str, str]
    seal: str
    recorded: Mapping[str, Recorder] = field(default_factory=dict)

    def recordings(self, name: str) -> Path:
        """Return the folder of a recording set."""
        return self.folder / SETS / name

    def verdict(self, name: str) -> Path:
        """Return the folder of the diagnosis of a set."""
        return self.folder / VERDICTS / name


@dataclass(frozen=True)
class _BankFile:
    """The content of bank.yaml."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    format: Literal["physid-bank"]
    version: Literal[1]
    purpose: Purpose
    seal: str
    sets: dict[str, str]
    recorded: dict[str, Recorder] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.sets:
            raise ValueError("sets: expected one recording set at least, found none")
        strange = [name for name in self.sets if not re.fullmatch(r"[\w-]+", name)]
        if strange:
            raise ValueError(f"sets: expected plain names, which are folders of the bank, found {quoted(strange[0])}")


def write_bank(bank: Bank) -> None:
    """Write bank.yaml, whole or not at all."""
    values: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "purpose": bank.purpose,
        "seal": bank.seal,
        "sets": dict(bank.sets),
    }
    if bank.recorded:
        values["recorded"] = {name: asdict(how) for name, how in bank.recorded.items()}
    write_text(bank.folder / FILE, yaml.safe_dump(values, sort_keys=False, width=200))


def read_bank(folder: Path) -> Bank:
    """Read bank.yaml.

    Raises:
        FileNotFoundError: If there is no sealed bank.
        ValueError: If the file breaks the format.
    """
    path = folder / FILE
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: expected a sealed bank, found none; make one: physid benchmark diagnosis seal --out {folder}"
        )
    known = read_yaml_as(_BankFile, path)
    return Bank(folder, known.purpose, known.sets, known.seal, known.recorded)


def seal_of(labels: Mapping[str, Any]) -> str:
    """Return the SHA-256 of labels, salt included, in their one canonical spelling."""
    return hashlib.sha256(json.dumps(labels, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
