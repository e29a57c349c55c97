"""The results of scoring a bank: for a terminal, as JSON, as Markdown, as a page, as pictures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from physid.benchmark.bank import Bank
from physid.benchmark.scoring.figures import HEADER, Figure
from physid.benchmark.scoring.judging import Judged
from physid.benchmark.scoring.pictures import draw_confusion, draw_power, draw_reliability
from physid.data.files import write_picture, write_text
from physid.pages.templates import data_uri, render

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


def report(result: Score) -> str:
    """Lay the figures and tables out for a terminal."""
    parts = [columns([HEADER, *(figure.row() for figure in result.figures)])]
    parts += [f"{title}\n{columns(table)}" for title, table in result.tables.items() if len(table) > 1]
    return "\n\n".join(parts)


def write_score(bank: Bank, result: Score, out: Path) -> None:
    """Write results.json, results.md, results.html and the pictures."""
    pictures = {
        "confusion": write_picture(out / "confusion.png", draw_confusion(result.judged)),
        "power": write_picture(out / "power.png", draw_power(result.judged)),
        "reliability": write_picture(out / "reliability.png", draw_reliability(result.judged)),
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


def columns(table: Sequence[tuple[str, ...]]) -> str:
    """Lay a table out for a terminal."""
    widths = [max(len(row[k]) for row in table) for k in range(len(table[0]))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in table]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])


def _markdown(table: Sequence[tuple[str, ...]]) -> str:
    # What ends a cell, or begins a tag of HTML, is written as what it is: names come with the bank.
    lines = ["| " + " | ".join(cell.replace("|", r"\|").replace("<", "&lt;") for cell in row) + " |" for row in table]
    return "\n".join([lines[0], "|" + "---|" * len(table[0]), *lines[1:]])
