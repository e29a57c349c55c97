"""How often verdicts of each kind are right: what a confidence may be set to."""

from __future__ import annotations

from collections import Counter

from physid.benchmark.bank import Bank
from physid.benchmark.judging import MEDIUM
from physid.benchmark.scoring import open_judged
from physid.diagnosis.document import VERDICTS


def calibrate(bank: Bank) -> dict[str, tuple[int, int]]:
    """Count right verdicts on a calibration bank, over sets that are free, or of medium severity and up.

    Args:
        bank: A calibration bank with all its verdicts.

    Returns:
        For each verdict how many were right, of how many.

    Raises:
        ValueError: If the bank is one to score by: what is tuned to it says nothing any more.
    """
    if bank.purpose != "calibration":
        raise ValueError(
            f"{bank.folder} is a bank to {bank.purpose} by: expected a calibration bank; "
            "make one: physid benchmark diagnosis seal --calibration"
        )
    judged, _ = open_judged(bank)
    clear = [one for one in judged if one.label.role == "free" or one.label.severity >= MEDIUM]
    right, count = Counter(one.verdict for one in clear if one.grouped), Counter(one.verdict for one in clear)
    return {verdict: (right[verdict], count[verdict]) for verdict in VERDICTS}
