"""Which effects: candidates are fitted, compared on held-out trajectories, and kept or dropped."""
