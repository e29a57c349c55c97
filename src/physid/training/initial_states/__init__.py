"""Initial states of trajectories: given, guessed, or fitted together with the parameters."""
