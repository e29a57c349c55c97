"""A diagnosis that knows nothing: it stands in for the real one where only the steps around it are tested."""

from __future__ import annotations

from pathlib import Path

from tests.diagnosis.documents import said

from physid.data import RecordingSet
from physid.diagnosis.document.document import Diagnosis, write_diagnosis


def ignorant(recordings: RecordingSet, out: Path) -> Diagnosis:
    """Say `none` of everything."""
    document = said("none")
    write_diagnosis(out, document)
    return document


def failing(recordings: RecordingSet, out: Path) -> Diagnosis:
    """Fail."""
    raise ValueError("nothing moves")


def cheating(recordings: RecordingSet, out: Path) -> Diagnosis:
    """Open the labels."""
    (recordings.folder.parent.parent / "sealed" / "labels.json").read_text()
    return ignorant(recordings, out)
