"""Physical parameters that are learned, the loss on poses, and the steps and intervals of their fit."""
