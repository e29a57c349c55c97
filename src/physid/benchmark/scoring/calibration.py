"""Collect evidence and truth on calibration banks, for the probabilities of causes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from physid.benchmark.bank import Bank, write_bank
from physid.benchmark.films import seen_poses
from physid.benchmark.scoring.baselines import bic_weights
from physid.benchmark.scoring.judging import MEDIUM, Judged
from physid.benchmark.scoring.opening import diagnosed, open_judged
from physid.benchmark.scoring.training import TABLE, Case, quality, read_table, write_training
from physid.diagnosis.document.evidence import NONE, OTHER, UNKNOWN, Evidence, hypothesis
from physid.diagnosis.posterior.evidence import read_evidence


def calibrate(banks: Sequence[Bank], out: Path, known: Sequence[Case] = ()) -> list[tuple[str, ...]]:
    """Collect the evidence on calibration banks with all their verdicts, train on it, and write table and coefficients.

    Args:
        banks: The banks.
        out: Folder of the table and of the coefficients.
        known: Sets of an earlier table, which count as well; of two with one name, that of the banks does.

    Returns:
        How good the probabilities are on sets that were left out, see `quality`.

    Raises:
        ValueError: If a bank is one to score by (what is tuned to it says nothing any more), if a verdict is missing,
            or if no set is free of effects or of medium severity.
    """
    cases: list[Case] = []
    for bank in banks:
        if bank.purpose != "calibration":
            raise ValueError(
                f"{bank.folder} is a bank to {bank.purpose} by: expected a calibration bank; "
                "make one: physid benchmark diagnosis seal --calibration; "
                "or, once it is scored and never to be scored by again, say --spent"
            )
        cases += collect(bank, open_judged(bank)[0])
    if not cases:
        raise ValueError("calibrate: expected a verdict on a set that is free or of medium severity, found none")
    new = {case.name for case in cases}
    return quality(write_training(out, [*(case for case in known if case.name not in new), *cases]))


def spend(banks: Sequence[Bank], so_far: bool = False) -> list[Bank]:
    """Turn banks whose verdicts are all there into ones for calibration, in their bank.yaml, for good; all or none.

    Args:
        banks: The banks.
        so_far: Whether one verdict of each is enough.

    Returns:
        They, as far as they have verdicts.

    Raises:
        ValueError: If verdicts are missing: what is diagnosed later would not be sealed any more.
    """
    for bank in banks:
        open_judged(diagnosed(bank) if so_far else bank)
    spent = [replace(bank, purpose="calibration") for bank in banks]
    for bank in spent:
        write_bank(bank)
    return [diagnosed(bank) for bank in spent]


def earlier_table(name: str) -> list[Case]:
    """Read the training table of an earlier calibration; `shipped` is the one that ships."""
    return read_table(TABLE if name == "shipped" else Path(name))


def collect(bank: Bank, judged: Iterable[Judged]) -> list[Case]:
    """Collect the evidence on the sets of a bank that are free, or of medium severity and up, and have a verdict."""
    cases = []
    for one in judged:
        if one.verdict == "failed" or (one.label.role != "free" and one.label.severity < MEDIUM):
            continue
        folder = bank.verdict(one.name)
        document, evidence = read_evidence(folder, seen_poses(bank.recordings(one.name), folder))
        truth, weights = _truth(one, evidence), bic_weights(document, 6 * evidence.poses)
        right = {*map(hypothesis, one.label.right), *truth}
        bic = max(weights.values()), sum(weights.get(cause, 0.0) for cause in right)
        where = one.label.simulator, one.label.frame_rate, one.label.scene
        cases.append(Case(f"{bank.folder.name}/{one.name}", *where, truth, evidence, bic))
    return cases


def _truth(one: Judged, evidence: Evidence) -> tuple[str, ...]:
    """Return which of the causes that are listed are right answers."""
    if not one.label.right:
        return (UNKNOWN if one.label.effects else NONE,)
    right = [hypothesis(names) for names in one.label.right]
    return tuple(name for name in evidence.behind if name in right) or (OTHER,)
