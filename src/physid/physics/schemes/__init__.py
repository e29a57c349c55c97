"""How a step turns forces into motion: time, scheme, units, motion without contacts, impacts, displacement."""
