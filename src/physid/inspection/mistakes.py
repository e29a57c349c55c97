"""Everything that may look like a mistake: what makes recordings useless, then what is odd about each kind of value."""

from __future__ import annotations

from physid.inspection import rules, tracking_rules, usability
from physid.inspection.energy import energy
from physid.inspection.evidence import Evidence
from physid.inspection.finding import Finding
from physid.inspection.shown import hidden

RULES = (
    rules.sizes, rules.upside, rules.falls, rules.lying, rules.orders, rules.heights, rules.forces,
    tracking_rules.delay, energy, tracking_rules.turns, tracking_rules.repeats, tracking_rules.jumps,
    tracking_rules.unseen, hidden,
)  # fmt: skip


def mistakes_in(seen: Evidence) -> list[Finding]:
    """Return what looks like a mistake, or is odd."""
    found = (rule(seen) for rule in RULES)
    return usability.mistakes_in(seen.motion) + [one for one in found if one is not None]
