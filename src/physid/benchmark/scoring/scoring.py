"""Open the labels, judge every verdict, and write the figures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from physid.benchmark.bank import Bank
from physid.benchmark.films import seen_poses
from physid.benchmark.labels import Label, open_labels
from physid.benchmark.scoring.baselines import answers
from physid.benchmark.scoring.compare import baseline_figures
from physid.benchmark.scoring.figures import (
    HEADER,
    Figure,
    by_effect,
    by_recording,
    by_role,
    by_scene,
    by_severity,
    by_source,
    figures,
)
from physid.benchmark.scoring.judging import Judged, judge
from physid.benchmark.scoring.pictures import draw_confusion, draw_power, draw_reliability, save
from physid.benchmark.verdicts import FAILURE, TIME, Spent, is_open
from physid.data.files import write_text
from physid.data.format import RecordingSet
from physid.diagnosis.document.document import FILE, read_diagnosis
from physid.pages.templates import data_uri, render
from physid.record import checksum
from physid.typed_files import read_json_as

Table = list[tuple[str, ...]]


@dataclass(frozen=True)
class Score:
    """How well a diagnosis does.

    Attributes:
        figures: The figures of the design.
        tables: Further tables, by title.
        judged: What became of each set.
    """

    figures: list[Figure]
    tables: dict[str, Table]
    judged: list[Judged]


def score(bank: Bank, out: Path) -> Score:
    """Score the verdicts on a bank, and write results.json, results.md, results.html and the pictures.

    Args:
        bank: The bank.
        out: Folder of the results.

    Returns:
        The score.

    Raises:
        ValueError: If a set has no verdict yet, a recording or the labels were changed after sealing.
    """
    judged, labels = open_judged(bank)
    said = {}
    for one in judged:
        if one.verdict != "failed":
            document = read_diagnosis(bank.verdict(one.name) / FILE)
            seen = RecordingSet(seen_poses(bank.recordings(one.name), bank.verdict(one.name)))
            said[one.name] = answers(seen, document, labels[one.name].noise)
    answered = [one for one in judged if one.name in said]
    tables = {
        "By role": by_role(judged),
        "By severity": by_severity(judged),
        "By scene, of sets that are free or of medium severity and up": by_scene(judged),
        "By simulator, of sets that are free or of medium severity and up": by_recording(judged),
        "By source, of sets that are free or of medium severity and up": by_source(judged),
        "Beside simpler methods": baseline_figures(answered, said),
        "Not answered well, of sets that are free or of medium severity and up": by_effect(judged),
    }
    result = Score(figures(judged), tables, judged)
    _write(bank, result, out)
    return result


def open_judged(bank: Bank) -> tuple[list[Judged], dict[str, Label]]:
    """Check that all verdicts are there and nothing was changed, then open the labels and judge."""
    waiting = [name for name in bank.sets if is_open(bank, name)]
    if waiting:
        raise ValueError(
            f"{bank.folder}: expected a verdict on each of the {len(bank.sets)} sets before the labels are opened, "
            f"found none on {len(waiting)} ({', '.join(waiting[:3])}{', ...' if len(waiting) > 3 else ''}); "
            f"first: physid benchmark diagnosis diagnose --bank {bank.folder}"
        )
    for name, mark in bank.sets.items():
        if checksum(bank.recordings(name)) != mark:
            raise ValueError(f"{bank.recordings(name)}: expected the recordings that were sealed, found others")
    labels = open_labels(bank)
    return [_judged(bank, name, labels[name]) for name in bank.sets], labels


def _judged(bank: Bank, name: str, label: Label) -> Judged:
    folder = bank.verdict(name)
    if (folder / FAILURE).is_file():
        return Judged(name, label, "failed")
    return judge(name, read_diagnosis(folder / FILE), label, read_json_as(Spent, folder / TIME))


def report(result: Score) -> str:
    """Lay the figures and tables out for a terminal."""
    parts = [_columns([HEADER, *(figure.row() for figure in result.figures)])]
    parts += [f"{title}\n{_columns(table)}" for title, table in result.tables.items() if len(table) > 1]
    return "\n\n".join(parts)


def _write(bank: Bank, result: Score, out: Path) -> None:
    """Write results.json, results.md, results.html and the pictures."""
    pictures = {
        "confusion": save(draw_confusion(result.judged), out / "confusion.png"),
        "power": save(draw_power(result.judged), out / "power.png"),
        "reliability": save(draw_reliability(result.judged), out / "reliability.png"),
    }
    values = {
        "bank": {"purpose": bank.purpose, "sets": len(bank.sets), "seal": bank.seal},
        "figures": [asdict(figure) for figure in result.figures],
        "tables": {title: [list(row) for row in table] for title, table in result.tables.items()},
        "sets": [asdict(one) for one in result.judged],
    }
    write_text(out / "results.json", json.dumps(values, indent=1) + "\n")
    tables = {"Figures": [HEADER, *(figure.row() for figure in result.figures)], **result.tables}
    title = f"physid benchmark diagnosis: {len(bank.sets)} sets ({bank.purpose})"
    markdown = "\n\n".join(f"## {name}\n\n{_markdown(table)}" for name, table in tables.items())
    write_text(out / "results.md", f"# {title}\n\nLabels: SHA-256 {bank.seal}\n\n{markdown}\n")
    drawn = [(name.capitalize(), data_uri("image/png", data)) for name, data in pictures.items()]
    page = render("score.html", title=title, seal=bank.seal, tables=tables, pictures=drawn)
    write_text(out / "results.html", page)


def _columns(table: Sequence[tuple[str, ...]]) -> str:
    widths = [max(len(row[k]) for row in table) for k in range(len(table[0]))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in table]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])


def _markdown(table: Sequence[tuple[str, ...]]) -> str:
    lines = ["| " + " | ".join(row) + " |" for row in table]
    return "\n".join([lines[0], "|" + "---|" * len(table[0]), *lines[1:]])
