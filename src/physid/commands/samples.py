"""The command that draws parameters from what a fit knows of them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

KINDS = (".csv", ".npz", ".yaml")


def sample(run: Path, *, count: int = 100, out: Path | None = None, seed: int = 0) -> None:
    """Draw sets of parameters from what a fit knows of them, for domain randomisation.

    A fit leaves RUN/posterior.json: its estimates, their covariance, units and ranges. Each draw is one world that the
    recordings allow: parameters that the fit knows only together vary together, as a heavier block with less
    friction. Logarithms of masses and friction, and sizes of effects, are drawn from a normal distribution; what lies
    beyond a physical range is drawn again. The result is plain numbers in SI units, one row for each world, for any
    simulator. Intervals allow for the noise and for what differs between trajectories; a model that leaves more than
    noise of the recordings (`physid fit` says so) is not made right by randomisation: diagnose it first.

    Examples:
      physid sample runs/mine
      physid sample runs/mine --count 1000 --seed 7 --out worlds.npz

    Args:
        run: Folder of a fit that has come to its end.
        count: How many sets.
        out: File of the result, .csv, .npz or .yaml; RUN/samples.csv by default.
        seed: Of the draws; the same seed gives the same sets.
    """
    from physid.training.parameters.posterior import read_posterior

    if count < 1:
        raise ValueError(f"--count must be at least 1, got {count}")
    if not 0 <= seed < 2**63:
        raise ValueError(f"--seed must be a whole number from 0 to 2^63 - 1, got {seed}")
    target = out or (run if run.is_dir() else run.parent) / "samples.csv"
    if target.suffix not in KINDS:
        raise ValueError(f"--out must end in {', '.join(KINDS)}, got {target.name}")
    known = read_posterior(run)
    drawn = known.sample(count, seed)
    write_samples(target, known.names, drawn)
    print(f"{target}: {count} set{'s' * (count != 1)} of {len(known.names)} parameter{'s' * (len(known.names) != 1)}")
    for one, mean, spread in zip(known.space.unknowns, drawn.mean(0), drawn.std(0, correction=0), strict=True):
        print(f"  {one.name}: mean {float(mean):.6g}, deviation {float(spread):.2g}{f' {one.unit}' * bool(one.unit)}")


def write_samples(path: Path, names: tuple[str, ...], drawn: Tensor) -> None:
    """Write sets of parameters (count, P), whole or not at all: a table, an array for each name, or a list."""
    import csv
    import io

    import numpy as np
    import yaml

    from physid.data.files import write_text, write_whole

    if path.suffix == ".npz":
        columns = dict(zip(names, drawn.T.numpy(), strict=True))

        def save(part: Path) -> None:
            with part.open("wb") as file:
                np.savez(file, **columns)

        write_whole(path, save)
    elif path.suffix == ".yaml":
        worlds = [dict(zip(names, row, strict=True)) for row in drawn.tolist()]
        write_text(path, yaml.safe_dump(worlds, sort_keys=False))
    else:
        table = io.StringIO()
        writer = csv.writer(table, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(drawn.tolist())
        write_text(path, table.getvalue())
