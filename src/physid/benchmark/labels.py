"""The sealed labels of a bank. Sealing writes them, scoring and calibration read them, a diagnosis never does."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from physid.benchmark.bank import FILE as BANK
from physid.benchmark.bank import SEALED, Bank, read_bank, seal_of
from physid.benchmark.sealing.hidden import Role
from physid.data.files import read_json, write_text
from physid.strict import quoted, seen
from physid.typed_files import CLOSED, check_as

FILE = "labels.json"
MOST_NAMED = 5  # sets that a message names


@dataclass(frozen=True)
class Part:
    """One hidden effect.

    Attributes:
        name: Its name.
        site: Where it acts.
        parameters: Its true size.
        severity: How much it shows alone (see `severity`).
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    name: str
    site: str
    parameters: dict[str, float]
    severity: float

    def __post_init__(self) -> None:
        for name in (self.name, self.site, *self.parameters):
            seen(name, "a name in a label")


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
        simulator: Who made its motions.
        frame_rate: Frames per second [Hz].
        uneven: Whether its stamps wander and frames are missing.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    role: Role
    scene: str
    protocol: str
    effects: tuple[Part, ...] = ()
    right: tuple[tuple[str, ...], ...] = ()
    severity: float = 0.0
    phases: tuple[str, ...] = ()
    noise: float = 0.0
    parameters: dict[str, float] = field(default_factory=dict)
    film: bool = False
    simulator: str = "pybullet"
    frame_rate: float = 240.0
    uneven: bool = False

    def __post_init__(self) -> None:
        names = (name for right in self.right for name in right)
        for name in (self.scene, self.protocol, self.simulator, *self.phases, *self.parameters, *names):
            seen(name, "a name in a label")

    def to_mapping(self) -> dict[str, Any]:
        """Return the label as plain values."""
        plain: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return plain


@dataclass(frozen=True)
class _Labels:
    """The content of labels.json."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    salt: str
    sets: dict[str, Label]


def write_labels(folder: Path, labels: Mapping[str, Label], salt: str) -> str:
    """Write the labels of a bank and return their seal."""
    values = {"salt": salt, "sets": {name: label.to_mapping() for name, label in sorted(labels.items())}}
    write_text(folder / SEALED / FILE, json.dumps(values, indent=1) + "\n")
    return seal_of(values)


def open_labels(bank: Bank) -> dict[str, Label]:
    """Open the labels of a bank.

    Raises:
        ValueError: If they do not fit the seal that was published with the recordings, or are not those of its sets.
        FileNotFoundError: If there are none.
    """
    path = bank.folder / SEALED / FILE
    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected the sealed labels, found none; they belong to {bank.folder}")
    values = read_json(path, "the sealed labels")
    if seal_of(values) != bank.seal:
        raise ValueError(
            f"{path}: expected labels with SHA-256 {bank.seal[:12]}..., found {seal_of(values)[:12]}...: "
            "they were changed after the bank was sealed; seal a new one"
        )
    labels = check_as(_Labels, values, str(path)).sets
    apart = sorted(set(labels) ^ set(read_bank(bank.folder).sets))  # of the whole bank: it may be scored so far
    if apart:
        raise ValueError(
            f"{path}: expected a label for each set of the bank and no other, found a difference in "
            f"{', '.join(map(quoted, apart[:MOST_NAMED]))}{', ...' if len(apart) > MOST_NAMED else ''}; labels and "
            f"{BANK} must be of one sealing"
        )
    return labels
