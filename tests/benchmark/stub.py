"""A diagnosis that knows nothing: it stands in for the real one where only the steps around it are tested."""

from __future__ import annotations

from pathlib import Path

from tests.diagnosis.documents import said

from physid.diagnosis.document.document import Diagnosis, write_diagnosis


def ignorant(recordings: Path, out: Path) -> Diagnosis:
    """Say `none` of everything."""
    document = said("none")
    write_diagnosis(out, document)
    return document


def failing(recordings: Path, out: Path) -> Diagnosis:
    """Fail."""
    raise ValueError("nothing moves")


def cheating(recordings: Path, out: Path) -> Diagnosis:
    """Open the labels."""
    (recordings.parent.parent / "sealed" / "labels.json").read_text()
    return ignorant(recordings, out)
