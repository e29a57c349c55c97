"""The commands that run many experiments, and that show many runs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from physid.commands.terminal.screen import resumable, styled


def dashboard(
    folder: Path = Path("runs"), *, out: Path | None = None, light: bool = False, wandb: str | None = None
) -> None:
    """Write one page about every run in a folder.

    Fits, benchmarks and diagnoses in a table that sorts and filters; for each its parameters beside the truth, curves,
    films and report; chosen runs side by side. The page needs no network and can be sent as one file.

    Examples:
      physid dashboard
      physid dashboard runs/reproduce --out page.html

    Args:
        folder: The folder with the runs; runs by default.
        out: The HTML file to write; FOLDER/dashboard.html by default.
        light: Leave out films, images and reports.
        wandb: ENTITY/PROJECT of Weights & Biases, to publish a workspace with the same panels there.
    """
    from physid.dashboard.page import write_dashboard

    target = out or folder / "dashboard.html"
    runs = write_dashboard(folder, target, light=light)
    print(f"{target}: {len(runs)} run{'s' * (len(runs) != 1)}, {target.stat().st_size / 1e6:.2f} MB")
    if wandb:
        from physid.dashboard.workspace import publish

        print(publish(runs, wandb))


def reproduce(
    *,
    profile: str = "quick",
    cell: str | None = None,
    seeds: int = 1,
    out: Path | None = None,
    configs: Path | None = None,
    workers: int = -1,
    at_once: int = 1,
    backend: Literal["loky", "dask"] = "loky",
    scheduler: str | None = None,
    again: bool = False,
) -> None:
    """Run the experiments of the paper and print what they measure beside its figures.

    Every cell is a shipped configuration with recordings of its own. A second call resumes where the first stopped.
    The table lands in OUT/results.json and OUT/results.md, each run in OUT/CELL.

    Examples:
      physid reproduce --profile quick
      physid reproduce --cell sysid/push_mass,sysid/push_friction
      physid reproduce --profile paper --cell supervised/push_friction

    Args:
        profile: quick: minutes on two cores; reduced: all cells of the tables, those with video on 64
            trajectories, half an hour; paper: 1000 trajectories with video of each scene, hours.
        cell: Only these cells or groups of cells (sysid), separated by commas.
        seeds: Runs of each cell that learns from video; of several, mean and standard deviation are shown.
        out: Folder of the results; by default runs/reproduce, or runs/reproduce_PROFILE for one that is not quick.
        configs: Folder with configurations of your own under the same names; those that are shipped by default.
        workers: Processes that generate recordings; -1 for one on each core.
        at_once: Cells that run at the same time; -1 for one on each core.
        backend: loky for processes of this machine, dask for a cluster (docs/scaling.md).
        scheduler: Address of Dask's scheduler, tcp://HOST:8786.
        again: Run cells again that have been run.
    """
    from physid.configuration import ConfigurationError
    from physid.one_writer import one_writer
    from physid.reproduce.run import choose, report
    from physid.reproduce.run import reproduce as run
    from physid.shipped import SHIPPED
    from physid.workers import running_on

    target = out or Path("runs", "reproduce" if profile == "quick" else f"reproduce_{profile}")
    place = configs or SHIPPED
    if not (place / "generate").is_dir():
        raise ConfigurationError(f"{place} holds no generate/; physid configs --out {place} fills it")
    cells = choose(profile, cell.split(",") if cell else (), seeds)
    with resumable(), one_writer(target), running_on(backend, scheduler) as whole_path:
        folders = {"out": whole_path(target), "configs": whole_path(place)}
        results = run(cells, **folders, workers=workers, at_once=at_once, again=again)
    figures, _, verdict = report(results, target).rpartition("\n")
    missed = any(result.misses for result in results)
    print(f"{figures}\n{styled(verdict, 'red' if missed else 'green', sys.stdout)}")
