"""Rules of what looks like a mistake, by what they look at; each returns one finding or none."""

from __future__ import annotations

from physid.inspection.rules import clocks, energy, falls, ground, shown, sizes, torques, tracking

PLACES = (sizes.runs, falls.falls, ground.carried, ground.lying, ground.orders, ground.heights, ground.adrift)
"""Of one cause with many signs: the first that speaks names it, and the others would repeat it as another."""
RULES = (
    sizes.sizes, sizes.masses, falls.upside, torques.forces_and_torques, clocks.delay, energy.energy,
    tracking.turns, tracking.held, tracking.repeats, tracking.jumps, clocks.dropped, clocks.lengths, tracking.unseen,
    tracking.covered, sizes.tare, shown.hidden,
)  # fmt: skip
