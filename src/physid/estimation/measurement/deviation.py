"""How rough values are from frame to frame, and a standard deviation that a few large ones do not change."""

from __future__ import annotations

from torch import Tensor

NORMAL_MAD = 1.4826  # standard deviation over median absolute deviation, for a normal distribution
TRIM, TRIMMED = 3.0, 0.98661  # cut [standard deviations], and what it leaves of a normal standard deviation


def bends(value: Tensor, good: Tensor, span: int = 1) -> tuple[Tensor, Tensor]:
    """Return by how much frames leave the middle of two neighbours, r_t - (r_{t-k} + r_{t+k}) / 2.

    Args:
        value: r, shape (R, T, N, C).
        good: Positive in frames that count, shape (R, T, N).
        span: Frames k to a neighbour.

    Returns:
        Shape (R, T - 2 k, N, C), and in which all three frames count, (R, T - 2 k, N).
    """
    before, middle, after = slice(None, -2 * span), slice(span, -span), slice(2 * span, None)
    counts = (good[:, middle] > 0) & (good[:, before] > 0) & (good[:, after] > 0)
    return value[:, middle] - (value[:, before] + value[:, after]) / 2, counts


def deviation(values: Tensor) -> Tensor:
    """Estimate a standard deviation from absolute values: by their median, then by those within a few of it."""
    rough = NORMAL_MAD * values.median()
    normal = values[values <= TRIM * rough]
    found: Tensor = normal.square().mean().sqrt() / TRIMMED
    return found
