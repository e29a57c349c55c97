"""A picture of what can be observed: the directions in the space of parameters, and how well each is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from physid.data.files import write_picture
from physid.training.parameters import Identifiability, percent

CEILING = 10.0
"""Relative standard deviation at which bars end: an estimate that is off by so much says nothing."""


def draw(result: Identifiability, title: str, path: Path) -> None:
    """Draw the expected deviation of each direction as a bar, and the exponents of its product as a row of squares.

    Args:
        result: What was found.
        title: What was examined.
        path: The image to write.
    """
    from matplotlib.figure import Figure

    count = len(result.names)
    _, deviations, directions = (value.numpy() for value in result.transposed())
    figure = Figure(figsize=(4.5 + 1.1 * count, 1.6 + 0.55 * count), layout="constrained")
    squares, bars = figure.subplots(1, 2, sharey=True, width_ratios=[count, 4])
    squares.imshow(directions, vmin=-1, vmax=1, cmap="RdBu", aspect="auto")
    for (row, column), exponent in np.ndenumerate(directions):
        colour = "white" if abs(exponent) > 0.6 else "black"
        squares.text(column, row, f"{exponent:.2f}", ha="center", va="center", color=colour)
    squares.set(xticks=range(count), yticks=range(count), ylabel="direction")
    squares.set_xticklabels(result.names, rotation=20, ha="right")
    shown = np.minimum(deviations, CEILING)
    colours = ["tab:blue" if one <= result.accept else "tab:red" for one in deviations]
    bars.barh(range(count), 100 * shown, color=colours, height=0.6)
    for row, deviation in enumerate(deviations):
        bars.text(100 * shown[row], row, f" {percent(deviation)}", va="center")
    bars.axvline(100 * result.accept, color="black", linestyle=":", label="accepted")
    low = 100 * min(float(shown.min()), result.accept) / 3
    bars.set(xscale="log", xlim=(low, 100 * CEILING * 5), xlabel="known to [%]")
    bars.legend(fontsize=8)
    figure.suptitle(title, fontsize=9)
    write_picture(path, figure)
