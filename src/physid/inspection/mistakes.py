"""Everything that may look like a mistake: what makes recordings useless, then what is odd about each kind of value."""

from __future__ import annotations

from physid.data.observations.remarks import remarks_on
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
    """Return what is odd about the clocks of trajectories."""
    said = [
        f"trajectory {index}: {remark}"
        for index, one in zip(seen.indices, seen.recordings, strict=True)
        for remark in remarks_on(one, seen.scene.time_step, seen.scene.sizes)
    ]
    found = [Finding(remark, "see docs/recordings.md, Time", wrong=False) for remark in said[:MOST_NAMED]]
    if len(said) > MOST_NAMED:
        found.append(Finding(f"{len(said) - MOST_NAMED} more such remarks", "as above", wrong=False))
    return found
