"""How a step turns forces into motion: time, scheme, free motion, impacts."""
