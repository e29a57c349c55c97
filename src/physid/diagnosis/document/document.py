"""diagnosis.json as a typed model, written and read with a check."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args

from annotated_types import Ge, Le, MinLen

from physid.data.files import write_text
from physid.diagnosis.document.errors import Allowed as Allowed
from physid.diagnosis.document.errors import Errors as Errors
from physid.diagnosis.document.errors import Gap as Gap
from physid.diagnosis.document.errors import Impacts as Impacts
from physid.diagnosis.document.errors import Positive, Text
from physid.diagnosis.document.errors import Rotations as Rotations
from physid.diagnosis.document.evidence import Evidence
from physid.diagnosis.document.residual_law import ResidualLaw
from physid.inspection.finding import Finding
from physid.physics import Site
from physid.typed_files import CLOSED, check_as, read_json_as

FILE = "diagnosis.json"
FORMAT: Literal["physid-diagnosis"] = "physid-diagnosis"
VERSION: Literal[2] = 2
SUM_TOLERANCE = 0.02  # shares of four sites, each rounded to two digits

Verdict = Literal["none", "named", "group", "partial", "unknown"]
Split = Literal["same", "transfer"]
Dof = Literal["x", "y", "z", "rx", "ry", "rz"]
Phase = Literal[
    "rest", "stick", "slide_slow", "slide_fast", "coast",
    "force_switch", "impact", "contact_between_objects", "free_fall",
]  # fmt: skip
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
SITES: tuple[Site, ...] = ("perception", "actuation", "dynamics", "contact")
SPLITS: tuple[Split, ...] = get_args(Split)
DOFS: tuple[Dof, ...] = get_args(Dof)
PHASES: tuple[Phase, ...] = get_args(Phase)

Probability = Annotated[float, Ge(0), Le(1)]
Names = Annotated[tuple[Text, ...], MinLen(1)]


@dataclass(frozen=True)
class Share:
    """The part of a gap that closes, with its 90 % interval; None where there are too few trajectories for one."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    value: float
    low: float | None
    high: float | None

    def __post_init__(self) -> None:
        if self.low is not None and self.high is not None:
            _require_order(self.low, self.value, self.high)


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 90 % interval."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    value: float
    low: float
    high: float
    unit: str

    def __post_init__(self) -> None:
        _require_order(self.low, self.value, self.high)


@dataclass(frozen=True)
class FoundEffect:
    """An effect that is blamed, where it acts, and its size."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    name: Text
    site: Site
    parameters: dict[str, Estimate]


@dataclass(frozen=True)
class Ranked:
    """A candidate: the squared residual that it explains, in standard deviations of the noise, and its p-value."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    effects: Names
    score: float
    p_value: Probability


@dataclass(frozen=True)
class Minor:
    """What was significant and is not blamed, as it moves predictions by less than the tolerance.

    `closes` is its share of the excess, as mean squares; beside a cause, of the squared residual that both explain.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    effects: tuple[Text, ...]
    p_value: Probability
    closes: Probability


@dataclass(frozen=True)
class Detectable:
    """The least size of one parameter of an effect, beside null for the others, that would have been found.

    Sizes, `typical` in practice too, are distances from null; None where none within the range would have been found.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    effect: Text
    parameter: Text
    size: Positive | None
    typical: Positive
    unit: Text


@dataclass(frozen=True)
class Cell:
    """Evidence for a residual wrench in one phase of the motion, on one body, along one degree of freedom."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    phase: Phase
    body: Text
    dof: Dof
    evidence: float


@dataclass(frozen=True)
class Where:
    """Shares of the evidence by site, the cells of the map, strongest first, and shares by phase of what effects do.

    Phases divide the evidence where nothing is blamed. There are none where effects only change what is seen.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    site: dict[Site, Probability]
    cells: tuple[Cell, ...]
    phase: dict[Phase, Probability] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if set(self.site) != set(SITES):
            raise ValueError(f"site: expected the keys {', '.join(SITES)}, found {', '.join(self.site) or 'none'}")
        for name, shares in (("site", self.site), ("phase", self.phase)):
            if (total := sum(shares.values())) and abs(total - 1) > SUM_TOLERANCE:
                raise ValueError(f"{name}: expected shares with sum 1 (or all 0), found sum {total:g}")


@dataclass(frozen=True)
class Shrink:
    """The share of the gap that closes on each split (None: none, or too near to its floor), cut into effects."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    same: Share | None
    transfer: Share | None
    parts: dict[Split, dict[Text, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Refitted:
    """An unknown parameter of the nominal model, refitted without and with the effects."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    nominal: float
    with_effect: Estimate | None


@dataclass(frozen=True)
class Diagnosis:
    """What a diagnosis says: the content of diagnosis.json.

    Attributes:
        format: Name of the format; version: its version; verdict: what is said of the gap.
        effects: What is blamed; group: effects that cannot be distinguished, the blamed ones included.
        confidence: Calibrated probability that the verdict is right: that of the causes that it allows, together.
        ranking: The candidates, best first; minor: what was significant and is not blamed.
        where: Where the gap lies; gap: errors before and after; shrink: the share of the gap that closes.
        parameters: The unknown parameters by name; next_experiment: what would distinguish the members of a group.
        detectable: Which size of each effect, beside those blamed, would have been found.
        settings: What decided: thresholds by section and name; empty where the file does not say.
        causes: Probability of each cause (see `Evidence`), the most probable first; evidence: what they follow from.
        residual: What a better model would have to add; excess: size of the gap as scores measure it, if known.
        null_simulations: How many; seconds: how long it took.
        findings: What looks like a mistake in the recordings, or is odd, by the rules of `physid check` and by the fit.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    format: Literal["physid-diagnosis"]
    version: Literal[2]
    verdict: Verdict
    effects: tuple[FoundEffect, ...]
    group: tuple[Text, ...]
    confidence: Probability
    ranking: tuple[Ranked, ...]
    where: Where
    gap: Gap
    shrink: Shrink
    parameters: dict[str, Refitted]
    next_experiment: Text | None
    minor: tuple[Minor, ...]
    detectable: tuple[Detectable, ...] = ()
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)
    causes: dict[Text, Probability] = field(default_factory=dict)
    evidence: Evidence | None = None
    residual: tuple[ResidualLaw, ...] = ()
    excess: Positive | None = None
    null_simulations: int | None = None
    seconds: Positive | None = field(default=None, compare=False)
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        """Check that effects and group fit the verdict, and shares the splits that there are."""
        names, verdict = self.blamed, self.verdict
        if verdict in ("none", "unknown"):
            _require(not names and not self.group, f"effects, group: expected none for the verdict {verdict!r}")
        else:
            _require(bool(names), f"effects: expected at least one for the verdict {verdict!r}")
            outside = [name for name in names if name not in self.group]
            _require(not outside, f"group: expected the effects themselves among its members, found no {outside}")
            alone = verdict == "group" and len(self.group) <= len(names)
            _require(not alone, "group: expected members beside the effects for the verdict 'group'")
        empty = self.gap.transfer is not None or self.shrink.transfer is None
        _require(empty, "shrink.transfer: expected null, since there is no gap.transfer")

    @property
    def blamed(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(effect.name for effect in self.effects)

    @property
    def references(self) -> tuple[str, ...]:
        """The simulators that made the null simulations; none where an older file does not say."""
        return tuple(self.settings.get("replay", {}).get("simulators", ()))

    def errors(self, split: Split) -> Errors | None:
        """Return the errors on a split, None where there is none."""
        return self.gap.same if split == "same" else self.gap.transfer

    def shown(self, split: Split) -> tuple[Errors, float, str] | None:
        """Return errors, floor and unit of what shows the gap on a split, positions or rotations; None without it."""
        errors, turned = self.errors(split), self.gap.rotations
        rotations = None if turned is None else turned.same if split == "same" else turned.transfer
        if rotations is not None and turned is not None:
            return rotations, turned.floor, "rad"
        return None if errors is None else (errors, self.gap.floor, self.gap.unit)

    def share(self, split: Split) -> Share | None:
        """Return the share of the gap that closes on a split."""
        return self.shrink.same if split == "same" else self.shrink.transfer

    def to_mapping(self) -> dict[str, Any]:
        """Return the content of the file as plain values; what is optional and not known is left out."""
        optional = ("settings", "causes", "evidence", "residual", "excess", "null_simulations", "seconds", "findings")
        made = {name: value for name, value in asdict(self).items() if value or name not in optional}
        made["gap"] = {name: value for name, value in made["gap"].items() if value is not None or name == "transfer"}
        return made


def check_diagnosis(content: object) -> Diagnosis:
    """Check that parsed JSON says what a diagnosis must say, in exactly the agreed form.

    Raises:
        ValueError: If anything is wrong; names every fault, what was expected and what came.
    """
    return check_as(Diagnosis, content, FILE)


def write_diagnosis(folder: Path, diagnosis: Diagnosis) -> Path:
    """Write diagnosis.json into a folder, which is made if it is not there; returns the file."""
    path = folder / FILE
    write_text(path, json.dumps(diagnosis.to_mapping(), indent=1, allow_nan=False) + "\n")
    return path


def read_diagnosis(path: Path) -> Diagnosis:
    """Read diagnosis.json.

    Raises:
        ValueError: If the file is no JSON, or no diagnosis; names the file.
    """
    return read_json_as(Diagnosis, path)


def _require_order(low: float, value: float, high: float) -> None:
    _require(low <= value <= high, f"expected low <= value <= high, found {low:g}, {value:g}, {high:g}")


def _require(fine: bool, message: str) -> None:
    if not fine:
        raise ValueError(message)
