"""Why a result may not be relied on: recordings that the model leaves unexplained, or that look like a mistake."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from physid.dashboard.folders import IDENTIFIABILITY
from physid.diagnosis.document.document import Diagnosis
from physid.estimation.measurement.unexplained import lack_of_fit_sentence, not_fitted_sentence, unexplained_kinds
from physid.inspection.finding import Finding, Findings, ordered
from physid.typed_files import check_as


def doubts_about(
    folder: Path,
    figures: Mapping[str, float],
    recordings: str,
    said: Diagnosis | None,
    identifiability: Mapping[str, Any],
) -> list[str]:
    """Return why a result may not be relied on, one sentence each, and what else is odd about its recordings.

    Args:
        folder: Run folder.
        figures: Figures of a fit, by name.
        recordings: The recording set that it read, to name in advice.
        said: The diagnosis in the folder, if there is one.
        identifiability: The content of identifiability.json; empty without one.
    """
    doubts = [one for one in [not_fitted_sentence(figures)] if one is not None]
    if unexplained_kinds(figures):
        doubt = "The intervals of the parameters hold for a model that explains the recordings; "
        doubts.append(doubt + str(lack_of_fit_sentence(figures, recordings)))
    try:
        kept = Findings.read(folder)
        judged = [check_as(Finding, one, IDENTIFIABILITY) for one in identifiability.get("findings") or ()]
    except (ValueError, OSError) as error:
        return [*doubts, str(error)]
    found = [*(said.findings if said else ()), *(kept.findings if kept else ()), *judged]
    return doubts + [one.text() for one in ordered(found)]
