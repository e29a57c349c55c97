"""The last phase of learning from video: Gauss-Newton on parameters while the encoder stands still."""

from physid.training.refinement.horizon import Batch, Horizon, spread
from physid.training.refinement.refinement import Readings, Refinement

__all__ = ["Batch", "Horizon", "Readings", "Refinement", "spread"]
