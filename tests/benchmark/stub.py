"""A diagnosis that knows nothing: it stands in for the real one where only the steps around it are tested."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tests.diagnosis.documents import diagnosis

from physid.diagnosis.document.document import write_diagnosis


def ignorant(recordings: Path, out: Path) -> Mapping[str, Any]:
    """Say `none` of everything."""
    document = diagnosis("none")
    write_diagnosis(out, document)
    return document


def failing(recordings: Path, out: Path) -> Mapping[str, Any]:
    """Fail."""
    raise ValueError("nothing moves")


def cheating(recordings: Path, out: Path) -> Mapping[str, Any]:
    """Open the labels."""
    (recordings.parent.parent / "sealed" / "labels.json").read_text()
    return ignorant(recordings, out)
