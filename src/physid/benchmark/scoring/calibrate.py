"""How often verdicts of each kind are right: what a confidence may be set to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from physid.benchmark.bank import Bank
from physid.benchmark.scoring.judging import MEDIUM, Judged
from physid.benchmark.scoring.opening import open_judged
from physid.diagnosis.document.document import VERDICTS
from physid.diagnosis.settings.conclusion import ConfidenceSettings

Counts = Mapping[str, tuple[int, int]]
AFTER_HITS = "none after hits"
TOGETHER = ("named", "group")  # counted together: whether rivals remain depends on the protocol


def calibrate(bank: Bank) -> Counts:
    """Count right verdicts on a calibration bank.

    Args:
        bank: A calibration bank with all its verdicts.

    Returns:
        What `count` returns.

    Raises:
        ValueError: If the bank is one to score by: what is tuned to it says nothing any more.
    """
    if bank.purpose != "calibration":
        raise ValueError(
            f"{bank.folder} is a bank to {bank.purpose} by: expected a calibration bank; "
            "make one: physid benchmark diagnosis seal --calibration"
        )
    return count(open_judged(bank)[0])


def count(judged: Iterable[Judged]) -> Counts:
    """Count, for each kind of verdict, how many were right, of how many: of sets that are free, or medium and up."""
    clear = [one for one in judged if one.label.role == "free" or one.label.severity >= MEDIUM]
    right, all_of = Counter(_kind(one) for one in clear if one.grouped), Counter(_kind(one) for one in clear)

    def of(*kinds: str) -> tuple[int, int]:
        return sum(right[kind] for kind in kinds), sum(all_of[kind] for kind in kinds)

    return {kind: of(*(TOGETHER if kind in TOGETHER else (kind,))) for kind in (*VERDICTS, AFTER_HITS)}


def as_settings(counts: Counts) -> str:
    """Spell counts as settings of a diagnosis, which then become the defaults of `ConfidenceSettings`."""
    names = {verdict: verdict for verdict in VERDICTS} | {AFTER_HITS: "none_after_impacts"}
    return "\n".join(f"confidence.{name}=[{', '.join(map(str, counts[kind]))}]" for kind, name in names.items())


def _kind(one: Judged) -> str:
    """Return the kind of a verdict; whether a `none` came after impacts shows in how sure it was."""
    if one.verdict != "none":
        return one.verdict
    known = ConfidenceSettings()
    plain, after = ((right + 1) / (all_of + 2) for right, all_of in (known.none, known.none_after_impacts))
    return AFTER_HITS if abs(one.confidence - after) < abs(one.confidence - plain) else "none"
