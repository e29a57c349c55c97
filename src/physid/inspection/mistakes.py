"""Everything that may look like a mistake: what makes recordings useless, then what is odd about each kind of value."""

from __future__ import annotations

from physid.inspection import usability
from physid.inspection.evidence import Evidence
from physid.inspection.finding import Finding
from physid.inspection.rules import PLACES, RULES


def mistakes_in(seen: Evidence) -> list[Finding]:
    """Return what looks like a mistake, or is odd."""
    place = next((one for rule in PLACES if (one := rule(seen)) is not None), None)
    found = [place, *(rule(seen) for rule in RULES)]
    return usability.mistakes_in(seen.motion) + [one for one in found if one is not None]
