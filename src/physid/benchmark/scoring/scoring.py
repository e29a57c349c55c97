"""Open the labels, judge every verdict, and write the figures."""

from __future__ import annotations

from pathlib import Path

from physid.benchmark.bank import Bank
from physid.benchmark.scoring.compare import beside_baselines
from physid.benchmark.scoring.figures import by_effect, by_recording, by_role, by_scene, by_severity, by_source, figures
from physid.benchmark.scoring.opening import diagnosed, open_judged
from physid.benchmark.scoring.results import Score, write_score


def score(bank: Bank, out: Path, *, so_far: bool = False) -> Score:
    """Score the verdicts on a bank, and write results.json, results.md, results.html and the pictures.

    Args:
        bank: The bank.
        out: Folder of the results.
        so_far: Whether sets that have no verdict yet are left out.

    Returns:
        The score.

    Raises:
        ValueError: If a set (with `so_far`, every set) has no verdict yet, a recording or the labels were changed after
            sealing.
    """
    bank = diagnosed(bank) if so_far else bank
    judged, labels = open_judged(bank)
    tables = {
        "By role": by_role(judged),
        "By severity": by_severity(judged),
        "By scene, of sets that are free or of medium severity and up": by_scene(judged),
        "By simulator, of sets that are free or of medium severity and up": by_recording(judged),
        "By source, of sets that are free or of medium severity and up": by_source(judged),
        "Beside simpler methods": beside_baselines(bank, judged, labels),
        "Not answered well, of sets that are free or of medium severity and up": by_effect(judged),
    }
    result = Score(figures(judged), tables, judged)
    write_score(bank, result, out)
    return result
