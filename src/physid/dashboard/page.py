"""The page itself: everything that the runs have left, in one HTML file that asks for nothing from outside."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from physid.dashboard.body import GROUPS, OBSERVED, with_body
from physid.dashboard.comparison import charts, tables
from physid.dashboard.folders import find_runs
from physid.dashboard.run import empty_run, read_or_damaged
from physid.dashboard.summary import Run, kind_of, numbers, text_of
from physid.data.files import PAGES, require_ending, write_text
from physid.pages.numbers import plural
from physid.pages.templates import render as render_page

COLUMNS = ("Parameter error", "Position error", "Rotation error", "Evaluations", "Time", "Date")
SORTED_BY = ("id", "result", "error", "position", "rotation", "evaluations", "seconds", "date")


def write_dashboard(folder: Path, out: Path, *, light: bool = False) -> list[dict[str, Any]]:
    """Write the page about every run in a folder.

    Args:
        folder: Where the runs lie.
        out: The HTML file to write.
        light: Whether to leave out films, images and reports.

    Returns:
        What it shows of each run.

    Raises:
        FileNotFoundError: If there is no run in the folder.
        ValueError: If the name of the file is not that of a page.
    """
    require_ending(out, *PAGES)
    runs = [read_or_damaged(each, folder, light=light) for each in find_runs(folder)]
    write_text(out, render(runs, folder.resolve().name))
    return runs


def render(runs: Sequence[Run], title: str) -> str:
    """Return the page as one HTML document; `runs` is what `read_run` has read, `title` is shown at the top."""
    shown = [_shown(run) for run in runs]
    kinds = Counter(run["kind"] for run in shown)
    return render_page(
        "dashboard.html",
        script="dashboard.js",
        title=title,
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        counts=[plural(count, kind) for kind, count in sorted(kinds.items())],
        kinds=dict(sorted(kinds.items())),
        runs=shown,
        columns=[name for name in COLUMNS if any(run["texts"][name] for run in shown)],
        keys=dict(zip(("Run", "Result", *COLUMNS), SORTED_BY, strict=True)),
        kind_of=kind_of,
        observed=OBSERVED,
        tables=tables(shown) if len(shown) > 1 else [],
        charts=charts(shown, GROUPS) if len(shown) > 1 else [],
        search=[
            {"id": run["id"], "kind": run["kind"], "date": run["date"], "result": run["short"] or run["sentence"]}
            | {"text": text_of(run), "numbers": numbers(run)}
            for run in shown
        ],
    )


def _shown(run: Run) -> dict[str, Any]:
    """Return a run with its part of the page; one whose files hold what nobody expects is shown as damaged."""
    try:
        return with_body(run)
    except Exception as error:  # whatever a stranger's files lead to
        reason = (str(error).splitlines() or [""])[0][:200]
        notes = [f"the run cannot be shown: {type(error).__name__}: {reason}"]
        return with_body(empty_run(run["id"]) | {"notes": notes})
