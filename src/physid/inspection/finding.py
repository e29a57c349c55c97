"""Something that looks like a mistake, with what to do about it."""

from __future__ import annotations

from dataclasses import dataclass

from physid.data.refusals import worded


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

    @classmethod
    def of_file(cls, error: ValueError | OSError) -> Finding:
        """Return what is wrong with a file that cannot be read: errors say what, and after a semicolon the mend."""
        what, _, mend = (worded(error) if isinstance(error, OSError) else str(error)).partition("; ")
        return cls(what, mend or "correct the file, or leave it out")
