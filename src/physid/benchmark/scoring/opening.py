"""Opening the labels of a bank, once every verdict is there."""

from __future__ import annotations

from dataclasses import replace

from physid.benchmark.bank import Bank
from physid.benchmark.labels import Label, open_labels
from physid.benchmark.scoring.judging import Judged, judge
from physid.benchmark.verdicts import FAILURE, TIME, Spent, is_open
from physid.data import RecordingSet
from physid.diagnosis.document.document import FILE, read_diagnosis
from physid.record import checksum
from physid.typed_files import read_json_as


def diagnosed(bank: Bank) -> Bank:
    """Return the bank as far as it has verdicts, for a score before the end.

    Raises:
        ValueError: If it has none.
    """
    there = {name: mark for name, mark in bank.sets.items() if not is_open(bank, name)}
    if not there:
        raise ValueError(
            f"{bank.folder}: expected a verdict on one set at least, found none; "
            f"first: physid benchmark diagnosis diagnose --bank {bank.folder}"
        )
    return replace(bank, sets=there)


def open_judged(bank: Bank) -> tuple[list[Judged], dict[str, Label]]:
    """Check that all verdicts are there and nothing was changed, then open the labels and judge."""
    waiting = [name for name in bank.sets if is_open(bank, name)]
    if waiting:
        raise ValueError(
            f"{bank.folder}: expected a verdict on each of the {len(bank.sets)} sets before the labels are opened, "
            f"found none on {len(waiting)} ({', '.join(waiting[:3])}{', ...' if len(waiting) > 3 else ''}); "
            f"first: physid benchmark diagnosis diagnose --bank {bank.folder}"
        )
    for name, mark in bank.sets.items():
        if checksum(bank.recordings(name)) != mark:
            raise ValueError(f"{bank.recordings(name)}: expected the recordings that were sealed, found others")
        RecordingSet(bank.recordings(name)).verify()
    labels = open_labels(bank)
    return [_judged(bank, name, labels[name]) for name in bank.sets], labels


def _judged(bank: Bank, name: str, label: Label) -> Judged:
    folder = bank.verdict(name)
    if (folder / FAILURE).is_file():
        return Judged(name, label, "failed")
    return judge(name, read_diagnosis(folder / FILE), label, read_json_as(Spent, folder / TIME))
