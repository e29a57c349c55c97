"""What only the simulator knows. Generation, scoring, tests and the plot of truth beside estimate alone read this."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import yaml

from physid.data.files import write_text
from physid.typed_files import CLOSED, read_yaml_as

FILE = "truth.yaml"
FORMAT, VERSION = "physid-truth", 1


@dataclass(frozen=True)
class Truth:
    """True parameters and effects of a recording set, and how it was made.

    Attributes:
        parameters: True values by name ("block.friction").
        effects: Values of the parameters of each withheld effect, by the effect's name.
        generation: The resolved configuration that made the set.
    """

    parameters: Mapping[str, float]
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    generation: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class _TruthFile:
    """The content of truth.yaml."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    format: Literal["physid-truth"]
    version: Literal[1]
    parameters: dict[str, float]
    effects: dict[str, dict[str, float]]
    generation: dict[str, Any]


def read_truth(place: Path | str) -> Truth | None:
    """Read the truth of a recording set, or None where there is none (real recordings).

    Args:
        place: The folder of the set, or a truth file stored elsewhere.

    Raises:
        ValueError: If the file breaks the format.
    """
    path = Path(place) / FILE if Path(place).is_dir() else Path(place)
    if not path.is_file():
        return None
    known = read_yaml_as(_TruthFile, path)
    return Truth(known.parameters, known.effects, known.generation)


def write_truth(path: Path, truth: Truth) -> None:
    """Write the truth to a file, whole or not at all."""
    values = {
        "format": FORMAT,
        "version": VERSION,
        "parameters": dict(truth.parameters),
        "effects": {name: dict(effect) for name, effect in truth.effects.items()},
        "generation": dict(truth.generation),
    }
    write_text(path, yaml.safe_dump(values, sort_keys=False, default_flow_style=None, width=120))
