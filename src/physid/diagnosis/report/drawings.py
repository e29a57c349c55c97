"""Figures of the report: errors over time and by level, sizes, shares, evidence over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from physid.diagnosis.document.document import SPLITS, Diagnosis, Estimate, Share
from physid.diagnosis.document.residual_law import ResidualLaw
from physid.diagnosis.document.sentences import SPLIT_NAMES
from physid.diagnosis.report.contents import LEVELS, Curve, ReportData, TimeMap
from physid.pages.figures import CODES, SMALL, Series, drawing, line_chart, ticks, titled
from physid.pages.numbers import capital, in_unit, percent, quantity, words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINES = {"before": "nominal model, refitted", "after": "with the effect"}
LEVEL_NAMES = {"sensor": "Sensor", "numerical": "Numerics"}
SPREAD_FOR_LOGARITHM = 12.0  # if errors exceed the floor by this factor, only a logarithmic axis shows both
MOST_POINTS = 240
ROW = 0.27  # [inch] of a figure, for each row
Row = tuple[str, float, str, str]


def error_curves(curves: Sequence[Curve], said: Diagnosis) -> list[tuple[str, Markup]]:
    """Draw the errors over time of each split, all on one scale, with the floor."""
    gap = said.gap
    highest = max((float(line.max()) for curve in curves for line in curve.lines.values()), default=0.0)
    logarithmic = gap.floor > 0 and highest > SPREAD_FOR_LOGARITHM * gap.floor
    drawn = []
    for curve in sorted(curves, key=lambda curve: SPLITS.index(curve.split)):
        shown = np.unique(np.linspace(0, len(curve.time) - 1, MOST_POINTS).astype(int))
        series = [
            Series(LINES[name], name, curve.time[shown].tolist(), values[shown].tolist())
            for name, values in curve.lines.items()
        ]
        title = f"{capital(SPLIT_NAMES[curve.split])}: error over time"
        scale: Any = {
            "show": in_unit(gap.unit),
            "floor": gap.floor or None,
            "logarithmic": logarithmic,
            "top": 1.2 * highest,
        }
        drawn.append((SPLIT_NAMES[curve.split], line_chart(series, title, "time [s]", **scale)))
    return drawn


def error_levels(said: Diagnosis, data: ReportData) -> Markup | None:
    """Draw floors and gaps as points on one logarithmic scale, each with its value."""
    gap = said.gap
    rows = [(LEVEL_NAMES[name], data.levels.get(name), "soft") for name in LEVELS]
    rows.append(("Floor of the gap", gap.floor, "soft"))
    for split in SPLITS:
        error = said.errors(split)
        if error is not None:
            rows.append((f"Gap, {SPLIT_NAMES[split]}", error.before, "before"))
            rows.append(("with the effect", error.after, "after"))
            rows.append(("with a free force", data.residual_wrench.get(split), "free"))
    known = [(name, value, colour, quantity(value, gap.unit)) for name, value, colour in rows if value]
    if not known:
        return None
    with drawing(height=0.3 + ROW * len(known), left=0.43, right=0.8) as (axes, made):
        axes.set_xscale("log")
        _dots(axes, known)
        if gap.floor > 0:
            axes.axvline(gap.floor, color=CODES["floor"], linewidth=1, linestyle=(0, (4, 3)))
        axes.margins(x=0.08)
        axes.tick_params(axis="x", which="both", labelbottom=False)  # each row says its value
    return titled(made[0], "Levels of error")


def sizes(parameters: Mapping[str, Estimate]) -> list[Markup]:
    """Draw each parameter of an effect with its interval, beside 0, which is no effect."""
    return [
        titled(_span(words(name), value.value, value.low, value.high, value.unit), f"{words(name)} with its interval")
        for name, value in parameters.items()
    ]


def _span(name: str, value: float, low: float, high: float, unit: str) -> Markup:
    with drawing(height=0.5, left=0.05, right=0.95) as (axes, made):
        axes.plot([low, high], [0, 0], color=CODES["after"], linewidth=4, alpha=0.4)
        axes.plot([value], [0], "o", color=CODES["after"], markersize=7)
        axes.axvline(0, color=CODES["floor"], linewidth=1, linestyle=(0, (4, 3)))
        axes.set_yticks([])
        axes.margins(x=0.08)
        ticks(axes, "x", in_unit(unit), most=3)
    return made[0]


def closing(said: Diagnosis) -> Markup | None:
    """Draw which share of the gap closes on each split, with its interval."""
    shares: list[tuple[str, Share]] = []
    for split in SPLITS:
        share = said.share(split)
        if share is not None:
            shares.append((SPLIT_NAMES[split], share))
    if not shares:
        return None
    with drawing(height=0.4 + ROW * len(shares), left=0.36, right=0.96) as (axes, made):
        for row, (_, share) in enumerate(shares):
            if share.low is not None and share.high is not None:
                ends = np.clip([share.low, share.high], 0, 1).tolist()
                axes.plot(ends, [row, row], color=CODES["after"], linewidth=4, alpha=0.4, solid_capstyle="butt")
            axes.plot([min(max(share.value, 0), 1)], [row], "o", color=CODES["after"], markersize=7, clip_on=False)
        axes.set_yticks(range(len(shares)), [name for name, _ in shares])
        axes.set(xlim=(0, 1), ylim=(len(shares) - 0.5, -0.5))
        axes.set_xticks([0, 0.5, 1], [percent(value) for value in (0, 0.5, 1)])
    return titled(made[0], "Share of the gap that closes")


def residual_law(law: ResidualLaw) -> Markup | None:
    """Draw the size of a residual law over its variable, with its 90 % interval; None for a constant, and for a shift.

    Of a shift initial states follow what is steady or drifts, anew in each segment.
    """
    if law.variable is None or law.kind == "shift":
        return None
    with drawing(named=True) as (axes, made):
        axes.fill_between(law.at, law.low, law.high, color=CODES["free"], alpha=0.25, linewidth=0)
        axes.plot(law.at, law.size, color=CODES["free"], marker="o", markersize=3)
        axes.axhline(0, color=CODES["floor"], linewidth=1, linestyle=(0, (4, 3)))
        axes.set_xlabel(f"{law.variable} [{law.variable_unit}]")
        axes.margins(x=0.01)
        ticks(axes, "y", in_unit(law.unit))
    return titled(made[0], f"Size over {law.variable}")


def time_map(picture: TimeMap | None) -> Markup | None:
    """Draw the evidence over time, a row for each body and degree of freedom."""
    if picture is None:
        return None
    most = max(float(picture.evidence.max()), 1e-12)
    with drawing(height=0.6 + ROW * len(picture.rows), left=0.3, named=True) as (axes, made):
        for row, values in enumerate(picture.evidence):
            for start, end, value in zip(picture.edges[:-1], picture.edges[1:], values, strict=True):
                strength = min(max(float(value) / most, 0.0), 1.0)
                axes.barh(row, 0.97 * (end - start), 0.8, start, color=CODES["line"], align="center")
                axes.barh(row, 0.97 * (end - start), 0.8, start, color=CODES["heat-full"], alpha=strength)
        axes.set_yticks(range(len(picture.rows)), [f"{body} {dof}" for body, dof in picture.rows])
        axes.set_ylim(len(picture.rows) - 0.5, -0.5)
        axes.set_xlabel("time [s]")
        axes.grid(visible=False)
        axes.margins(x=0)
    return titled(made[0], "Evidence over time")


def _dots(axes: Axes, rows: Sequence[Row]) -> None:
    """Set a dot in each row, its name to the left and its value to the right."""
    for row, (_, value, colour, _) in enumerate(rows):
        axes.plot([value], [row], "o", color=CODES[colour], markersize=7)
    axes.set_yticks(range(len(rows)), [name for name, *_ in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    for row, (*_, text) in enumerate(rows):
        axes.text(1.02, row, text, transform=axes.get_yaxis_transform(), va="center", size=SMALL)
