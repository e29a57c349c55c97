"""Something that looks like a mistake, with what to do about it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """Something that looks like a mistake.

    Attributes:
        what: What is suspicious, with the figures that say so.
        mend: What to do about it.
        wrong: Whether nothing should be concluded before; else it is a remark.
    """

    what: str
    mend: str
    wrong: bool = True
