"""Pictures of a score: confusions, power, reliability."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from physid.benchmark.scoring.figures import reliability, truth_of
from physid.benchmark.scoring.judging import BINS, MEDIUM, STRONG, WEAK, Judged

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas
    from matplotlib.patches import Patch

LETTER = 0.075  # [inch] width of a letter of the names
INK, GRID, DOT = "#1f2933", "#d9dee3", "#2b6cb0"


def draw_confusion(judged: Sequence[Judged]) -> Canvas:
    """Draw what was hidden (rows) against what was said (columns), for free sets and those of medium severity and up.

    Each row is one hidden effect, its number of sets behind the name; a frame marks what would be right.
    """
    clear = [one for one in judged if one.label.role == "free" or one.label.severity >= MEDIUM]
    if not clear:
        empty = _canvas(7.0, 1.2)
        empty.text(0.5, 0.5, "no effect-free set and none of medium severity", ha="center", va="center", color=INK)
        return empty
    listed = ("free", "catalogue", "alias", "pair", "triple", "native", "outside")
    order = {role: place for place, role in enumerate(listed)}
    rows = sorted({(order[one.label.role], one.label.role, truth_of(one)) for one in clear})
    said = {one.answer for one in clear}
    last = [word for word in ("none", "unknown", "failed") if word in said or word != "failed"]
    columns = [*sorted(said - set(last)), *last]
    counts = np.zeros((len(rows), len(columns)))
    for one in clear:
        row = rows.index((order[one.label.role], one.label.role, truth_of(one)))
        counts[row, columns.index(one.answer)] += 1
    names = [f"{role}: {truth} ({n:.0f})" for (_, role, truth), n in zip(rows, counts.sum(1), strict=True)]
    beside, below = (LETTER * max(map(len, words)) for words in (names, columns))
    canvas = _canvas(max(7.0, 0.8 + beside + 0.27 * len(columns)), 1.2 + below + 0.24 * len(rows))
    axes = canvas.add_subplot()
    share = counts / np.maximum(counts.sum(1, keepdims=True), 1)
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1.3, aspect="auto")
    for row, column in zip(*counts.nonzero(), strict=True):
        ink = "white" if share[row, column] > 0.6 else INK
        axes.text(column, row, f"{counts[row, column]:.0f}", ha="center", va="center", color=ink, fontsize=7)
    for row, (_, role, truth) in enumerate(rows):
        for column, answer in enumerate(columns):
            if answer in _right(clear, role, truth):
                axes.add_patch(_frame(column, row))
    axes.set_yticks(range(len(rows)), names)
    axes.set_xticks(range(len(columns)), columns, rotation=90)
    axes.tick_params(labelsize=7, length=0)
    axes.set_xlabel("blamed", color=INK)
    axes.set_title(f"hidden against blamed; severity {MEDIUM:g} and up; frames: right answers", fontsize=9, color=INK)
    return canvas


def draw_power(judged: Sequence[Judged]) -> Canvas:
    """Draw the shares of sets that are flagged, and named within their group, over severity."""
    hidden = [one for one in judged if one.label.role != "free" and one.label.severity > 0]
    canvas = _canvas(5.2, 3.4)
    axes = canvas.add_subplot()
    edges = np.geomspace(0.01, 10, 9)
    severities = np.array([one.label.severity for one in hidden])
    for title, marker, colour, hit in (
        ("flagged", "o", DOT, [one.flagged for one in hidden]),
        ("answered right", "s", "#c05621", [one.grouped for one in hidden]),
    ):
        place = np.digitize(severities, edges)
        bins = [place == k for k in range(len(edges) + 1) if (place == k).any()]
        centre = [np.exp(np.log(severities[members]).mean()) for members in bins]
        share = [100 * np.mean(np.array(hit)[members]) for members in bins]
        axes.plot(centre, share, marker=marker, color=colour, label=title, linewidth=1.5)
    for limit, name in zip((WEAK, MEDIUM, STRONG), BINS[1:], strict=True):
        axes.axvline(limit, color=GRID, zorder=0)
        axes.text(limit * 1.05, 2, name, fontsize=7, color=INK)
    axes.set_xscale("log")
    axes.set_ylim(-3, 103)
    axes.set_xlabel("severity: displacement that no nominal model follows, over the sensor's noise", fontsize=8)
    axes.set_ylabel("sets [%]", fontsize=8)
    _finish(axes)
    axes.legend(fontsize=8, frameon=False)
    return canvas


def draw_reliability(judged: Sequence[Judged]) -> Canvas:
    """Draw the share of right verdicts over the confidence that they came with."""
    canvas = _canvas(3.6, 3.4)
    axes = canvas.add_subplot()
    axes.plot([0, 100], [0, 100], color=GRID)
    pairs = reliability(judged)
    levels = sorted({round(confidence, 2) for confidence, _ in pairs})
    for level in levels:
        right = [hit for confidence, hit in pairs if round(confidence, 2) == level]
        axes.scatter(100 * level, 100 * np.mean(right), s=12 + 4 * len(right), color=DOT, alpha=0.8)
        place = (100 * level, 100 * np.mean(right))
        axes.annotate(f"{len(right)}", place, fontsize=7, xytext=(5, 5), textcoords="offset points")
    axes.set_xlim(-3, 103)
    axes.set_ylim(-3, 103)
    axes.set_xlabel("confidence [%]", fontsize=8)
    axes.set_ylabel("right [%]; numbers: sets", fontsize=8)
    _finish(axes)
    return canvas


def _right(clear: Sequence[Judged], role: str, truth: str) -> set[str]:
    """Return the answers that would be right for a row."""
    label = next(one.label for one in clear if one.label.role == role and truth_of(one) == truth)
    if label.right:
        return {" + ".join(sorted(names)) for names in label.right}
    return {"unknown" if label.effects else "none"}


def _canvas(width: float, height: float) -> Canvas:
    from matplotlib.figure import Figure as Canvas

    return Canvas(figsize=(width, height), layout="constrained")


def _frame(column: int, row: int) -> Patch:
    from matplotlib.patches import Rectangle

    return Rectangle((column - 0.5, row - 0.5), 1, 1, fill=False, edgecolor="#c05621", linewidth=1.2)


def _finish(axes: Axes) -> None:
    axes.tick_params(labelsize=8)
    axes.grid(color=GRID, linewidth=0.5)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
