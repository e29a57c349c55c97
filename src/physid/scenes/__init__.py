"""What stands on the ground, how it is pushed, and which parameters are unknown."""
