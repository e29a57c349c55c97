"""The sealed labels of a bank. Sealing writes them, scoring and calibration read them, a diagnosis never does."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from physid.benchmark.bank import SEALED, Bank, seal_of
from physid.benchmark.sealing.hidden import Role
from physid.data.files import write_text

FILE = "labels.json"


@dataclass(frozen=True)
class Part:
    """One hidden effect.

    Attributes:
        name: Its name.
        site: Where it acts.
        parameters: Its true size.
        severity: How much it shows alone (see `severity`).
    """

    name: str
    site: str
    parameters: Mapping[str, float]
    severity: float


@dataclass(frozen=True)
class Label:
    """The truth about one set.

    Attributes:
        role: What the set is for.
        scene: Its scene.
        protocol: The protocol of all but the transfer split.
        effects: What is hidden.
        right: The sets of names each of which is a right answer; none for `none` and `unknown`.
        severity: How much all effects show together.
        phases: Where they act.
        noise: Standard deviation of the noise of each coordinate of a position [m].
        parameters: True values of the scene's parameters.
        film: Whether the set has films instead of poses; the noise is then what a reader errs.
    """

    role: Role
    scene: str
    protocol: str
    effects: tuple[Part, ...] = ()
    right: tuple[tuple[str, ...], ...] = ()
    severity: float = 0.0
    phases: tuple[str, ...] = ()
    noise: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    film: bool = False

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Label:
        """Build a label from what `to_mapping` gave."""
        parts = tuple(Part(**part) for part in values["effects"])
        right = tuple(tuple(names) for names in values["right"])
        return cls(**{**values, "effects": parts, "right": right, "phases": tuple(values["phases"])})

    def to_mapping(self) -> dict[str, Any]:
        """Return the label as plain values."""
        plain: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return plain


def write_labels(folder: Path, labels: Mapping[str, Label], salt: str) -> str:
    """Write the labels of a bank and return their seal."""
    values = {"salt": salt, "sets": {name: label.to_mapping() for name, label in sorted(labels.items())}}
    write_text(folder / SEALED / FILE, json.dumps(values, indent=1) + "\n")
    return seal_of(values)


def open_labels(bank: Bank) -> dict[str, Label]:
    """Open the labels of a bank.

    Raises:
        ValueError: If they do not fit the seal that was published with the recordings.
        FileNotFoundError: If there are none.
    """
    path = bank.folder / SEALED / FILE
    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected the sealed labels, found none; they belong to {bank.folder}")
    values = json.loads(path.read_text(encoding="utf-8"))
    if seal_of(values) != bank.seal:
        raise ValueError(
            f"{path}: expected labels with SHA-256 {bank.seal[:12]}..., found {seal_of(values)[:12]}...: "
            "they were changed after the bank was sealed; seal a new one"
        )
    return {name: Label.from_mapping(label) for name, label in values["sets"].items()}
