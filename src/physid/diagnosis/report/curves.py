"""Pictures of how far the gap closes: errors over time, and the levels of error on one scale."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physid.diagnosis.document.document import SPLITS, Diagnosis, Gap, Split
from physid.diagnosis.document.sentences import SPLIT_NAMES, capital, closed, percent, quantity
from physid.diagnosis.report.contents import LEVELS, Curve, ReportData
from physid.diagnosis.report.elements import Markup, card, element

LINES = {"before": "nominal model, refitted", "after": "with the effect", "freeform": "with a free residual wrench"}
SPREAD_FOR_LOGARITHM = 12.0  # if errors exceed the floor by this factor, only a logarithmic axis shows both
TICKS = 5
ROOM = 1.12  # free room beyond the largest value
MOST_POINTS = 240
LEVEL_NAMES = {
    "sensor": "Sensor floor",
    "repeatability": "Repeatability floor",
    "numerical": "Numerical floor",
}


class Axis:
    """A vertical axis from a range of errors to 0 (bottom) .. 100 (top)."""

    def __init__(self, low: float, high: float, logarithmic: bool) -> None:
        self.logarithmic = logarithmic
        self.low = low / ROOM if logarithmic else 0.0
        self.high = high * ROOM

    def place(self, value: float | NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where a value lies; what is beyond an end lies at it."""
        values = np.clip(np.asarray(value, dtype=np.float64), self.low, self.high)
        if self.logarithmic:
            return 100 * np.log(values / self.low) / math.log(self.high / self.low)
        return 100 * values / self.high

    def ticks(self) -> list[float]:
        """Return round values in the range, few enough to be read."""
        decades = range(math.floor(math.log10(self.high)) - 6, math.floor(math.log10(self.high)) + 1)
        if self.logarithmic:
            for steps in ((1, 2, 5), (1, 3), (1,)):
                found = [step * 10.0**power for power in decades for step in steps]
                found = [value for value in found if self.low <= value <= self.high]
                if len(found) <= TICKS + 1:
                    break
            return found
        raw = self.high / TICKS
        size = 10.0 ** math.floor(math.log10(raw))
        step = next(step for step in (size, 2 * size, 5 * size, 10 * size) if step >= raw)
        return [step * k for k in range(int(self.high / step) + 1)]


def error_curves(curves: Sequence[Curve], gap: Gap) -> Markup | None:
    """Draw the errors over time of each split, all on one axis, with the floor."""
    if not curves:
        return None
    values = np.concatenate([line for curve in curves for line in curve.lines.values()])
    low = float(min([gap.floor or np.inf, *values[values > 0]], default=1.0))
    high = float(max(values.max(), gap.floor, 1e-9))
    floor = gap.floor if gap.floor > 0 else low
    axis = Axis(max(low, floor / 4), high, high / floor > SPREAD_FOR_LOGARITHM)
    plots = [_plot(curve, axis, gap) for curve in sorted(curves, key=lambda curve: SPLITS.index(curve.split))]
    names = [name for name in LINES if any(name in curve.lines for curve in curves)]
    legend = [element("span", element("i", class_=f"key {name}"), LINES[name]) for name in names]
    legend.append(element("span", element("i", class_="key floor"), f"floor {quantity(gap.floor, gap.unit)}"))
    scale = ", logarithmic scale" if axis.logarithmic else ""
    return card(
        f"Error over time, held-out trajectories{scale}",
        element("div", plots, class_="plots"),
        element("div", legend, class_="legend"),
        note="Root mean square of the position error over the trajectories.",
        wide=True,
    )


def _plot(curve: Curve, axis: Axis, gap: Gap) -> Markup:
    """Draw one split; labels are text beside the drawing, so that they keep their size on a phone."""
    start, end = float(curve.time[0]), float(curve.time[-1])
    shown = np.unique(np.linspace(0, len(curve.time) - 1, MOST_POINTS).astype(int))
    across = 100 * (curve.time[shown] - start) / (end - start)
    ticks = axis.ticks()
    lines = [_level(float(axis.place(tick)), "grid-line") for tick in ticks]
    lines.append(_level(float(axis.place(gap.floor)), "line floor"))
    for name in reversed(list(curve.lines)):
        points = zip(across, 100 - axis.place(curve.lines[name][shown]), strict=True)
        lines.append(element("polyline", points=" ".join(f"{x:.2f},{y:.2f}" for x, y in points), class_=f"line {name}"))
    labels = [
        element("span", quantity(tick, gap.unit) if tick else "0", style=f"bottom: {float(axis.place(tick)):.2f}%")
        for tick in ticks
    ]
    title = f"{capital(SPLIT_NAMES[curve.split])}: error over time"
    drawing = element("svg", lines, viewBox="0 0 100 100", preserveAspectRatio="none", role="img", aria_label=title)
    return element(
        "figure",
        element("figcaption", capital(SPLIT_NAMES[curve.split])),
        element("div", element("div", labels, class_="y"), drawing, class_="plot"),
        element("div", [element("span", f"{time:.3g} s") for time in np.linspace(start, end, 3)], class_="ends x"),
    )


def _level(height: float, kind: str) -> Markup:
    return element("line", x1=0, x2=100, y1=f"{100 - height:.2f}", y2=f"{100 - height:.2f}", class_=kind)


def error_levels(diagnosis: Diagnosis, pictures: ReportData) -> Markup | None:
    """Draw floors and gaps as points on one logarithmic scale."""
    gap = diagnosis.gap
    rows = [(LEVEL_NAMES[name], pictures.levels[name], "floor") for name in LEVELS if name in pictures.levels]
    rows.append(("Floor of the gap", gap.floor, "floor"))
    for split in SPLITS:
        error = diagnosis.errors(split)
        if error is None:
            continue
        name = SPLIT_NAMES[split]
        rows.append((f"Gap, {name}", error.before, "before"))
        if error.after is not None:
            rows.append(("… with the effect", error.after, "after"))
        if split in pictures.residual_wrench:
            rows.append(("… with a free residual", pictures.residual_wrench[split], "freeform"))
    known = [value for _, value, _ in rows if value]
    if not known:
        return None
    axis = Axis(min(known) / ROOM, max(known), logarithmic=True)
    lines = [_row(name, value, kind, axis, gap) for name, value, kind in rows]
    note = "Dots on one logarithmic scale; the dashed line is the floor. Parameter bias is listed apart, below."
    return card("Levels of error", element("div", lines, class_="levels"), note=note)


def _row(name: str, value: float | None, kind: str, axis: Axis, gap: Gap) -> list[Markup]:
    marks = []
    if gap.floor > 0:
        marks.append(element("b", style=f"left: {float(axis.place(gap.floor)):.1f}%"))
    if value is not None:
        marks.append(element("i", class_=f"dot {kind}", style=f"left: {float(axis.place(max(value, axis.low))):.1f}%"))
    text = "no repeats" if value is None else quantity(value, gap.unit)
    return [
        element("span", name, class_="inset" if name.startswith("…") else None),
        element("span", marks, class_="track"),
        element("span", text, class_="number"),
    ]


def shares(diagnosis: Diagnosis, pictures: ReportData) -> Markup | None:
    """Draw which share of the gap closes on each split, with its interval."""
    blocks = [_share(diagnosis, split) for split in SPLITS if diagnosis.errors(split) is not None]
    if not any(each.after is not None for each in map(diagnosis.errors, SPLITS) if each):
        return None
    if diagnosis.gap.transfer is None:
        blocks.append(element("p", "There is no transfer protocol.", class_="small soft size"))
    level = percent(pictures.interval)
    note = f"(before - after) / (before - floor) with its {level} interval over trajectories; the scale ends at 100 %."
    return card("Share of the gap that closes", *blocks, note=note)


def _share(diagnosis: Diagnosis, split: Split) -> Markup:
    share = diagnosis.share(split)
    name = element("p", SPLIT_NAMES[split], class_="small soft")
    if share is None:
        return element("div", name, element("p", "too near to the floor for a share"), class_="size")
    value, interval = closed(share)
    left, middle, right = (100 * min(max(getattr(share, key), 0.0), 1.0) for key in ("low", "value", "high"))
    marks = [
        element("u", style=f"left: {left:.1f}%; width: {max(right - left, 0.8):.1f}%"),
        element("i", class_="dot after", style=f"left: {middle:.1f}%"),
    ]
    return element(
        "div",
        name,
        element("p", value, class_="big"),
        element("p", interval, class_="small soft number"),
        element("div", marks, class_="track"),
        class_="size",
    )
