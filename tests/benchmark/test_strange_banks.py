"""Banks of strangers: labels, plans and sets that do not fit are refused with the file, and their names stay names."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from physid.benchmark.bank import FILE, Bank, read_bank, seal_of, write_bank
from physid.benchmark.bank import QUICK as SIZE
from physid.benchmark.plan import Plan
from physid.benchmark.scoring.results import _markdown
from physid.benchmark.scoring.scoring import score
from physid.benchmark.sealing.seal import seal
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.record import checksum

NAMES = ("a", "b")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings") / "push"
    generate(GenerateConfig("push", trajectories=2, steps=20), folder, 1, quiet=True)
    return folder


def bank_of(folder: Path, recordings: Path, labels: dict[str, Any]) -> Bank:
    """Write a bank of two sets whose diagnoses failed, with labels that fit its seal."""
    for name in NAMES:
        shutil.copytree(recordings, folder / "sets" / name)
        (folder / "verdicts" / name).mkdir(parents=True)
        (folder / "verdicts" / name / "failure.json").write_text('{"error": "none"}')
    sealed = {"salt": "x", "sets": labels}
    (folder / "sealed").mkdir()
    (folder / "sealed" / "labels.json").write_text(json.dumps(sealed))
    sums = {name: checksum(folder / "sets" / name) for name in NAMES}
    write_bank(Bank(folder, "score", sums, seal_of(sealed)))
    return read_bank(folder)


def label(**changes: Any) -> dict[str, Any]:
    return {"role": "free", "scene": "push", "protocol": "rich", **changes}


@pytest.mark.parametrize("names", [(), ("a",), ("a", "b", "c")])
def test_labels_are_those_of_the_sets(names: tuple[str, ...], recordings: Path, tmp_path: Path) -> None:
    bank = bank_of(tmp_path / "bank", recordings, {name: label() for name in names})
    with pytest.raises(ValueError, match=r"labels\.json: expected a label for each set of the bank and no other"):
        score(bank, tmp_path / "score")
    assert not (tmp_path / "score").exists()


def part(**changes: Any) -> dict[str, Any]:
    return {"name": "tether", "site": "dynamics", "parameters": {}, "severity": 1.0, **changes}


@pytest.mark.parametrize(
    "changes",
    [
        {"scene": "push\n# x"},
        {"protocol": "\x1b[31m"},
        {"simulator": "a\rb"},
        {"phases": ["\x07"]},
        {"right": [["\u202e"]]},
        {"parameters": {"a\nb": 1.0}},
        {"effects": [part(name="\x1b[2J")]},
        {"effects": [part(site="a\nb")]},
        {"effects": [part(parameters={"\n": 1.0})]},
    ],
)
def test_names_of_labels_move_no_cursor_and_end_no_line(
    changes: dict[str, Any], recordings: Path, tmp_path: Path
) -> None:
    bank = bank_of(tmp_path / "bank", recordings, {"a": label(**changes), "b": label()})
    with pytest.raises(ValueError, match=r"labels\.json: sets\.a.* must hold characters that are seen"):
        score(bank, tmp_path / "score")


def test_names_that_are_seen_break_no_table(recordings: Path, tmp_path: Path) -> None:
    strange = "<script>alert(1)</script>|x"
    bank = bank_of(tmp_path / "bank", recordings, {name: label(scene=strange) for name in NAMES})
    score(bank, tmp_path / "score")
    for name in ("results.md", "results.html"):
        assert "<script>alert" not in (tmp_path / "score" / name).read_text()
    table = _markdown([("scene", "n"), (strange, "2")]).splitlines()
    assert table[-1] == r"| &lt;script>alert(1)&lt;/script>\|x | 2 |"


def test_a_bank_without_a_set_is_none(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text("format: physid-bank\nversion: 1\npurpose: score\nseal: x\nsets: {}\n")
    with pytest.raises(ValueError, match=r"bank\.yaml: sets: expected one recording set at least"):
        read_bank(tmp_path)


@pytest.mark.parametrize("text", ["[1]", '{"a', "[" * 100_000, "null"])
def test_a_plan_that_is_none_is_said_with_its_file(text: str, tmp_path: Path) -> None:
    (tmp_path / "sealed").mkdir()
    (tmp_path / "sealed" / "plan.json").write_text(text)
    with pytest.raises(ValueError, match=r"plan\.json: expected "):
        seal(tmp_path, Plan("score", 0, SIZE), quiet=True)
    assert (tmp_path / "sealed" / "plan.json").read_text() == text
