"""What a better model would have to add: the law by which a residual force, torque or shift of the picture acts."""

from physid.diagnosis.residual_law.search import ResidualLaws, find_residual_laws

__all__ = ["ResidualLaws", "find_residual_laws"]
