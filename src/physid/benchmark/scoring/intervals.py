"""Intervals for shares, and the severity at which half of all effects are seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

LEVEL = 0.95
BOOTSTRAPS = 200
RIDGE = 0.05  # keeps the logistic curve finite where it separates the sets completely
STEPS = 30


def wilson(right: int, count: int, level: float = LEVEL) -> tuple[float, float]:
    """Return the interval of a share, `right` of `count` (Wilson 1927); without any it is 0 to 1.

    Args:
        right: Successes.
        count: Trials.
        level: Share of such intervals that hold the truth.
    """
    if not count:
        return 0.0, 1.0
    low, high = binomtest(right, count).proportion_ci(level, "wilson")
    return float(low), float(high)


def half_power(severities: Sequence[float], seen: Sequence[bool]) -> float | None:
    """Return the severity at which a logistic curve of log severity, fitted to what was seen, passes one half.

    Returns:
        The severity; None if nothing or everything was seen, or if what shows more is seen less.
    """
    x, y = np.log(np.asarray(severities, dtype=float)), np.asarray(seen, dtype=float)
    if len(y) < 2 or y.min() == y.max():
        return None
    middle, spread = x.mean(), x.std() + 1e-9
    design = np.stack([np.ones(len(x)), (x - middle) / spread], 1)
    weights = np.zeros(2)
    for _ in range(STEPS):
        p = 1 / (1 + np.exp(-np.clip(design @ weights, -30, 30)))
        slope = design.T @ (y - p) - RIDGE * weights
        curve = (design.T * (p * (1 - p))) @ design + RIDGE * np.eye(2)
        weights = weights + np.linalg.solve(curve, slope)
    if weights[1] <= 0:
        return None
    return float(np.exp(middle - spread * weights[0] / weights[1]))


def bootstrap_half_power(severities: Sequence[float], seen: Sequence[bool]) -> tuple[float, float] | None:
    """Return the 95 % bootstrap interval of `half_power`, within what was tried; None where most draws have none."""
    generator = np.random.default_rng(0)
    draws = (generator.integers(len(seen), size=len(seen)) for _ in range(BOOTSTRAPS))
    found = [half_power([severities[i] for i in draw], [seen[i] for i in draw]) for draw in draws]
    values = [value for value in found if value is not None]
    if 2 * len(values) < BOOTSTRAPS:
        return None
    low, high = np.clip(np.quantile(values, [0.025, 0.975]), min(severities), max(severities))
    return float(low), float(high)


def bootstrap_median(values: Sequence[float]) -> tuple[float, float]:
    """Return the 95 % bootstrap interval of a median."""
    generator, data = np.random.default_rng(0), np.asarray(values)
    draws = data[generator.integers(len(data), size=(BOOTSTRAPS, len(data)))]
    low, high = np.quantile(np.median(draws, 1), [0.025, 0.975])
    return float(low), float(high)


def calibration_error(confidence: NDArray[np.float64], right: NDArray[np.float64]) -> float:
    """Return the mean distance of confidence and share of right answers, over fifths of the range (Naeini 2015)."""
    place = np.minimum((5 * confidence).astype(int), 4)
    members = (place == k for k in range(5))
    return sum(abs(float((confidence[own] - right[own]).sum())) for own in members) / len(confidence)


def bootstrap_calibration_error(confidence: NDArray[np.float64], right: NDArray[np.float64]) -> tuple[float, float]:
    """Return the 95 % bootstrap interval of `calibration_error`; with few answers chance alone makes an error."""
    generator, count = np.random.default_rng(0), len(right)
    draws = generator.integers(count, size=(BOOTSTRAPS, count))
    low, high = np.quantile([calibration_error(confidence[draw], right[draw]) for draw in draws], [0.025, 0.975])
    return float(low), float(high)
