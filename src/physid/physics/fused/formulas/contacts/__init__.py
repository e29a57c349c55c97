"""Where boxes touch, in scalars."""
