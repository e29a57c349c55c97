"""The verdict, and how sure it is."""

from __future__ import annotations

from collections.abc import Iterable

from torch import Tensor

from physid.diagnosis.conclusion.gap import Closing
from physid.diagnosis.document.document import Verdict
from physid.diagnosis.selection.evidence import complete, explained, improves_held_out
from physid.diagnosis.selection.search import Attribution, unexplained
from physid.diagnosis.settings.conclusion import VerdictSettings
from physid.diagnosis.testing import Hypothesis

BLAMING: tuple[Verdict, ...] = ("named", "group", "partial")
"""Verdicts that name effects."""


def judge(found: Attribution, transfer: Closing | None, *, before: bool, after: bool) -> Verdict:
    """Turn what the search found into a verdict.

    Args:
        found: What the search found.
        transfer: How far the gap closes on another protocol.
        before: Whether the nominal model leaves the recordings by more than the tolerance.
        after: Whether the best hypothesis still does.
    """
    if not before:
        return "none"
    if found.best is None or found.left is None:
        return "unknown" if unexplained(found) else "none"
    settings = found.nominal.settings.verdict
    whole = not after or complete(found.nominal, found.best, found.lack, found.left)
    open_share = found.left.missing / explained(found.nominal, found.best, found.lack)
    if not _carries(transfer, settings) or (not whole and open_share > settings.partly):
        return "unknown"
    if not whole:
        return "partial" if transfer is None or _open(transfer, settings) <= settings.partly else "unknown"
    return "group" if len(found.group) > 1 or found.alike else "named"


def indistinguishable_from_zero(chosen: Hypothesis, covariance: Tensor, closings: Iterable[Closing | None]) -> bool:
    """Return whether effects explain nothing: no size differs from that of no effect, and there is no gap to close.

    After impacts an effect may fit what is left a little better than chance without being there.

    Args:
        chosen: The effects that would be blamed.
        covariance: Of the shared parameters, shape (P, P).
        closings: How far gaps close; None where a protocol is missing.
    """
    if any(one is not None and one.shrink is not None for one in closings):
        return False
    return len(chosen.absent(covariance)) == len(chosen.names)


def reconsider(verdict: Verdict, nominal: Hypothesis, best: Hypothesis) -> Verdict:
    """Return the verdict where the effects that were found are hollow.

    Where they are but a part, what they leave is there without them. What leaves nothing and foretells trajectories
    that nothing was fitted to is there: it shows in a few impacts, from which its size is hardly known. All else may be
    chance.
    """
    if verdict == "partial":
        return "unknown"
    return verdict if improves_held_out(nominal, best) else "none"


def in_all_frames(verdict: Verdict, closings: Iterable[Closing | None], settings: VerdictSettings) -> Verdict:
    """Return the verdict once the gap is seen in all frames: blamed effects close most of it on each protocol.

    What closes less is no part of the cause: something else imitates it in the segments that decided. Where no protocol
    shows a gap, nothing is a part of it.

    Args:
        verdict: By the segments that decided.
        closings: How far gaps close in all frames; None where a protocol is missing.
        settings: How much may be left.
    """
    if verdict not in BLAMING:
        return verdict
    known = [one for one in closings if one is not None and one.shrink is not None]
    closed = all(_open(one, settings) <= settings.partly for one in known)
    return verdict if closed and (known or verdict != "partial") else "unknown"


def _carries(transfer: Closing | None, settings: VerdictSettings) -> bool:
    """Return whether another protocol contradicts what was found: a gap is left there, and less than a half closes."""
    if transfer is None or _open(transfer, settings) == 0:
        return True
    return transfer.shrink is not None and transfer.shrink.most > settings.carries


def _open(closing: Closing, settings: VerdictSettings) -> float:
    """Return the share of a gap that is left, 0 if there is none, or no more than few frames show by chance."""
    if closing.shrink is None or closing.after is None:
        return 0.0
    if closing.after < max(settings.nearly * closing.floor, closing.ceiling(settings.chance)):
        return 0.0
    return 1 - closing.shrink.value
