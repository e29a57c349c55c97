"""All runs side by side; the page shows those that are chosen."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain

from markupsafe import Markup

from physid.dashboard.summary import Run, direction
from physid.diagnosis.document.document import SPLITS, Diagnosis
from physid.diagnosis.document.sentences import SPLIT_NAMES, before_and_after, closed, estimate
from physid.pages.figures import Series, line_chart
from physid.pages.numbers import NOTHING, duration, error, named, percent, quantity, words


@dataclass(frozen=True)
class Row:
    """A line of a table with one cell for each run; None where a run has nothing to say.

    Attributes:
        name: What is compared.
        cells: Text and, where the best one shall stand out, the number of each run.
        sign: 1 where more is better, -1 where less is, 0 where neither.
        last: Further cells, the same for all runs.
    """

    name: str
    cells: tuple[tuple[str, float | None] | None, ...]
    sign: int = 0
    last: tuple[str, ...] = ()


@dataclass(frozen=True)
class Table:
    """A table of a comparison.

    Attributes:
        title: Its title.
        rows: Its lines.
        least: A line is shown where at least so many of the chosen runs say something.
        differ: Whether a line is shown only where the chosen runs differ.
        last: Titles of the further cells.
    """

    title: str
    rows: tuple[Row, ...]
    least: int = 1
    differ: bool = False
    last: tuple[str, ...] = ()


def tables(runs: Sequence[Run]) -> list[Table]:
    """Compare diagnoses, figures, results and settings; tables without any line are left out."""
    found = [
        Table("Diagnoses", tuple(_diagnoses(runs))),
        Table("Figures", tuple(_figures(runs))),
        Table("Results", tuple(_results(runs)), least=2, last=("Paper", "Target")),
        Table("Where the configurations differ", tuple(_settings(runs)), differ=True),
    ]
    return [each for each in found if each.rows]


def _diagnoses(runs: Sequence[Run]) -> Iterable[Row]:
    lines: dict[str, Callable[[Diagnosis], str]] = {
        "Verdict": lambda said: said.verdict,
        "Confidence": lambda said: percent(said.confidence),
        "Effects": lambda said: "; ".join(
            f"{words(effect.name)}, {name}: {estimate(value)}"
            for effect in said.effects
            for name, value in effect.parameters.items()
        ),
        "Not told apart": lambda said: ", ".join(map(words, said.group)) if len(said.group) > 1 else "",
        "Site": lambda said: ", ".join(
            f"{name} {percent(share)}" for name, share in said.where.site.items() if share >= 0.1
        ),
        "Time": lambda said: "" if said.seconds is None else duration(said.seconds),
    }
    for split in SPLITS:
        lines[f"Error, {SPLIT_NAMES[split]}"] = lambda said, split=split: _error(said, split)  # type: ignore[misc]
        lines[f"Closed, {SPLIT_NAMES[split]}"] = lambda said, split=split: (  # type: ignore[misc]
            " (".join(part) + ")" if (part := closed(said, split)) else ""
        )
    if any(run["diagnosis"] for run in runs):
        for name, say in lines.items():
            yield Row(
                name, tuple((say(run["diagnosis"]) or NOTHING, None) if run["diagnosis"] else None for run in runs)
            )


def _error(said: Diagnosis, split: str) -> str:
    shown = said.shown(split)  # type: ignore[arg-type]
    return "" if shown is None else before_and_after(shown[0], shown[2]).replace("->", "→")


def _figures(runs: Sequence[Run]) -> Iterable[Row]:
    errors = [{each["name"]: each["error"] for each in run["parameters"]} for run in runs]
    for name in _names(errors):
        known = (each.get(name) for each in errors)
        yield Row(f"{name}, relative error", tuple(None if one is None else (error(one), one) for one in known), -1)
    for name in _names(run["figures"] for run in runs):
        values = (run["figures"].get(name) for run in runs)
        yield Row(name, tuple(None if one is None else (named(name, one), one) for one in values), direction(name))


def _results(runs: Sequence[Run]) -> Iterable[Row]:
    mine = [{f"{cell['cell']}: {cell['metric']}": cell for cell in run["cells"]} for run in runs]
    for name in _names(mine):
        cells = [each.get(name) for each in mine]
        there = next(cell for cell in cells if cell)
        yield Row(
            name,
            tuple(None if cell is None else (_value(cell["value"], cell.get("unit"), 4), None) for cell in cells),
            last=tuple(_value(there.get(key), there.get("unit")) for key in ("paper", "target")),
        )


def _value(value: object, unit: str | None, digits: int = 3) -> str:
    return quantity(value, unit, digits) if isinstance(value, int | float) else NOTHING


def _settings(runs: Sequence[Run]) -> Iterable[Row]:
    for name in _names(run["settings"] for run in runs):
        yield Row(name, tuple((run["settings"].get(name, NOTHING), None) for run in runs))


def charts(runs: Sequence[Run], groups: Sequence[tuple[str, str]]) -> list[tuple[str, list[tuple[str, Markup]]]]:
    """Draw each parameter and each curve of all runs on one axis; a page hides the lines that are not asked for.

    Only what at least two runs have is drawn.
    """
    found = {"Parameters": {}, **{title: {} for _, title in groups}}  # type: dict[str, dict[str, list[Series]]]
    axes: dict[str, str] = {}
    truths: dict[str, set[float]] = {}
    for index, run in enumerate(runs):
        curves = [("Parameters", each) for each in run["parameters"]]
        curves += [(title, each) for group, title in groups for each in run["curves"] if each["group"] == group]
        for title, each in curves:
            if len(each["x"]) > 1:
                line = Series(run["id"], f"run{index}", each["x"], each["y"], key=f"r{index}")
                found[title].setdefault(each["name"], []).append(line)
                axes.setdefault(each["name"], each["axis"])
            if title == "Parameters" and each["true"] is not None:
                truths.setdefault(each["name"], set()).add(each["true"])

    def drawn(name: str, lines: list[Series]) -> Markup:
        return line_chart(lines, name, axes[name], truths=sorted(truths.get(name, ())), show=partial(named, name))

    several = {
        title: {name: one for name, one in sorted(known.items()) if len(one) > 1} for title, known in found.items()
    }
    return [
        (title, [(name, drawn(name, one)) for name, one in each.items()]) for title, each in several.items() if each
    ]


def _names(known: Iterable[Iterable[str]]) -> list[str]:
    return sorted(set(chain.from_iterable(known)))
