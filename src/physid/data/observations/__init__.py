"""Recorded trajectories as arrays, and the steps in which they are simulated."""
