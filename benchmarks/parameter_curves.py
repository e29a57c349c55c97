"""Draw how parameters approach the truth while encoder and physics learn together, for several runs of `physid fit`.

    python benchmarks/parameter_curves.py runs/paper_method/* --out curves.svg

Each run's metrics.csv says how far its parameters are off after each epoch; epochs are counted from the last one in
which the parameters stood still.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
from matplotlib.ticker import FuncFormatter

OFF, ESTIMATE = "/relative_error", "/estimate"
STYLES = {"supervised": "-", "self_supervised": "--"}


def curves(run: Path) -> dict[str, list[float]]:
    """Return by how much each learned parameter of a run is off, from the last epoch before it moves on [-]."""
    with (run / "metrics.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row.get("train/loss")]
    names = [key.removesuffix(ESTIMATE) for key in rows[0] if key.startswith("params/") and key.endswith(ESTIMATE)]
    names = [name for name in names if not name.endswith("by_gradient")]
    found = {}
    for name in names:
        value = [float(row[name + ESTIMATE]) for row in rows]
        still = next((k for k, one in enumerate(value) if one != value[0]), len(value)) - 1
        found[name.removeprefix("params/")] = [abs(float(row[name + OFF])) for row in rows[max(still, 0) :]]
    return found


def main() -> None:
    """Draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="+", help="folders of runs")
    parser.add_argument("--out", type=Path, required=True, help="the picture, .svg or .png")
    given = parser.parse_args()
    mpl.rcParams["svg.hashsalt"] = "physid"
    figure, axes = plt.subplots(figsize=(9.0, 5.2), layout="constrained")
    count = 0
    for run in sorted(given.runs):
        style = next((line for kind, line in STYLES.items() if run.name.startswith(kind)), "-.")
        for parameter, off in curves(run).items():
            label = f"{run.name}: {parameter.rsplit('.', 1)[-1]}, {100 * off[-1]:.2g} %"
            axes.semilogy(range(len(off)), off, style, color=f"C{count % 10}", label=label, linewidth=1.6)
            count += 1
    axes.set_xlabel("epochs in which encoder and parameters learn together")
    axes.set_ylabel("parameter off by")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100 * value:g} %"))
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=9, frameon=False, loc="upper right")
    figure.savefig(given.out, metadata={"Date": None} if given.out.suffix == ".svg" else None)


if __name__ == "__main__":
    main()
