"""The figures of the design, from judged sets."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np

from physid.benchmark.scoring.intervals import (
    bootstrap_calibration_error,
    bootstrap_half_power,
    bootstrap_median,
    calibration_error,
    half_power,
    wilson,
)
from physid.benchmark.scoring.judging import BINS, MEDIUM, STRONG, Judged, bin_of
from physid.benchmark.sealing.hidden import TOGETHER

PERCENT = "%"


@dataclass(frozen=True)
class Figure:
    """One figure with its interval.

    Attributes:
        name: What was measured.
        value: Its value; None where no set tells.
        unit: Its unit.
        count: Sets (or intervals) behind it.
        low: Lower end of its 95 % interval, if it has one.
        high: Upper end.
        good: What is good, in words of the same unit.
        wanted: What is wanted.
    """

    name: str
    value: float | None
    unit: str
    count: int
    low: float | None = None
    high: float | None = None
    good: str = ""
    wanted: str = ""

    def row(self) -> tuple[str, ...]:
        """Return the cells of the table."""
        interval = "" if self.low is None or self.high is None else f"{self.low:.3g} to {self.high:.3g}"
        value = "none" if self.value is None else f"{self.value:.3g}"
        return self.name, value, self.unit, interval, str(self.count), self.good, self.wanted


HEADER = ("figure", "value", "unit", "95 % interval", "sets", "good", "wanted")


def share(name: str, outcomes: Iterable[bool], good: str = "", wanted: str = "") -> Figure:
    """Return a share in percent with its Wilson interval."""
    values = list(outcomes)
    if not values:
        return Figure(name, None, PERCENT, 0, None, None, good, wanted)
    low, high = wilson(sum(values), len(values))
    value = 100 * sum(values) / len(values)
    return Figure(name, value, PERCENT, len(values), 100 * low, 100 * high, good, wanted)


def middle(name: str, values: Sequence[float], unit: str, good: str = "", wanted: str = "") -> Figure:
    """Return a median with its bootstrap interval."""
    if not values:
        return Figure(name, None, unit, 0, None, None, good, wanted)
    return Figure(name, median(values), unit, len(values), *bootstrap_median(values), good, wanted)


def figures(judged: Sequence[Judged]) -> list[Figure]:
    """Compute all figures of the diagnosis itself."""
    free = [one for one in judged if one.label.role == "free"]
    hidden = [one for one in judged if one.label.role != "free"]
    shown = [one for one in hidden if one.label.severity >= MEDIUM]
    known = [one for one in shown if one.label.right and one.label.role not in TOGETHER]
    plain = [one for one in known if one.label.role in ("catalogue", "native")]
    alone = [one for one in hidden if not one.label.right and one.label.severity >= STRONG]
    pairs, triples = (
        [one for one in judged if one.label.role == role and one.least >= MEDIUM] for role in ("pair", "triple")
    )
    gaps = [one for one in shown if one.label.right]
    effects = [hit for one in judged for hit in one.covered[0]]
    others = [hit for one in judged for hit in one.covered[1]]
    return [
        share("false alarms on effect-free sets", (one.verdict != "none" for one in free), "<= 5", "<= 1"),
        share("flagged, medium and up", (one.flagged for one in shown)),
        share("group accuracy, medium and up", (one.grouped for one in known), ">= 95", ">= 98"),
        share("exact accuracy, medium and up", (one.exact for one in plain), ">= 85", ">= 93"),
        share("a cause blamed that is not there", (one.astray for one in judged), "", "<= 3"),
        share("recall of unknown, strong", (one.exact for one in alone), ">= 80", ">= 95"),
        share("coverage of 90 % intervals, effects", effects, "80 to 97", "87 to 93"),
        share("coverage of 90 % intervals, scene", others, "80 to 97", "87 to 93"),
        share("site right, medium and up", (bool(one.site) for one in shown if one.site is not None), ">= 90", ">= 97"),
        share("phase right, medium and up", (bool(one.phase) for one in shown if one.phase is not None)),
        middle("closed on the same protocol", _known(one.same for one in gaps), "-"),
        middle("closed on transfer", _known(one.transfer for one in gaps), "-", ">= 0.85", ">= 0.95"),
        share("both parts of a pair", (one.grouped for one in pairs), ">= 60", ">= 80"),
        share("two of three", (one.parts >= 2 for one in triples), ">= 60", ">= 80"),
        _calibration(judged),
        _power(hidden),
        middle("time per diagnosis", _known(one.seconds for one in judged), "s", "<= 300", "<= 30"),
        middle("work per diagnosis, one processor", _known(one.cpu_seconds for one in judged), "s"),
        Figure(
            "most work for a diagnosis", max(_known(one.cpu_seconds for one in judged), default=None), "s", len(judged)
        ),
        share("diagnoses that failed", (one.verdict == "failed" for one in judged)),
    ]


def by_role(judged: Sequence[Judged]) -> list[tuple[str, ...]]:
    """Return a table: role, sets, flagged, exact, group."""
    return _table("role", judged, lambda one: one.label.role)


def by_severity(judged: Sequence[Judged]) -> list[tuple[str, ...]]:
    """Return a table: severity, sets, flagged, exact, group."""
    hidden = [one for one in judged if one.label.role != "free"]
    return _table("severity", hidden, lambda one: bin_of(one.label.severity), BINS)


def by_scene(judged: Sequence[Judged]) -> list[tuple[str, ...]]:
    """Return a table: scene and protocol, sets, flagged, exact, group; of sets that are free, or medium and up."""
    clear = [one for one in judged if one.label.role == "free" or one.label.severity >= MEDIUM]
    return _table("scene", clear, lambda one: f"{one.label.scene}, {one.label.protocol}")


def by_recording(judged: Sequence[Judged]) -> list[tuple[str, ...]]:
    """Return a table: simulator, frame rate, stamps, free or hidden, sets and shares; hidden ones of medium and up."""
    clear = [one for one in judged if one.label.role == "free" or one.label.severity >= MEDIUM]
    parts: tuple[Callable[[Judged], str], ...] = (
        lambda one: one.label.simulator,
        lambda one: f"{one.label.simulator}, {one.label.frame_rate:.0f} Hz",
        lambda one: f"{one.label.simulator}, {'uneven' if one.label.uneven else 'even'} stamps",
        lambda one: f"{one.label.simulator}, {one.label.scene}",
    )

    def free(one: Judged) -> str:
        return "free" if one.label.role == "free" else "hidden"

    def table(part: Callable[[Judged], str]) -> list[tuple[str, ...]]:
        return _table("recorded by", clear, lambda one: f"{part(one)}, {free(one)}")

    return [table(parts[0])[0], *(row for part in parts for row in table(part)[1:])]


def by_source(judged: Sequence[Judged]) -> list[tuple[str, ...]]:
    """Return a table: poses or films, free or hidden, sets, flagged, exact, group; hidden ones of medium and up."""

    def source(one: Judged) -> str:
        return f"{'films' if one.label.film else 'poses'}, {'free' if one.label.role == 'free' else 'hidden'}"

    clear = [one for one in judged if one.label.role == "free" or one.label.severity >= MEDIUM]
    return _table("source", clear, source)


def by_effect(judged: Sequence[Judged]) -> list[tuple[str, ...]]:
    """Return a table: each set of medium severity and up that was not answered well, and each false alarm."""
    wrong = [one for one in judged if not one.grouped and (one.label.role == "free" or one.label.severity >= MEDIUM)]
    rows: list[tuple[str, ...]] = [("hidden", "scene", "severity", "verdict", "blamed", "group")]
    for one in sorted(wrong, key=lambda one: (one.label.role, truth_of(one))):
        cells = (f"{one.label.scene}, {one.label.protocol}", f"{one.label.severity:.2g}", one.verdict)
        rows.append((truth_of(one), *cells, " + ".join(one.named), ", ".join(one.group)))
    return rows


def truth_of(one: Judged) -> str:
    """Return what is hidden in a set, in one word."""
    return " + ".join(sorted(part.name for part in one.label.effects)) or "none"


def _table(
    title: str, judged: Sequence[Judged], key: Callable[[Judged], str], order: Sequence[str] = ()
) -> list[tuple[str, ...]]:
    groups: Mapping[str, list[Judged]] = {name: [] for name in order}
    groups = {**groups, **{key(one): [] for one in judged if key(one) not in groups}}
    for one in judged:
        groups[key(one)].append(one)
    rows: list[tuple[str, ...]] = [(title, "sets", "flagged %", "exact %", "group %", "astray %")]
    for name in order or sorted(groups):
        members = groups[name]
        shares = ([getattr(one, name) for one in members] for name in ("flagged", "exact", "grouped", "astray"))
        cells = (f"{100 * sum(each) / len(each):.0f}" if each else "" for each in shares)
        rows.append((name, str(len(members)), *cells))
    return rows


def reliability(judged: Sequence[Judged]) -> list[tuple[float, bool]]:
    """Return confidence and whether the verdict was right, of all sets that are free, or medium and up.

    Several effects are right if all of them are there.
    """
    clear = (one for one in judged if one.label.role == "free" or one.label.severity >= MEDIUM)
    return [(one.confidence, one.grouped and not one.astray) for one in clear if one.verdict != "failed"]


def _calibration(judged: Sequence[Judged]) -> Figure:
    """Return the mean distance of confidence and share of right verdicts."""
    name, pairs = "calibration error of confidence", reliability(judged)
    if not pairs:
        return Figure(name, None, PERCENT, 0)
    confidence, right = np.array(pairs, dtype=float).T
    low, high = bootstrap_calibration_error(confidence, right)
    return Figure(name, 100 * calibration_error(confidence, right), PERCENT, len(pairs), 100 * low, 100 * high)


def _power(hidden: Sequence[Judged]) -> Figure:
    """Return the severity at which half of all hidden effects are flagged."""
    severities, seen = [one.label.severity for one in hidden], [one.flagged for one in hidden]
    interval = bootstrap_half_power(severities, seen) if hidden else None
    low, high = interval or (None, None)
    return Figure("severity at 50 % power", half_power(severities, seen), "noise", len(hidden), low, high)


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]
