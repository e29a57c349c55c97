"""A standard deviation that a few large values do not change."""

from __future__ import annotations

from torch import Tensor

NORMAL_MAD = 1.4826  # standard deviation over median absolute deviation, for a normal distribution
TRIM, TRIMMED = 3.0, 0.98661  # cut [standard deviations], and what it leaves of a normal standard deviation


def deviation(values: Tensor) -> Tensor:
    """Estimate a standard deviation from absolute values: by their median, then by those within a few of it."""
    rough = NORMAL_MAD * values.median()
    normal = values[values <= TRIM * rough]
    found: Tensor = normal.square().mean().sqrt() / TRIMMED
    return found
