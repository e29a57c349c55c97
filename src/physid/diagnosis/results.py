"""What a diagnosis leaves in its folder: the document, the report with its film, the next experiment."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from physid.data.files import write_text
from physid.diagnosis.conclusion.conclusion import Conclusion
from physid.diagnosis.document.document import Diagnosis, write_diagnosis
from physid.diagnosis.fitted_model import missing_effects, save_model
from physid.diagnosis.reference.nominal_fit_cache import clear_cache
from physid.diagnosis.report.figures import draw
from physid.diagnosis.report.page import write_report
from physid.one_writer import one_writer

NEXT, MISSING = "next_experiment.yaml", "missing_effects.py"


@contextmanager
def results_in(out: Path) -> Iterator[None]:
    """Be the only diagnosis that writes into a folder; once it has ended, nothing but results is left there.

    One that is interrupted leaves what it goes on from.

    Raises:
        FolderInUseError: If another process writes into it.
    """
    with one_writer(out):
        yield
        clear_cache(out)


def write_results(out: Path, document: Diagnosis, conclusion: Conclusion, save: Path | None = None) -> None:
    """Write report.html, diagnosis.json and, where they help, next_experiment.yaml and missing_effects.py.

    Args:
        out: The folder.
        document: What diagnosis.json holds.
        conclusion: What was concluded, with the fits and the hypotheses behind it.
        save: Where to write the model with what was found, as a configuration of `physid fit`; None for nowhere.
    """
    further = {
        NEXT: conclusion.further.config if conclusion.further else None,
        MISSING: missing_effects(out / MISSING, conclusion),
    }
    for name in further:
        (out / name).unlink(missing_ok=True)  # of an earlier diagnosis; this one may have none
    write_report(out, document, draw(out, conclusion, document.seconds or 0.0, further[MISSING]))
    write_diagnosis(out, document)
    for name, text in further.items():
        if text:
            write_text(out / name, text)
    if save is not None:
        save_model(save, conclusion)
