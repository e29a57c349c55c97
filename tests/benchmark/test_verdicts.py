"""The step that diagnoses sees the recordings only, and can be interrupted."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.benchmark.stub import cheating, failing, ignorant

from physid.benchmark.bank import Bank, read_bank
from physid.benchmark.scoring.calibration import calibrate
from physid.benchmark.scoring.figures import figures as figures_of
from physid.benchmark.scoring.opening import open_judged
from physid.benchmark.scoring.results import report
from physid.benchmark.scoring.scoring import score
from physid.benchmark.scoring.training import read_table, train
from physid.benchmark.verdicts import closed, diagnose_bank, diagnose_set
from physid.cli import main
from physid.data import RecordingSet
from physid.diagnosis.posterior.posterior import Posterior
from physid.typed_files import read_yaml_as


@pytest.fixture
def own(bank: Bank, tmp_path: Path) -> Bank:
    """Return a copy of the bank."""
    shutil.copytree(bank.folder, tmp_path / "bank")
    return replace(bank, folder=tmp_path / "bank")


def test_a_diagnosis_that_opens_the_labels_fails(own: Bank) -> None:
    assert not diagnose_set(own, "000", cheating)
    error = json.loads((own.verdict("000") / "failure.json").read_text())["error"]
    assert error.startswith("PermissionError")
    assert "recordings only" in error
    assert diagnose_set(own, "000", ignorant), "a failure is forgotten once a verdict is there"
    assert not (own.verdict("000") / "failure.json").exists()


def test_the_sealed_folder_is_closed_while_a_diagnosis_runs_and_open_afterwards(own: Bank) -> None:
    labels = own.folder / "sealed" / "labels.json"
    with closed(own.folder / "sealed"):
        assert (own.folder / "bank.yaml").read_text()
        for look in (labels.read_text, lambda: list(labels.parent.iterdir()), lambda: np.loadtxt(str(labels))):
            with pytest.raises(PermissionError, match="recordings only"):
                look()
    assert labels.read_text()


def test_only_sets_without_a_verdict_are_diagnosed(own: Bank) -> None:
    assert diagnose_set(own, "003", ignorant)
    assert not diagnose_set(own, "004", failing)
    rest = len(own.sets) - 2
    assert diagnose_bank(own, diagnose=ignorant, quiet=True) == (rest, 0)
    assert diagnose_bank(own, diagnose=ignorant, quiet=True) == (0, 0)
    assert diagnose_bank(own, diagnose=ignorant, again=True, quiet=True) == (1, 0)


def test_the_labels_stay_closed_until_every_set_has_its_verdict(own: Bank, tmp_path: Path) -> None:
    for name in list(own.sets)[:-1]:
        diagnose_set(own, name, ignorant)
    (own.folder / "sealed" / "labels.json").rename(tmp_path / "labels.json")  # not even looked for
    with pytest.raises(ValueError, match=r"found none on 1 \(007\)"):
        score(own, tmp_path / "score")
    assert not (tmp_path / "score").exists()


def test_what_has_a_verdict_can_be_scored_before_the_end(own: Bank, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected a verdict on one set at least, found none"):
        score(own, tmp_path / "score", so_far=True)
    for name in ("001", "004"):
        diagnose_set(own, name, ignorant)
    result = score(own, tmp_path / "score", so_far=True)
    assert [one.name for one in result.judged] == ["001", "004"]
    assert "2 sets" in (tmp_path / "score" / "results.md").read_text()


def test_a_bank_that_was_changed_after_sealing_is_not_scored(own: Bank, tmp_path: Path) -> None:
    diagnose_bank(own, diagnose=ignorant, quiet=True)
    sums = own.recordings("002") / "SHA256SUMS"
    sums.write_text(sums.read_text().replace("0", "1", 1))
    with pytest.raises(ValueError, match="expected the recordings that were sealed"):
        score(own, tmp_path / "score")


def test_recordings_that_were_exchanged_are_not_scored(own: Bank, tmp_path: Path) -> None:
    diagnose_bank(own, diagnose=ignorant, quiet=True)
    first, second = sorted((own.recordings("002") / "trajectories").iterdir())[:2]
    shutil.copy(second, first)
    with pytest.raises(ValueError, match=first.name):
        score(own, tmp_path / "score")


def test_whatever_goes_wrong_with_a_set_the_others_get_their_verdicts(own: Bank) -> None:
    def fails(recordings: RecordingSet, out: Path) -> Any:
        if recordings.folder.name == "001":
            return {}["nothing"]
        return ignorant(recordings, out)

    done, failed = diagnose_bank(own, diagnose=fails, quiet=True)
    assert (done, failed) == (len(own.sets), 1)
    assert "KeyError" in (own.verdict("001") / "failure.json").read_text()
    free = [one for one in open_judged(own)[0] if one.label.role == "free"]
    figures = {one.name: one for one in figures_of(open_judged(own)[0])}
    assert figures["false alarms on effect-free sets"].count == len(free)
    assert figures["diagnoses that failed"].value == pytest.approx(100 / len(own.sets))


def test_a_machine_that_runs_out_of_memory_gives_no_verdict(own: Bank) -> None:
    def starved(_recordings: RecordingSet, _out: Path) -> Any:
        raise MemoryError

    with pytest.raises(MemoryError):
        diagnose_set(own, "000", starved)
    assert not own.verdict("000").joinpath("failure.json").exists()


def test_a_diagnosis_that_always_says_none_raises_no_false_alarm_and_finds_nothing(own: Bank, tmp_path: Path) -> None:
    diagnose_bank(own, diagnose=ignorant, quiet=True)
    result = score(own, tmp_path / "score")
    value = {figure.name: figure.value for figure in result.figures}
    assert value["false alarms on effect-free sets"] == 0
    assert value["flagged, medium and up"] == 0
    assert value["group accuracy, medium and up"] == 0
    assert value["diagnoses that failed"] == 0
    assert {path.name for path in (tmp_path / "score").iterdir()} == {
        *("results.json", "results.md", "results.html", "confusion.png", "power.png", "reliability.png")
    }
    values = json.loads((tmp_path / "score" / "results.json").read_text())
    assert len(values["sets"]) == len(own.sets)
    assert own.seal in (tmp_path / "score" / "results.md").read_text()
    assert "false alarms" in report(result)


def test_probabilities_come_from_calibration_banks_alone(own: Bank, tmp_path: Path) -> None:
    diagnose_bank(own, diagnose=ignorant, quiet=True)
    with pytest.raises(ValueError, match="expected a calibration bank"):
        calibrate([own], tmp_path / "out")
    assert not (tmp_path / "out").exists()
    table = calibrate([replace(own, purpose="calibration")], tmp_path / "out")
    cases = read_table(tmp_path / "out" / "training.yaml")
    assert {case.evidence.said for case in cases} == {("none",)}
    assert any(case.right for case in cases)
    assert not all(case.right for case in cases)
    trained = read_yaml_as(Posterior, tmp_path / "out" / "coefficients.yaml")
    assert trained == train(cases)
    rows = {row[0].strip(): row for row in table}
    assert rows["none"][1] == str(len(cases)), "all verdicts are `none`"


def test_sets_of_an_earlier_table_count_too_and_once(own: Bank, tmp_path: Path) -> None:
    diagnose_bank(own, diagnose=ignorant, quiet=True)
    spent = replace(own, purpose="calibration")
    calibrate([spent], tmp_path / "first")
    first = read_table(tmp_path / "first" / "training.yaml")
    older = replace(first[0], name="older/000", truth=("unknown",))
    calibrate([spent], tmp_path / "second", [older, replace(first[0], truth=("other",))])
    assert read_table(tmp_path / "second" / "training.yaml") == [older, *first]


def test_a_bank_is_spent_for_good_and_only_once_all_verdicts_are_there(own: Bank, tmp_path: Path) -> None:
    words = ["benchmark", "diagnosis", "calibrate", f"--bank={own.folder}", f"--out={tmp_path / 'out'}", "--spent"]
    before = (own.folder / "bank.yaml").read_bytes()
    assert main(words) == 2
    assert (own.folder / "bank.yaml").read_bytes() == before
    diagnose_bank(own, diagnose=ignorant, quiet=True)
    open_one = shutil.copytree(own.folder, tmp_path / "open")
    shutil.rmtree(open_one / "verdicts")
    assert main([*words[:3], f"--bank={own.folder},{open_one}", *words[4:]]) == 2, "all banks are spent, or none"
    assert (own.folder / "bank.yaml").read_bytes() == before
    assert main(words) == 0
    assert read_bank(own.folder) == replace(own, purpose="calibration")
    assert main(words[:-1]) == 0, "from then on it is a calibration bank"


def test_a_calibration_bank_without_all_verdicts_is_not_counted(own: Bank, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"found none on 8 \(000, 001, 002, \.\.\.\)"):
        calibrate([replace(own, purpose="calibration")], tmp_path)


def test_the_command_seals_and_refuses_what_is_out_of_order(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = str(tmp_path / "bank")
    tiny = ["--sets=1", "--trajectories=6", "--steps=60", "--workers=1", "--quiet"]
    assert main(["benchmark", "diagnosis", "seal", f"--out={place}", *tiny]) == 0
    assert "SHA-256 of the sealed labels" in capsys.readouterr().out
    for words, message in (
        (["score", f"--bank={place}"], "expected a verdict on each of the 1 sets"),
        (["calibrate", f"--bank={place}"], "expected a calibration bank"),
        (["diagnose", f"--bank={tmp_path}"], "expected a sealed bank, found none"),
        (["seal", f"--out={place}", *tiny, "--seed=4"], "holds a bank of another seed"),
        (["seal", f"--out={place}", "--trajectories=3"], "trajectories must be a whole number of at least 6, got 3"),
        (["score", f"--bank={place}", "--join=shipped"], "--join belongs to calibrate, got it with score"),
        (["score", f"--bank={place}", "--spent"], "--spent belongs to calibrate, got it with score"),
        (["score", f"--bank={place}", "--again"], "--again belongs to diagnose, got it with score"),
        (["diagnose", f"--out={place}"], f"the bank to diagnose is named by --bank {place}"),
        (["open"], "expected one of 'all', 'seal', 'diagnose', 'score', 'calibrate', got open"),
    ):
        assert main(["benchmark", "diagnosis", *words]) == 2
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1


@pytest.mark.parametrize(("step", "name"), [("score", "score"), ("calibrate", "calibration"), ("diagnose", "verdicts")])
def test_nothing_is_written_into_a_bank_that_leads_elsewhere(
    tmp_path: Path, step: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for folder in ("home", "bank"):
        (tmp_path / folder).mkdir()
    (tmp_path / "bank" / name).symlink_to(tmp_path / "home")
    assert main(["benchmark", "diagnosis", step, "--bank", str(tmp_path / "bank")]) == 2
    assert f"{name}: expected nothing but files and folders where physid writes" in capsys.readouterr().err
    assert not list((tmp_path / "home").iterdir())
