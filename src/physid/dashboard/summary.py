"""What the table of all runs says of each, and what it is sorted and filtered by."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from physid.diagnosis.document.document import SPLITS, Diagnosis
from physid.diagnosis.document.sentences import SPLIT_NAMES, before_and_after, closed, explains
from physid.diagnosis.document.sentences import kind_of as kind_of
from physid.pages.numbers import duration, error, figure, join, words

Run = Mapping[str, Any]
UP, DOWN = "psnr|ssim|accuracy|coverage", "error|loss|seconds|evaluations|deviation|train/"


def numbers(run: Run) -> dict[str, float]:
    """Return what a run is sorted by, and every other number that a filter may name."""
    found = dict(run["figures"])
    found |= {each["name"]: each["estimate"] for each in run["parameters"]}
    errors = [each["error"] for each in run["parameters"] if each["error"] is not None]
    first = {"error": max(errors, default=None), "seconds": run["seconds"]}
    for key in ("position", "rotation"):
        names = [name for name in (f"test/{key}_error", f"val/{key}_error") if name in run["figures"]]
        first[key] = run["figures"][names[0]] if names else None
    return found | {name: value for name, value in first.items() if value is not None}


def texts(run: Run) -> dict[str, str]:
    """Return the columns of numbers as texts."""
    found = numbers(run)
    return {
        "Parameter error": error(found["error"]) if "error" in found else "",
        "Position error": error(found["position"]) if "position" in found else "",
        "Rotation error": f"{figure(found['rotation'], 2)}°" if "rotation" in found else "",
        "Evaluations": figure(found["evaluations"]) if "evaluations" in found else "",
        "Time": duration(found["seconds"]) if "seconds" in found else "",
        "Date": str(run["date"]).replace("T", " ")[:16],
    }


def short(said: Diagnosis) -> str:
    """Say a verdict in a few words."""
    blamed = " + ".join(words(name) for name in said.blamed)
    return {
        "none": "no gap beyond the floors" if explains(said) else "a gap no larger than between simulators",
        "named": blamed,
        "group": f"one of {len(said.group)}: {join(map(words, said.group), 'or')}",
        "partial": f"{blamed}, and more",
        "unknown": "a gap that no effect explains",
    }[said.verdict]


def far(said: Diagnosis) -> list[str]:
    """Give the errors of each split, and the share of the gap that closes."""
    lines = []
    for split in SPLITS:
        shown, share = said.shown(split), closed(said, split)
        if shown is not None:
            errors, _, unit = shown
            part = "" if share is None else f", {share[0]} closed"
            lines.append(f"{SPLIT_NAMES[split]}: {before_and_after(errors, unit).replace('->', '→')}{part}")
    return lines


def grade(share: float) -> str:
    """Return how good a relative error is, as the paper's tables would see it."""
    return "good" if share <= 0.01 else "warn" if share <= 0.1 else "bad"


def met(cell: Mapping[str, Any]) -> bool | None:
    """Return whether a result is at most its target; None where it has none."""
    value, target = cell.get("value"), cell.get("target")
    both = isinstance(value, int | float) and isinstance(target, int | float)
    return value <= target if both else None  # type: ignore[operator]


def keeps(value: object, asked: str) -> bool | None:
    """Return whether a figure keeps what is asked: "<= 5", ">= 95" or "80 to 97"; None where nothing is asked."""
    limit = re.fullmatch(r"(<=|>=) (-?[\d.]+)", asked or "")
    ends = re.fullmatch(r"(-?[\d.]+) to (-?[\d.]+)", asked or "")
    if not isinstance(value, int | float) or not (limit or ends):
        return None
    if ends:
        return float(ends[1]) <= value <= float(ends[2])
    assert limit is not None
    return value <= float(limit[2]) if limit[1] == "<=" else value >= float(limit[2])


def judged(run: Run) -> list[bool]:
    """Return which of the run's results meet their targets."""
    found = [met(cell) for cell in run["cells"]]
    found += [keeps(each.get("value"), each.get("good", "")) for each in (run["score"] or {}).get("figures", ())]
    return [each for each in found if each is not None]


def text_of(run: Run) -> str:
    """Return all words that a filter looks for."""
    said = run["diagnosis"]
    found = [run[name] for name in ("id", "kind", "state", "method", "data", "config", "sentence")]
    found += [short(said) if said else ""] + [each["name"] for each in run["parameters"]]
    found += [str(each.get("name")) for each in (run["score"] or {}).get("figures", ())]
    found += [f"{name} {each}" for name, each in ((run["identifiability"] or {}).get("verdicts") or {}).items()]
    return " ".join(found).lower()


def direction(name: str) -> int:
    """Return whether more of a figure is better (1), less (-1), or neither (0)."""
    return 1 if re.search(UP, name) else -1 if re.search(DOWN, name) else 0
