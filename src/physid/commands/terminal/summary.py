"""What a run ends with, in a few lines with units."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from physid.estimation.measurement.unexplained import lack_of_fit_sentence, not_fitted_sentence, unexplained_kinds
from physid.estimation.prediction.coordinates import Unknown, correlated_names, logged_names
from physid.inspection.finding import Findings, trust_sentence
from physid.strict import one_line

LEAST_MOVE = 1e-3  # [standard errors] of estimates that is worth a number


def summarize(figures: Mapping[str, float], folder: Path, recordings: str = "RECORDINGS") -> str:
    """Return the figures of a run as lines: parameters with units and intervals, what is left, what looks wrong.

    Args:
        figures: What was logged, by name.
        folder: Of the run, with findings.json.
        recordings: The set that was fitted, to name in advice.
    """
    names, doubtful = logged_names(figures, "estimate"), bool(unexplained_kinds(figures))
    measured = sorted(key for key in figures if key.startswith(("test/", "val/")) and not key.endswith("_deviation"))
    effort = [key for key in ("evaluations", "seconds") if key in figures]
    width = max(map(len, [*names, *measured, *effort]), default=0)
    lines = [f"{folder}"]
    for name in names:
        own = {key.rpartition("/")[2]: value for key, value in figures.items() if key.startswith(f"params/{name}/")}
        lines.append(f"  {name:<{width}}  {_estimate(own, Unknown.of(name).unit, doubtful)}")
    for key in sorted(key for key in figures if key.startswith("correlation/")):
        lines.append(f"  correlation of {' and '.join(correlated_names(key))}: {figures[key]:+.2f}")
    lines += [f"  {key:<{width}}  {_measured(key, figures)}" for key in measured]
    lines += [f"  {key:<{width}}  {figures[key]:.6g}" for key in effort]
    lines += [f"  {_steps(figures)}"] if "steps/mean" in figures else []
    kept = Findings.read(folder)
    said = [
        not_fitted_sentence(figures),
        lack_of_fit_sentence(figures, recordings),
        kept and trust_sentence(kept.findings, kept.recordings),
    ]
    return "\n".join(map(one_line, [*lines, *(f"  {one}" for one in said if one is not None)]))


def _estimate(own: Mapping[str, float], unit: str, doubtful: bool) -> str:
    """Write an estimate with its interval, its true value, and whether the recordings identify it.

    Args:
        own: Figures of the parameter.
        unit: Its unit.
        doubtful: Whether the fit leaves more than noise; intervals hold where the model does.
    """
    estimate, true = own["estimate"], own.get("true")
    level = "90 % if the model held" if doubtful else "90 %"
    known = [f"{level}: {own['low']:.6g} to {own['high']:.6g}"] if {"low", "high"} <= own.keys() else []
    if true is not None:
        known.append(f"true {true:.6g}" + (f", off by {abs(estimate / true - 1):.3%}" if true else ""))
    warning = "" if own.get("observable", 1.0) else "  DO NOT RELY ON IT: these recordings do not identify it by itself"
    return f"{estimate:.6g}{f' {unit}' * bool(unit)}" + (f" ({'; '.join(known)})" if known else "") + warning


def _steps(figures: Mapping[str, float]) -> str:
    """Write the steps that were chosen, and what shorter ones would change."""
    mean, largest, bias, left = (figures.get(f"steps/{name}", 0.0) for name in ("mean", "largest", "bias", "left"))
    moved = f"{bias + left:.2g} standard errors at most" if bias + left >= LEAST_MOVE else "next to nothing"
    return (
        f"steps of the engine: {mean:.3g} from frame to frame on average, {largest:.0f} at most; shorter ones would "
        f"move estimates by {moved}"
    )


def _measured(key: str, figures: Mapping[str, float]) -> str:
    """Write an error of a test, and its deviation over trajectories: positions relative to the size, else degrees."""
    scale, unit = (100.0, "% of the size") if "position_error" in key else (1.0, "deg" * ("rotation_error" in key))
    spread = figures.get(f"{key}_deviation")
    return f"{scale * figures[key]:.4g}{'' if spread is None else f' +- {scale * spread:.2g}'} {unit}".rstrip()
