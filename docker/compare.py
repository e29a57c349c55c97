#!/usr/bin/env python3
"""Compare what two runs of `physid reproduce` wrote: every figure to the last digit, every recording byte for byte.

Usage: docker/compare.py ONE OTHER. Times alone may differ. Exits with 1 if anything else does, or if nothing was found.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

FIGURES = ("metrics.json", "results.json", "identifiability.json", "diagnosis.json")
BYTES = ("SHA256SUMS", "parameters.csv")
TIMES = ("seconds", "time")


def without_times(value: Any) -> Any:
    """Return JSON without what measures time: keys of a mapping, and rows of a table of results."""
    if isinstance(value, dict):
        return {key: without_times(each) for key, each in value.items() if key.rpartition("/")[2] not in TIMES}
    if isinstance(value, list):
        return [without_times(each) for each in value if not (isinstance(each, dict) and each.get("metric") in TIMES)]
    return value


def leaves(value: Any, key: str = "") -> dict[str, Any]:
    """Return the leaves of a value by their paths."""
    if isinstance(value, dict | list) and value:
        items = value.items() if isinstance(value, dict) else enumerate(value)
        return {path: leaf for name, each in items for path, leaf in leaves(each, f"{key}/{name}").items()}
    return {key: value}


def read(path: Path) -> dict[str, Any]:
    """Return what is compared of a file: its figures, or its lines; nothing if it is missing."""
    if not path.is_file():
        return {}
    text = path.read_text(encoding="utf-8")
    return leaves(without_times(json.loads(text))) if path.suffix == ".json" else leaves(text.splitlines())


def compare(one: Path, other: Path) -> tuple[int, list[str]]:
    """Return how many values were compared, and a line for each that differs."""
    names = {path.relative_to(root) for root in (one, other) for name in FIGURES + BYTES for path in root.rglob(name)}
    compared, different = 0, []
    for name in sorted(names):
        mine, theirs = read(one / name), read(other / name)
        compared += len(mine.keys() | theirs.keys())
        # As text: a NaN equals itself, and 1 is not 1.0.
        keys = [key for key in mine.keys() | theirs.keys() if repr(mine.get(key)) != repr(theirs.get(key))]
        different += [f"{name}{key}: {mine.get(key)} here, {theirs.get(key)} there" for key in sorted(keys)]
    return compared, different


if __name__ == "__main__":
    compared, different = compare(Path(sys.argv[1]), Path(sys.argv[2]))
    print(*different, f"{compared} values compared, {len(different)} differ", sep="\n")
    sys.exit(bool(different) or not compared)
