"""Intervals for shares, and the severity at which half of all effects are seen."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

LEVEL = 0.95
BOOTSTRAPS = 200
RIDGE = 0.05  # keeps the logistic curve finite where it separates the sets completely


def wilson(right: int, count: int, level: float = LEVEL) -> tuple[float, float]:
    """Return the interval of a share of so many (Wilson 1927); without any the interval is 0 to 1."""
    if not count:
        return 0.0, 1.0
    low, high = stats.binomtest(right, count).proportion_ci(level, "wilson")
    return float(low), float(high)


def half_power(severities: Sequence[float], seen: Sequence[bool]) -> float | None:
    """Return the severity at which a logistic curve of log severity, fitted to what was seen, passes one half.

    Returns:
        The severity; None if nothing or everything was seen, or if what shows more is seen less. A severity of zero,
        which has no logarithm, is left out.
    """
    known = [(one, found) for one, found in zip(severities, seen, strict=True) if one > 0]
    x, y = np.log([one for one, _ in known]), np.asarray([found for _, found in known], dtype=float)
    if len(y) < 2 or y.min() == y.max():
        return None
    middle, spread = x.mean(), x.std() + 1e-9
    design = np.stack([np.ones(len(x)), (x - middle) / spread], 1)

    def loss(weights: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        at = design @ weights
        slope = design.T @ (1 / (1 + np.exp(-at)) - y) + RIDGE * weights
        return float(np.logaddexp(0, at).sum() - y @ at + RIDGE * weights @ weights / 2), slope

    weights = optimize.minimize(loss, np.zeros(2), jac=True, options={"gtol": 1e-9}).x
    return float(np.exp(middle - spread * weights[0] / weights[1])) if weights[1] > 0 else None


def bootstrap_half_power(severities: Sequence[float], seen: Sequence[bool]) -> tuple[float, float] | None:
    """Return the 95 % bootstrap interval of `half_power`, within what was tried; None where most draws have none."""
    if len(severities) < 2:  # every draw is the same one
        return None

    def one(severity: NDArray[np.float64], found: NDArray[np.bool_]) -> float:
        value = half_power(severity.tolist(), found.tolist())
        return np.nan if value is None else value

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", stats.DegenerateDataWarning)  # draws without a half are left out below
        drawn = _bootstrap(one, np.asarray(severities, dtype=float), np.asarray(seen)).bootstrap_distribution
    values = drawn[np.isfinite(drawn)]
    if 2 * len(values) < BOOTSTRAPS:
        return None
    low, high = np.clip(np.quantile(values, [0.025, 0.975]), min(severities), max(severities))
    return float(low), float(high)


def bootstrap_median(values: Sequence[float]) -> tuple[float, float]:
    """Return the 95 % bootstrap interval of a median."""
    data = np.asarray(values, dtype=float)
    if len(data) == 1:
        return float(data[0]), float(data[0])
    return _ends(_bootstrap(np.median, data))


def calibration_error(confidence: NDArray[np.float64], right: NDArray[np.float64]) -> float:
    """Return the mean distance of confidence and share of right answers, over fifths of the range (Naeini 2015)."""
    place = np.minimum((5 * confidence).astype(int), 4)
    members = (place == k for k in range(5))
    return sum(abs(float((confidence[own] - right[own]).sum())) for own in members) / len(confidence)


def bootstrap_calibration_error(confidence: NDArray[np.float64], right: NDArray[np.float64]) -> tuple[float, float]:
    """Return the 95 % bootstrap interval of `calibration_error`; with few answers chance alone makes an error."""
    if len(right) == 1:
        return (calibration_error(confidence, right),) * 2
    return _ends(_bootstrap(calibration_error, confidence, right))


def _bootstrap(statistic: Callable[..., Any], *data: NDArray[Any]) -> Any:
    """Draw sets with replacement, the same ones in every call (Efron 1979)."""
    return stats.bootstrap(
        data,
        statistic,
        n_resamples=BOOTSTRAPS,
        paired=True,
        vectorized=False,
        confidence_level=LEVEL,
        method="percentile",
        rng=np.random.default_rng(0),
    )


def _ends(drawn: Any) -> tuple[float, float]:
    low, high = drawn.confidence_interval
    return float(low), float(high)
