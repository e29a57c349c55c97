"""diagnosis.json: what it must hold, written and read with a check."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from physid.data.files import write_text
from physid.diagnosis.document.faults import Faults

FILE = "diagnosis.json"
FORMAT, VERSION = "physid-diagnosis", 2
VERDICTS = ("none", "named", "group", "partial", "unknown")
SITES = ("perception", "actuation", "dynamics", "contact")
SPLITS = ("same", "transfer")
DOFS = ("x", "y", "z", "rx", "ry", "rz")
PHASES = (
    "rest",
    "stick",
    "slide_slow",
    "slide_fast",
    "coast",
    "force_switch",
    "impact",
    "contact_between_objects",
    "free_fall",
)
KEYS = (
    "format",
    "version",
    "verdict",
    "effects",
    "group",
    "confidence",
    "ranking",
    "where",
    "gap",
    "shrink",
    "parameters",
    "next_experiment",
    "minor",
    "settings",
)
SUM_TOLERANCE = 0.02  # shares of four sites, each rounded to two digits


def check_diagnosis(diagnosis: object) -> Mapping[str, Any]:
    """Check that a document says what a diagnosis must say, in exactly the agreed form.

    Besides the form: `effects` and `group` are empty for `none` and `unknown`; otherwise every effect is in its group,
    and the group of the verdict `group` has further members. `after` is null where no effect was added, an entry of
    `shrink` where there is no such split or the gap is too near to its floor.

    Args:
        diagnosis: The parsed document.

    Returns:
        The document itself.

    Raises:
        ValueError: If anything is wrong; names every fault, what was expected and what came.
    """
    faults = Faults()
    document = faults.mapping(diagnosis, "diagnosis", KEYS)
    if document is not None:
        faults.one_of(document["format"], "format", (FORMAT,))
        faults.one_of(document["version"], "version", (VERSION,))
        faults.one_of(document["verdict"], "verdict", VERDICTS)
        faults.number(document["confidence"], "confidence", 0, 1)
        _check_effects(document, faults)
        _check_ranking(document["ranking"], faults)
        _check_where(document["where"], faults)
        _check_gap(document["gap"], document["shrink"], faults)
        _check_parameters(document["parameters"], faults)
        _check_minor(document["minor"], faults)
        for where, section in faults.entries(document["settings"], "settings"):
            list(faults.entries(section, where))
        if document["next_experiment"] is not None:
            faults.text(document["next_experiment"], "next_experiment")
    faults.complain(FILE)
    assert document is not None
    return document


def write_diagnosis(folder: Path, diagnosis: Mapping[str, Any]) -> Path:
    """Write diagnosis.json.

    Args:
        folder: Output folder of the diagnosis; made if it is not there.
        diagnosis: The document.

    Returns:
        The file.

    Raises:
        ValueError: If the document is not as `check_diagnosis` wants it.
    """
    path = folder / FILE
    write_text(path, json.dumps(check_diagnosis(diagnosis), indent=1, allow_nan=False) + "\n")
    return path


def read_diagnosis(path: Path) -> Mapping[str, Any]:
    """Read diagnosis.json.

    Args:
        path: The file.

    Returns:
        The document.

    Raises:
        ValueError: If the file is no JSON, or the document not as `check_diagnosis` wants it; names the file.
    """
    try:
        return check_diagnosis(json.loads(path.read_text(encoding="utf-8")))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _check_effects(document: Mapping[str, Any], faults: Faults) -> None:
    """Check the blamed effects and their group, and that both fit the verdict."""
    names = []
    for where, effect in faults.items(document["effects"], "effects"):
        if faults.mapping(effect, where, ("name", "site", "parameters")) is None:
            continue
        names.append(effect["name"])
        faults.text(effect["name"], f"{where}.name")
        faults.one_of(effect["site"], f"{where}.site", SITES)
        for name, value in faults.entries(effect["parameters"], f"{where}.parameters"):
            faults.estimate(value, name)
    group = [each for where, each in faults.items(document["group"], "group") if faults.text(each, where)]
    verdict = document["verdict"]
    if verdict in ("none", "unknown"):
        faults.expect(not names and not group, "effects, group", f"none for the verdict {verdict!r}", [*names, *group])
    elif verdict in VERDICTS:
        faults.expect(bool(names), "effects", f"at least one for the verdict {verdict!r}", names)
        outside = [name for name in names if name not in group]
        faults.expect(not outside, "group", f"the effects themselves among its members ({outside})", group)
        alone = verdict == "group" and len(group) <= len(names)
        faults.expect(not alone, "group", "members beside the effects for the verdict 'group'", group)


def _check_ranking(ranking: object, faults: Faults) -> None:
    """Check the candidates, their scores and p-values."""
    for where, candidate in faults.items(ranking, "ranking"):
        if faults.mapping(candidate, where, ("effects", "score", "p_value")) is None:
            continue
        names = [faults.text(each, place) for place, each in faults.items(candidate["effects"], f"{where}.effects")]
        faults.expect(bool(names), f"{where}.effects", "at least one name", candidate["effects"])
        faults.number(candidate["score"], f"{where}.score")
        faults.number(candidate["p_value"], f"{where}.p_value", 0, 1)


def _check_minor(minor: object, faults: Faults) -> None:
    """Check what was significant and is not blamed."""
    for where, one in faults.items(minor, "minor"):
        if faults.mapping(one, where, ("effects", "p_value", "closes")) is None:
            continue
        for place, each in faults.items(one["effects"], f"{where}.effects"):
            faults.text(each, place)
        faults.number(one["p_value"], f"{where}.p_value", 0, 1)
        faults.number(one["closes"], f"{where}.closes", 0, 1)


def _check_where(where: object, faults: Faults) -> None:
    """Check the shares of the sites and the cells of the map."""
    known = faults.mapping(where, "where", ("site", "cells"))
    if known is None:
        return
    shares = faults.mapping(known["site"], "where.site", SITES)
    if shares is not None and all(faults.number(shares[site], f"where.site.{site}", 0, 1) for site in SITES):
        total = sum(shares.values())
        fair = total == 0 or abs(total - 1) <= SUM_TOLERANCE
        faults.expect(fair, "where.site", "shares with sum 1 (or all 0)", f"sum {total:g}")
    for place, cell in faults.items(known["cells"], "where.cells"):
        if faults.mapping(cell, place, ("phase", "body", "dof", "evidence")) is None:
            continue
        faults.one_of(cell["phase"], f"{place}.phase", PHASES)
        faults.text(cell["body"], f"{place}.body")
        faults.one_of(cell["dof"], f"{place}.dof", DOFS)
        faults.number(cell["evidence"], f"{place}.evidence")


def _check_gap(gap: object, shrink: object, faults: Faults) -> None:
    """Check the errors before and after, and the shares that were closed."""
    errors = faults.mapping(gap, "gap", ("unit", "floor", "tolerance", *SPLITS))
    shares = faults.mapping(shrink, "shrink", SPLITS)
    if errors is None or shares is None:
        return
    faults.text(errors["unit"], "gap.unit")
    faults.number(errors["floor"], "gap.floor", 0)
    if faults.mapping(errors["tolerance"], "gap.tolerance", ("position", "rotation")) is not None:
        for name, value in errors["tolerance"].items():
            faults.number(value, f"gap.tolerance.{name}", 0)
    for split in SPLITS:
        error, share = errors[split], shares[split]
        if split == "transfer" and error is None:
            faults.expect(share is None, "shrink.transfer", "null, since there is no gap.transfer", share)
            continue
        if faults.mapping(error, f"gap.{split}", ("before", "after")) is not None:
            faults.number(error["before"], f"gap.{split}.before", 0)
            if error["after"] is not None:
                faults.number(error["after"], f"gap.{split}.after", 0)
        if share is not None:
            faults.estimate(share, f"shrink.{split}", unit=False)


def _check_parameters(parameters: object, faults: Faults) -> None:
    """Check the unknown parameters of the nominal model, without and with the effect."""
    for where, value in faults.entries(parameters, "parameters"):
        if faults.mapping(value, where, ("nominal", "with_effect")) is None:
            continue
        faults.number(value["nominal"], f"{where}.nominal")
        if value["with_effect"] is not None:
            faults.estimate(value["with_effect"], f"{where}.with_effect")
