"""The scheme `Midpoint` in scalars: what `physid.physics.schemes` does."""
