"""What a diagnosis leaves in its folder: the document, the report with its film, the next experiment."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from physid.data.files import write_text
from physid.diagnosis.conclusion.conclusion import Conclusion
from physid.diagnosis.document.document import Diagnosis, write_diagnosis
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.report.figures import draw
from physid.diagnosis.report.overlay import overlay
from physid.diagnosis.report.page import write_report
from physid.diagnosis.selection.search import Attribution

NEXT = "next_experiment.yaml"


def write_results(
    out: Path, document: Diagnosis, nominal_fit: NominalFit, found: Attribution, conclusion: Conclusion
) -> None:
    """Write report.html, diagnosis.json and, where one would help, next_experiment.yaml.

    Args:
        out: The folder.
        document: What diagnosis.json holds.
        nominal_fit: The recordings and the fitted nominal model.
        found: What the search found.
        conclusion: What was concluded, with the hypotheses behind it.
    """
    observations = nominal_fit.observations
    data = draw(observations.title, nominal_fit, found, conclusion, document.seconds or 0.0)
    film = overlay(out, observations.sources, observations, found.whole_nominal, conclusion)
    write_report(out, document, dataclasses.replace(data, overlay=film))
    write_diagnosis(out, document)
    if conclusion.further and conclusion.further.config:
        write_text(out / NEXT, conclusion.further.config)
