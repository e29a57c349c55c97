"""What a run folder holds, as one mapping that the page can show."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from physid.dashboard.curves import Curve, numbers_of, read_curves
from physid.dashboard.doubts import doubts_about
from physid.dashboard.folders import (
    CELLS,
    CONFIG,
    DIAGNOSIS,
    FIGURES,
    HISTORY,
    IDENTIFIABILITY,
    PARAMETERS,
    RECORD,
    REPORT,
)
from physid.dashboard.media import MOST_BYTES, read_media
from physid.diagnosis.document.document import Diagnosis, check_diagnosis
from physid.diagnosis.document.sentences import verdict_sentence
from physid.estimation.prediction.coordinates import Unknown, logged_names
from physid.yaml_files import parse_yaml, read_bytes, read_text

SCORE = {"bank": dict, "figures": list, "tables": dict}  # what of a scored bank is shown


def read_or_damaged(folder: Path, root: Path, *, light: bool = False) -> dict[str, Any]:
    """Read a run; one that is malformed beyond what `read_run` looks for is listed as damaged, and costs no other."""
    try:
        return read_run(folder, root, light=light)
    except Exception as error:  # whatever a stranger's files lead to
        reason = (str(error).splitlines() or [""])[0][:200]
        notes = [f"the run cannot be read: {type(error).__name__}: {reason}"]
        return empty_run(_name(folder, root)) | {"notes": notes}


def read_run(folder: Path, root: Path, *, light: bool = False) -> dict[str, Any]:
    """Read everything that the page shows of a run.

    A file that is damaged, or still being written, costs only what it would have shown; a note says so.

    Args:
        folder: Run folder.
        root: The folder that the page is about; the run is named by its path below it.
        light: Whether to leave out films, images and reports.

    Returns:
        Plain types, ready for JSON.
    """
    notes: list[str] = []
    figures = _figures(folder / FIGURES, notes)
    diagnosis = _mapping(folder / DIAGNOSIS, notes)
    identifiability = _mapping(folder / IDENTIFIABILITY, notes)
    record = _mapping(folder / RECORD, notes)
    said = _diagnosis(diagnosis, notes)
    cells, score = _results(folder / CELLS, notes)
    text, config = _config(folder / CONFIG, notes)
    config = config or identifiability.get("config") or {}
    curves = _curves(folder / HISTORY, notes)
    history = _curves(folder / PARAMETERS, notes)
    media, too_large = ([], []) if light else read_media(folder)
    kind = _kind(bool(diagnosis), bool(identifiability), bool(cells or score) and not curves)
    figures |= {each["name"]: each["value"] for each in score.get("figures", ()) if each.get("value") is not None}
    notes += doubts_about(folder, figures, _folder(config) or "RECORDINGS", said, identifiability)
    return {
        "id": _name(folder, root),
        "kind": kind,
        "state": "finished" if figures or diagnosis or identifiability or cells or score else "unfinished",
        "date": _date(folder),
        "method": _last_word(config.get("model")),
        "data": _data(config),
        "parameters": parameters(figures, curves, history),
        "figures": {name: value for name, value in figures.items() if not name.startswith("params/")},
        "curves": [curve.to_mapping() for curve in curves if curve.group != "parameter"],
        "media": media,
        "diagnosis": said,
        "sentence": verdict_sentence(said) if said else str(diagnosis.get("verdict", "")),
        "seconds": said.seconds if said else figures.get("seconds"),
        "identifiability": identifiability or None,
        "report": None if light else _report(folder / REPORT, notes),
        "cells": cells,
        "score": score or None,
        "config": text,
        "settings": flatten(config),
        "record": record or None,
        "notes": notes + too_large,
    }


def empty_run(name: str) -> dict[str, Any]:
    """Return what the page shows of a run of which nothing can be read."""
    lists = ("parameters", "curves", "media", "cells", "notes")
    absent = ("diagnosis", "identifiability", "report", "score", "record", "seconds")
    return {
        **{name: [] for name in lists},
        **{name: {} for name in ("figures", "settings")},
        **dict.fromkeys(absent),
        **dict.fromkeys(("date", "method", "data", "sentence", "config"), ""),
        "id": name,
        "kind": "fit",
        "state": "damaged",
    }


def _name(folder: Path, root: Path) -> str:
    return folder.relative_to(root).as_posix() if folder != root else folder.resolve().name


def _kind(diagnosis: bool, identifiability: bool, only_cells: bool) -> str:
    """Return what a folder holds first of all."""
    kinds = {"diagnosis": diagnosis, "identifiability": identifiability, "benchmark": only_cells}
    return next((name for name, found in kinds.items() if found), "fit")


def parameters(figures: Mapping[str, float], curves: list[Curve], history: list[Curve]) -> list[dict[str, Any]]:
    """Return the learned parameters of a fit: estimate, truth where it is known, and the history.

    Args:
        figures: Last values, `params/NAME/estimate` and `/true`.
        curves: The history as the logger wrote it, by epoch.
        history: The same from the first guess on, where the run has left it.

    Returns:
        One mapping for each parameter, by name.
    """
    logged = {curve.name: curve for curve in curves}
    last = {name: curve.y[-1] for name, curve in logged.items()} | dict(figures)
    names = logged_names(last, "estimate")
    whole = {curve.name: curve for curve in history}
    found = []
    for name in names:
        curve = whole.get(name) or logged.get(f"params/{name}/estimate")
        estimate, true = last[f"params/{name}/estimate"], last.get(f"params/{name}/true")
        found.append(
            {
                "name": name,
                "unit": Unknown.of(name).unit,
                "estimate": estimate,
                "true": true,
                "low": last.get(f"params/{name}/low"),
                "high": last.get(f"params/{name}/high"),
                "error": abs(estimate / true - 1) if true else None,
                "identified": bool(last.get(f"params/{name}/observable", 1.0)),
                "axis": curve.axis if curve else "epoch",
                "x": curve.x if curve else [],
                "y": curve.y if curve else [],
            }
        )
    return found


def flatten(values: Any, key: str = "") -> dict[str, str]:
    """Return the leaves of a configuration as text by their dotted keys; lists count as leaves."""
    if not isinstance(values, dict) or not values:
        return {key: json.dumps(values, default=str)} if key else {}
    leaves: dict[str, str] = {}
    for name, value in values.items():
        leaves |= flatten(value, f"{key}.{name}" if key else str(name))
    return {name.replace(".init_args", ""): value for name, value in leaves.items()}


def _read(path: Path, notes: list[str]) -> Any:
    """Read a JSON file that may be missing, or damaged."""
    try:
        return json.loads(read_text(path, within=path.parent), parse_constant=lambda _: None)
    except FileNotFoundError:
        return None
    except (ValueError, OSError, RecursionError) as error:
        notes.append(f"{path.name} cannot be read: {error}")
        return None


def _mapping(path: Path, notes: list[str]) -> dict[str, Any]:
    """Read a JSON file that should hold a mapping."""
    value = _read(path, notes)
    if value is not None and not isinstance(value, dict):
        notes.append(f"{path.name} cannot be read: expected a mapping, got a {type(value).__name__}")
    return value if isinstance(value, dict) else {}


def _figures(path: Path, notes: list[str]) -> dict[str, float]:
    """Read the figures of a run, without those that are no finite numbers."""
    found, doubts = numbers_of(_mapping(path, notes))
    notes += [f"{path.name}: {doubts}"] if doubts else []
    return found


def _results(path: Path, notes: list[str]) -> tuple[list[Any], dict[str, Any]]:
    """Read results.json: the rows of a reproduction, or figures and tables of a scored bank; else empty."""
    value = _read(path, notes)
    if isinstance(value, dict) and all(isinstance(value.get(name), kind) for name, kind in SCORE.items()):
        return [], {name: value[name] for name in SCORE}
    if value is not None and not isinstance(value, list):
        notes.append(f"{path.name} cannot be read: expected rows of a reproduction or a scored bank")
    return value if isinstance(value, list) else [], {}


def _diagnosis(content: Mapping[str, Any], notes: list[str]) -> Diagnosis | None:
    """Check a diagnosis; None where there is none, or parts of it are missing."""
    try:
        return check_diagnosis(content) if content else None
    except ValueError as error:
        notes.append(" ".join(str(error).split()))
        return None


def _curves(path: Path, notes: list[str]) -> list[Curve]:
    """Read a history that may be missing, or damaged."""
    try:
        return read_curves(path, within=path.parent)
    except FileNotFoundError:
        return []
    except (ValueError, KeyError, OSError) as error:
        notes.append(f"{path.name} cannot be read: {error}")
        return []


def _config(path: Path, notes: list[str]) -> tuple[str, dict[str, Any]]:
    """Read the configuration of a run, as text and as a mapping."""
    try:
        text = read_text(path, within=path.parent)
        value = parse_yaml(text, path.name)
    except FileNotFoundError:
        return "", {}
    except (ValueError, OSError) as error:
        notes.append(f"{path.name} cannot be read: {error}")
        return "", {}
    return text, value if isinstance(value, dict) else {}


def _report(path: Path, notes: list[str]) -> str | None:
    """Read the page that a diagnosis has written."""
    try:
        if (size := path.lstat().st_size) > MOST_BYTES:
            notes.append(f"{path.name} ({size / 1e6:.0f} MB) is too large for this page; open it by itself")
            return None
        return read_bytes(path, MOST_BYTES, within=path.parent).decode("utf-8", errors="replace")
    except FileNotFoundError:
        return None
    except OSError as error:  # a pipe, a device, or a link that leads out of the run
        notes.append(f"{path.name} cannot be read: {error}")
        return None


def _date(folder: Path) -> str:
    """Return when the run wrote its last figures, to the second."""
    times = [
        path.stat().st_mtime
        for name in (FIGURES, DIAGNOSIS, IDENTIFIABILITY, CELLS, HISTORY)
        if (path := folder / name).exists()
    ]
    return datetime.fromtimestamp(max(times), UTC).isoformat(timespec="seconds")


def _last_word(model: Any) -> str:
    """Return the name of the class that a configuration trains."""
    path = model.get("class_path", "") if isinstance(model, dict) else ""
    return str(path).rpartition(".")[2]


def _folder(config: Mapping[str, Any]) -> str:
    """Return the recording set that the configuration of a fit reads, as it is written there."""
    data = config.get("data")
    arguments = data.get("init_args", {}) if isinstance(data, dict) else {}
    return str((arguments.get("folder") if isinstance(arguments, dict) else None) or "")


def _data(config: Mapping[str, Any]) -> str:
    """Return the name of the recording set that a configuration reads."""
    folder = _folder(config) or config.get("recordings") or config.get("scene")
    return Path(str(folder)).name if folder else ""
