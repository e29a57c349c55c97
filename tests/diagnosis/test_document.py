"""diagnosis.json: what is accepted, and how faults are named."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from diagnosis.documents import diagnosis, said
from physid.diagnosis.document.document import (
    DOFS,
    PHASES,
    SITES,
    VERDICTS,
    Errors,
    check_diagnosis,
    read_diagnosis,
    write_diagnosis,
)

Change = Callable[[dict[str, Any]], object]


@pytest.mark.parametrize("transfer", [True, False])
@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_has_a_valid_document(verdict: str, transfer: bool) -> None:
    document = diagnosis(verdict, transfer=transfer)
    assert json.loads(json.dumps(check_diagnosis(document).to_mapping())) == document


def test_what_most_impacts_leave_is_kept_and_is_the_gap_where_it_is_more() -> None:
    document = diagnosis("unknown")
    assert check_diagnosis(document).gap.most_beyond_noise == check_diagnosis(document).gap.beyond_noise(
        Errors(0.021, None)
    )
    for left, gap in ((0.03, 0.03), (0.001, (0.021**2 - 0.0014**2) ** 0.5)):
        impacts = {"unexplained": 7, "among": 9, "position": left, "rotation": 0.01}
        document["gap"]["impacts"] = {**impacts, "with_effects": None}
        made = check_diagnosis(document)
        assert json.loads(json.dumps(made.to_mapping())) == document
        assert made.gap.most_beyond_noise == pytest.approx(gap)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    document = said("group")
    path = write_diagnosis(tmp_path / "out", document)
    assert path == tmp_path / "out" / "diagnosis.json"
    assert read_diagnosis(path) == document


FAULTS: dict[str, tuple[Change, str]] = {
    "verdict": (lambda d: d.update(verdict="sure"), "verdict: expected 'none', 'named'"),
    "version": (lambda d: d.update(version=True), "version: expected 2, found True"),
    "missing key": (lambda d: d.pop("gap"), "missing key gap"),
    "strange key": (lambda d: d.update(confidance=3), 'unknown key "confidance"; did you mean "confidence"?'),
    "confidence": (lambda d: d.update(confidence=97), "confidence: expected a number of at most 1, found 97"),
    "not a number": (lambda d: d["gap"].update(floor=math.nan), "gap.floor: expected a finite number, found nan"),
    "interval": (
        lambda d: d["effects"][0]["parameters"]["coefficient"].update(low=0.3),
        "effects[0].parameters.coefficient: expected low <= value <= high, found 0.3, 0.21, 0.23",
    ),
    "site": (lambda d: d["effects"][0].update(site="engine"), "effects[0].site: expected 'actuation', 'dynamics'"),
    "shares": (lambda d: d["where"]["site"].update(dynamics=0.5), "where: site: expected shares with sum 1"),
    "phase": (
        lambda d: d["where"]["cells"][1].update(phase="sliding"),
        "where.cells[1].phase: expected 'rest'",
    ),
    "dof": (lambda d: d["where"]["cells"][0].update(dof="yaw"), "where.cells[0].dof: expected 'x', 'y'"),
    "p-value": (lambda d: d["ranking"][0].update(p_value=None), "ranking[0].p_value: expected a finite number"),
    "named nothing": (lambda d: d.update(effects=[]), "effects: expected at least one for the verdict 'named'"),
    "group without its effect": (lambda d: d.update(group=["tether"]), "group: expected the effects themselves"),
    "group of one": (lambda d: d.update(verdict="group"), "group: expected members beside the effects"),
    "none with an effect": (lambda d: d.update(verdict="none"), "effects, group: expected none for the verdict 'none'"),
    "share without split": (lambda d: d["gap"].update(transfer=None), "shrink.transfer: expected null"),
    "next experiment": (lambda d: d.update(next_experiment={}), "next_experiment: expected a text"),
    "parameters": (lambda d: d.update(parameters=[]), "parameters: expected a mapping, found []"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named_with_its_place_what_was_expected_and_what_came(name: str) -> None:
    change, message = FAULTS[name]
    document = diagnosis()
    change(document)
    with pytest.raises(ValueError, match=r"^diagnosis\.json: ") as caught:
        check_diagnosis(document)
    assert message in str(caught.value)


def test_a_residual_law_has_as_many_sizes_and_ends_as_places() -> None:
    document = diagnosis("unknown")
    assert check_diagnosis(document).to_mapping()["residual"][0]["size"] == (0.04, 0.2, 0.41)
    document["residual"][0]["high"].pop()
    with pytest.raises(ValueError, match=r"residual\[0\]: at, size, low, high: expected as many values in each"):
        check_diagnosis(document)


def test_all_faults_are_named_at_once() -> None:
    document = diagnosis() | {"confidence": 2, "verdict": "?"}
    with pytest.raises(ValueError, match=r"(?s)verdict: .*confidence: "):
        check_diagnosis(document)


def test_a_document_that_is_no_mapping_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^diagnosis\.json: expected a mapping with the keys format, version"):
        check_diagnosis([1])


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    path = tmp_path / "diagnosis.json"
    path.write_text("{")
    with pytest.raises(ValueError, match=str(path)):
        read_diagnosis(path)
    path.write_text(json.dumps({"format": "else"}))
    with pytest.raises(ValueError, match=str(path)):
        read_diagnosis(path)


def test_phases_degrees_of_freedom_and_sites_are_those_of_the_pipeline() -> None:
    from typing import get_args

    from physid.diagnosis.testing import residual_wrench as residual_wrench
    from physid.estimation.segmented_fit import motion_phases as phases
    from physid.physics import Site

    assert phases.PHASES == PHASES
    assert set(residual_wrench.DOFS) == set(DOFS)
    assert set(get_args(Site)) == set(SITES)


def test_a_diagnosis_that_holds_no_number_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_diagnosis(tmp_path, replace(said(), confidence=float("nan")))
    assert not list(tmp_path.iterdir())
