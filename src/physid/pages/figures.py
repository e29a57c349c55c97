"""Figures of pages: drawn by matplotlib as SVG, in colours that the page's stylesheet gives them, light or dark."""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from markupsafe import Markup

from physid.pages.numbers import figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = (
    *("ink", "soft", "line", "card", "accent", "before", "after", "free", "floor", "heat-full", "muted", "truth"),
    *(f"s{index}" for index in range(8)),
)
"""Variables of the stylesheet; in a drawing each has a colour of its own, which is then replaced by the variable."""
CODES = {name: f"#fe01{index:02x}" for index, name in enumerate(COLOURS)}
WIDE, HIGH = 4.0, 2.2  # [inch] of a figure of usual size
SMALL = 11  # [pt] of text; 10 to 15 px on a screen
DECADES_FROM = 12.0  # if values differ by this factor, only a logarithmic axis shows them all
_numbers = itertools.count()


@dataclass(frozen=True)
class Series:
    """A line of a chart.

    Attributes:
        label: For the legend.
        colour: A variable of the stylesheet, see `COLOURS`.
        x: Where.
        y: What.
        style: Of the line: -, -- or :.
        key: Set as the class of the line, so that a page can hide it; may be empty.
    """

    label: str
    colour: str
    x: Sequence[float]
    y: Sequence[float]
    style: str = "-"
    key: str = ""


@contextmanager
def drawing(
    width: float = WIDE, height: float = HIGH, *, left: float = 0.2, right: float = 0.98, named: bool = False
) -> Iterator[tuple[Axes, list[Markup]]]:
    """Open a figure of some size [inch] with one pair of axes; afterwards the list holds the finished SVG.

    `left` and `right` are where the axes begin and end, as shares of the width: labels are beside them; `named` leaves
    room for the name of the horizontal axis.
    """
    import matplotlib
    from matplotlib.figure import Figure

    number = next(_numbers)
    settings: Any = {
        **{f"{each}.color": CODES["soft"] for each in ("xtick", "ytick")},
        **{f"axes.spines.{side}": False for side in ("top", "right", "left")},
        "axes.labelcolor": CODES["soft"],
        "axes.edgecolor": CODES["line"],
        "axes.grid": True,
        "axes.grid.axis": "y",
        "axes.axisbelow": True,
        "grid.color": CODES["line"],
        "grid.linewidth": 0.8,
        "text.color": CODES["ink"],
        "text.parse_math": False,
        "font.size": SMALL,
        "font.family": "sans-serif",
        "svg.fonttype": "none",
        "svg.hashsalt": f"physid{number}",
        "svg.id": f"figure{number}",
        "lines.linewidth": 1.8,
        "lines.solid_capstyle": "round",
        "xtick.major.size": 0,
        "ytick.major.size": 0,
        "ytick.minor.size": 0,
        "xtick.minor.size": 0,
        "legend.frameon": False,
        "figure.subplot.left": left,
        "figure.subplot.right": right,
        "figure.subplot.top": 1 - 0.08 / height,
        "figure.subplot.bottom": (0.5 if named else 0.3) / height,
    }
    made: list[Markup] = []
    with matplotlib.rc_context(settings):
        canvas = Figure(figsize=(width, height))
        axes = canvas.subplots()
        axes.patch.set_visible(False)
        canvas.patch.set_visible(False)
        yield axes, made
        file = io.StringIO()
        canvas.savefig(file, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    made.append(Markup(_themed(file.getvalue())))  # matplotlib escapes the texts of its SVG  # nosec B704


def code(name: str) -> str:
    """Return the colour that stands for a variable of the stylesheet; also for those of runs, run0, run1 and so on."""
    return CODES[name] if name in CODES else f"#fd{int(name.removeprefix('run')):04x}"


def _themed(text: str) -> str:
    """Turn matplotlib's file into an element of a page: its colours are variables, its letters the page's."""
    text = text[text.index("<svg") :]
    for name, written in CODES.items():
        text = text.replace(written, f"var(--{name})")
    text = re.sub("#fd([0-9a-f]{4})", lambda found: f"var(--run{int(found[1], 16)})", text)
    text = re.sub(r' width="[\d.]+pt" height="[\d.]+pt"| xmlns(:xlink)?="[^"]*"| version="1.1"', "", text, count=5)
    text = re.sub(r"font: ([\d.]+px) [^;\"]*", r"font-size: \1", text)
    text = re.sub(r"font-family: [^;\"]*; ", "", text)
    text = re.sub(r"<!--.*?-->|<g/>", "", text, flags=re.S)
    text = text.replace("xlink:href", "href").replace("<svg", '<svg class="figure"', 1)
    text = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", text, flags=re.S)
    # Identifiers of matplotlib, say axes_1, are the same in each figure of a page; nothing refers to them.
    text = re.sub(r' id="(?!p[0-9a-f]{10}|m[0-9a-f]{10}|line-)[^"]*"', "", text)
    return re.sub(r"\n\s*", "\n", re.sub(r' id="line-([^"]*)"', r' class="line \1"', text))


def ticks(axes: Axes, which: Literal["x", "y"], show: Callable[[float], str], most: int = 5) -> None:
    """Let an axis, x or y, write at most about so many ticks, each as `show` writes it."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis = axes.xaxis if which == "x" else axes.yaxis
    if axis.get_scale() == "log":
        for parts in ((1, 2, 5), (1, 3), (1,)):
            axis.set_major_locator(LogLocator(subs=parts, numticks=12))
            low, high = sorted(axis.get_view_interval())
            if sum(low <= tick <= high for tick in axis.get_majorticklocs()) <= most + 1:
                break
        else:
            axis.set_major_locator(LogLocator(numticks=most))
        axis.set_minor_formatter(NullFormatter())
    else:
        axes.locator_params(axis=which, nbins=most)
    axis.set_major_formatter(FuncFormatter(lambda value, _: show(value) if value else "0"))


def line_chart(
    series: Sequence[Series],
    title: str,
    axis: str,
    *,
    show: Callable[[float], str] = figure,
    band: tuple[float, float] | None = None,
    truths: Sequence[float] = (),
    floor: float | None = None,
    logarithmic: bool | None = None,
    top: float | None = None,
) -> Markup:
    """Draw lines over one axis.

    Args:
        series: The lines.
        title: What the drawing shows, for who cannot see it.
        axis: Name of the horizontal axis, with its unit.
        show: Writes a value with its unit.
        band: An interval, drawn behind.
        truths: Values that are known, drawn as dashed lines.
        floor: A value below which nothing can be, drawn as a dashed line.
        logarithmic: Whether the values are on a logarithmic scale; None for one that shows them all.
        top: Upper end of the scale; None for what the values need.

    Returns:
        The SVG element.
    """
    values = [value for each in series for value in each.y]
    positive = [value for value in values if value > 0]
    if logarithmic is None:
        logarithmic = bool(values) and min(values) > 0 and max(values) / min(values) > 4 * DECADES_FROM
    with drawing(named=True) as (axes, made):
        axes.set_yscale("log" if logarithmic else "linear")
        for each in reversed(series):
            (line,) = axes.plot(each.x, each.y, each.style, color=code(each.colour), label=each.label)
            if len(each.x) <= 40:
                line.set(marker="o", markersize=3)
            line.set_gid(f"line-{each.key}")
        if band:
            axes.axhspan(*band, color=CODES["after"], alpha=0.16, linewidth=0)
        for value in truths:
            axes.axhline(value, color=CODES["truth"], linewidth=1.4, linestyle=(0, (4, 3)))
        if floor:
            axes.axhline(floor, color=CODES["floor"], linewidth=1.2, linestyle=(0, (4, 3)))
        if logarithmic and floor:
            axes.set_ylim(bottom=min(max(min(positive, default=floor), floor / 4), floor) / 1.2)
        elif floor:
            axes.set_ylim(bottom=0)
        if top:
            axes.set_ylim(top=top)
        axes.set_xlabel(axis)
        axes.margins(x=0.01)
        ticks(axes, "y", show)
    return titled(made[0], title)


def titled(svg: Markup, title: str) -> Markup:
    """Give a drawing a name for who cannot see it."""
    label = Markup('<svg role="img" aria-label="{}"').format(title)
    return Markup(svg.replace("<svg", label, 1))  # the drawing is Markup already, the title is escaped  # nosec B704
