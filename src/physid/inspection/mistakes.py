"""Everything that may look like a mistake: what makes recordings useless, then what is odd about each kind of value."""

from __future__ import annotations

from collections.abc import Sequence

from physid.data.observations.remarks import Remark, remarks_on
from physid.inspection import usability
from physid.inspection.evidence import Evidence
from physid.inspection.finding import Finding
from physid.inspection.rules import PLACES, RULES
from physid.inspection.rules.units import positions

MOST_NAMED = 5


def mistakes_in(seen: Evidence) -> list[Finding]:
    """Return what looks like a mistake, or is odd."""
    return usability.mistakes_in(seen.motion) + oddities_in(seen)


def oddities_in(seen: Evidence) -> list[Finding]:
    """Return what looks like a mistake in recordings that are not useless (see `usability`), or is odd."""
    unit = positions(seen)
    if unit is not None:
        return [unit[0], *oddities_in(unit[1])]  # what else is wrong shows in metres alone
    place = next((one for rule in PLACES if (one := rule(seen)) is not None), None)
    found = [place, *(rule(seen) for rule in RULES)]
    return [one for one in found if one is not None] + _remarks_on(seen)


def _remarks_on(seen: Evidence) -> list[Finding]:
    """Return what is odd about the clocks of trajectories: each kind once, with all that have it and the largest."""
    kinds: dict[str, list[tuple[int, Remark]]] = {}
    for index, one in zip(seen.indices, seen.recordings, strict=True):
        for remark in remarks_on(one, seen.scene.time_step, seen.scene.sizes):
            kinds.setdefault(remark.kind, []).append((index, remark))
    return [Finding(_together(found), "see docs/recordings.md, Time", wrong=False) for found in kinds.values()]


def _together(found: Sequence[tuple[int, Remark]]) -> str:
    """Say one remark of several trajectories, which they are, and where it is largest if they differ."""
    largest, remark = max(found, key=lambda one: one[1].size)
    if len(found) == 1:
        return f"trajectory {largest}: {remark.text}"
    named = ", ".join(str(index) for index, _ in found[:MOST_NAMED])
    more = f" and {len(found) - MOST_NAMED} more" if len(found) > MOST_NAMED else ""
    where = f" (most in {largest})" if len({one.text for _, one in found}) > 1 else ""
    return f"trajectories {named}{more}{where}: {remark.text}"
