"""Something that looks like a mistake, with what to do about it."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

from physid.data.files import write_text
from physid.data.refusals import worded
from physid.strict import one_line
from physid.typed_files import CLOSED, read_json_as

FILE = "findings.json"
logger = logging.getLogger("physid")


@dataclass(frozen=True)
class Finding:
    """Something that looks like a mistake.

    Attributes:
        what: What is suspicious, with the figures that say so.
        mend: What to do about it.
        wrong: Whether nothing should be concluded before; else it is a remark.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    what: str
    mend: str
    wrong: bool = True

    @classmethod
    def of_file(cls, error: ValueError | OSError) -> Finding:
        """Return what is wrong with a file that cannot be read: errors say what, and after a semicolon the mend."""
        what, _, mend = (worded(error) if isinstance(error, OSError) else str(error)).partition("; ")
        return cls(what, mend or "correct the file, or leave it out")

    def text(self) -> str:
        """Return it as one sentence."""
        return f"{'looks wrong: ' * self.wrong}{self.what}; {self.mend}"


@dataclass(frozen=True)
class Findings:
    """The content of findings.json, which a run leaves beside its result.

    Attributes:
        recordings: The recording set.
        findings: What looks like a mistake in it, or is odd; empty where nothing is.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    recordings: str
    findings: tuple[Finding, ...]

    def write(self, folder: Path) -> None:
        """Write findings.json, whole or not at all."""
        write_text(folder / FILE, json.dumps(asdict(self), indent=2) + "\n")

    @classmethod
    def read(cls, folder: Path) -> Findings | None:
        """Read findings.json; None where a run has left none.

        Raises:
            OSError: If it cannot be read, or is a link that leads out of the folder.
            ValueError: If the file is damaged; names it.
        """
        path = folder / FILE
        return read_json_as(cls, path, within=folder) if path.is_file() else None


def ordered(findings: Iterable[Finding]) -> list[Finding]:
    """Return what is wrong first, then remarks."""
    return sorted(findings, key=lambda one: not one.wrong)


def warn_of(findings: Iterable[Finding], where: object) -> None:
    """Warn of what looks like a mistake in a set, before anything is computed from it."""
    for one in ordered(findings):
        logger.warning("%s: %s", where, one_line(one.text()))


def trust_sentence(findings: Iterable[Finding], where: str = "these recordings") -> str | None:
    """Say how many things look wrong in the recordings behind a result; None where nothing does."""
    wrong = sum(one.wrong for one in findings)
    if not wrong:
        return None
    return (
        f"{wrong} thing{'s look' if wrong > 1 else ' looks'} wrong in {where}, which may be all that the result says: "
        "mend it, or know it to be right, before you rely on the result (physid check, physid show)"
    )
