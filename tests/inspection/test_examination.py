"""What `check` calls a mistake, fit, identifiability and diagnose say at the start, and keep beside the result."""

from __future__ import annotations

import dataclasses
import json
import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.diagnosis.documents import diagnosis
from tests.diagnosis.sets import recorded, rewritten

from physid.cli import main
from physid.dashboard.run import read_run
from physid.data import Recording, RecordingSet
from physid.diagnosis.document.document import check_diagnosis
from physid.diagnosis.document.sentences import summary_lines
from physid.diagnosis.inputs import read_inputs
from physid.diagnosis.report.contents import ReportData
from physid.diagnosis.report.page import render
from physid.diagnosis.settings.settings import Settings
from physid.inspection import mistakes
from physid.inspection.evidence import Evidence
from physid.inspection.examination import examine, require_usable_set
from physid.inspection.finding import Finding, Findings
from physid.inspection.report import inspect

LATE = 8  # frames


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("sound") / "set", steps=150)


def with_forces(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[int, Recording], Recording]:
    def changed(_: int, one: Recording) -> Recording:
        assert one.wrench is not None
        return dataclasses.replace(one, wrench=change(one.wrench))

    return changed


def with_w_first(_: int, one: Recording) -> Recording:
    assert one.pose is not None
    return dataclasses.replace(one, pose=one.pose[..., [0, 1, 2, 6, 3, 4, 5]])


MISTAKES = {
    "sign": (with_forces(np.negative), "accelerations point against the forces"),
    "clock": (with_forces(lambda wrench: np.roll(wrench, LATE, 0)), "before the forces"),
    "order": (with_w_first, "order: "),
}


def counted(monkeypatch: pytest.MonkeyPatch) -> list[Evidence]:
    """Return a list that grows whenever the rules are asked."""
    asked: list[Evidence] = []

    def rule(seen: Evidence) -> None:
        asked.append(seen)

    monkeypatch.setattr(mistakes, "RULES", (*mistakes.RULES, rule))
    return asked


def wrong(findings: tuple[Finding, ...] | list[Finding]) -> list[str]:
    return [one.what for one in findings if one.wrong]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["sign", *(pytest.param(name, marks=pytest.mark.slow) for name in (None, "clock", "order"))]
)
def test_a_fit_and_identifiability_say_what_check_says_and_keep_it(
    name: str | None,
    sound: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    capsys: pytest.CaptureFixture[str],
) -> None:
    change, said = MISTAKES[name] if name else (lambda _, one: one, "")
    spoilt = rewritten(sound, tmp_path / "set", change)
    expected = wrong(list(inspect(RecordingSet(spoilt)).findings))
    assert any(said in one for one in expected) == bool(name)
    asked = counted(monkeypatch)
    run, judged = tmp_path / "run", tmp_path / "judged"
    for words in (
        ["fit", str(spoilt), "--run-dir", str(run), "trainer.max_epochs=1"],
        ["identifiability", str(spoilt), "--out", str(judged)],
    ):
        caplog.clear()
        asked.clear()
        assert main(words) == 0
        assert len(asked) == 1
        warned = [one.getMessage() for one in caplog.records if one.levelno == logging.WARNING]
        assert [sum(what in line for line in warned) for what in expected] == [1] * len(expected)
        assert ("before you rely on the result" in capsys.readouterr().out) == bool(name)
    kept = Findings.read(run)
    assert kept is not None
    assert kept.recordings == str(spoilt)
    assert wrong(kept.findings) == expected
    assert [
        one["what"] for one in json.loads((judged / "identifiability.json").read_text())["findings"] if one["wrong"]
    ] == expected
    for folder in (run, judged):
        notes = read_run(folder, tmp_path, light=True)["notes"]
        assert [sum(what in note for note in notes) for what in expected] == [1] * len(expected)


@pytest.mark.slow
def test_a_model_that_is_tested_on_other_recordings_says_what_is_wrong_with_them(
    sound: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run, flipped = tmp_path / "run", rewritten(sound, tmp_path / "flipped", MISTAKES["sign"][0])
    assert main(["fit", str(sound), "--run-dir", str(run), "trainer.max_epochs=1"]) == 0
    for folder, says in ((sound, False), (flipped, True)):
        caplog.clear()
        assert main(["test", str(folder), "--run-dir", str(run)]) == 0
        assert any("accelerations point against" in one.getMessage() for one in caplog.records) == says


def test_a_diagnosis_starts_with_what_check_says_of_both_sets(
    sound: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flipped = RecordingSet(rewritten(sound, tmp_path / "flipped", MISTAKES["sign"][0]))
    late = RecordingSet(
        rewritten(recorded(tmp_path / "more", steps=150, seed=5), tmp_path / "late", MISTAKES["clock"][0])
    )
    expected, others = (wrong(list(inspect(one).findings)) for one in (flipped, late))
    assert expected
    assert others
    asked = counted(monkeypatch)
    found = read_inputs(flipped, late, None, (), None, Settings()).findings
    assert len(asked) == 2
    assert wrong(found) == [*expected, *(f"{late.folder}: {one}" for one in others)]
    assert not wrong(read_inputs(RecordingSet(sound), None, None, (), None, Settings()).findings)


def test_a_document_keeps_findings_and_its_pages_show_them(tmp_path: Path) -> None:
    found = [
        {"what": "forces <b>", "mend": "turn them", "wrong": True},
        {"what": "odd", "mend": "look", "wrong": False},
    ]
    with_them, without = (check_diagnosis(diagnosis() | extra) for extra in ({"findings": found}, {}))
    assert [*map(dict, with_them.to_mapping()["findings"])] == found
    assert "findings" not in without.to_mapping()
    for said, shown in ((with_them, True), (without, False)):
        page, lines = render(said, ReportData()), "\n".join(summary_lines(said))
        assert ("1 thing looks wrong in these recordings" in page) == shown
        assert ("Forces &lt;b&gt;" in page) == shown
        assert ("Beware    1 thing looks wrong" in lines) == shown
        assert "odd" not in lines
        assert lines.count("Refitted") == 1
        (tmp_path / "diagnosis.json").write_text(json.dumps(said.to_mapping()))
        notes = read_run(tmp_path, tmp_path, light=True)["notes"]
        assert ("looks wrong: forces <b>; turn them" in notes) == shown


def test_a_damaged_file_beside_what_is_fitted_is_a_finding_and_one_that_is_fitted_an_error(
    sound: Path, tmp_path: Path
) -> None:
    recordings = RecordingSet(rewritten(sound, tmp_path / "set", lambda _, one: one))
    everything = range(len(recordings))
    recordings.paths[0].write_bytes(b"\0" * 100)
    assert len(wrong(require_usable_set(recordings, [*everything][1:], everything))) == 1
    assert len(wrong(examine(recordings, everything))) == 1
    with pytest.raises(ValueError, match="000000"):
        require_usable_set(recordings, everything)
