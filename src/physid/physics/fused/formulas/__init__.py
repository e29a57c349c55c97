"""The physics of a step, written in scalars: what `physid.physics.step` does, formula by formula."""
