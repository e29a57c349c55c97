"""The page itself: data, style and script in one HTML file that asks for nothing from outside."""

from __future__ import annotations

import base64
import hashlib
import json
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from physid.dashboard.folders import find_runs
from physid.dashboard.run import read_or_damaged
from physid.data.files import write_text

SCRIPTS = (
    "elements.js",
    "numbers.js",
    "chart.js",
    "table.js",
    "sections.js",
    "diagnosis.js",
    "score.js",
    "compare.js",
    "page.js",
)


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
    """
    runs = [read_or_damaged(each, folder, light=light) for each in find_runs(folder)]
    write_text(out, render(runs, folder.resolve().name))
    return runs


def render(runs: list[dict[str, Any]], title: str) -> str:
    """Return the page.

    Args:
        runs: What `read_run` has read.
        title: Shown at the top.

    Returns:
        One HTML document.
    """
    made = datetime.now(UTC).isoformat(timespec="seconds")
    # `<` and friends as escapes: no text of a run can end the script element or begin a comment in it.
    data = json.dumps({"title": title, "made": made, "runs": runs}, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        data = data.replace(character, f"\\u{ord(character):04x}")
    script = '\n"use strict";\n(() => {\n' + "\n".join(_asset(name) for name in SCRIPTS) + "\n})();\n"
    # The policy names the one script that may run by its digest: whatever a run's files smuggle in does not.
    policy = f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}"
    return Template(_asset("page.html")).substitute(
        title=_escape(title), style=_asset("page.css"), script=script, data=data, policy=policy
    )


def _asset(name: str) -> str:
    return resources.files("physid.dashboard").joinpath("assets", name).read_text(encoding="utf-8")


def _escape(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;")
