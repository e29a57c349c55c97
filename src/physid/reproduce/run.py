"""Runs the cells of a profile one after the other; a second call goes on where the first stopped."""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

from physid.configuration import ConfigurationError, compose
from physid.data.files import write_text
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.reproduce.cells import Cell, Fit, Recordings
from physid.reproduce.profiles import PROFILES
from physid.reproduce.results import RESULTS, Result, markdown, read_results, table, write_results

LEARNED = ("supervised/", "self_supervised/", "paper_method/")
"""Where an encoder is learned: the outcome depends on the seed."""


def choose(profile: str, names: Sequence[str], seeds: int = 1) -> list[Cell]:
    """Return the cells of a profile, those that are named, or whose group is; those with video with seeds.

    Raises:
        ConfigurationError: If the profile or a cell does not exist; names the nearest.
    """
    if profile not in PROFILES:
        raise ConfigurationError(f"unknown profile {profile!r}; there are {', '.join(PROFILES)}")
    cells = {cell.name: cell for cell in PROFILES[profile]}
    chosen: dict[str, Cell] = {}
    for name in names:
        found = {one: cell for one, cell in cells.items() if one == name or one.startswith(f"{name}/")}
        if not found:
            nearest = get_close_matches(name, cells, 1, 0)
            raise ConfigurationError(f"unknown cell {name!r} of profile {profile}; did you mean {nearest[0]!r}?")
        chosen |= found
    return [_with_seeds(cell, seeds) for cell in (chosen or cells).values()]


def _with_seeds(cell: Cell, seeds: int) -> Cell:
    """Repeat a cell that learns from video; the others leave nothing to chance."""
    if seeds < 1:
        raise ConfigurationError(f"--seeds must be at least 1, got {seeds}")
    if isinstance(cell, Fit) and cell.recordings.video and cell.name.startswith(LEARNED):
        return replace(cell, seeds=seeds, minutes=seeds * cell.minutes)
    return cell


def reproduce(
    cells: Sequence[Cell], out: Path, *, configs: Path, workers: int = -1, at_once: int = 1, again: bool = False
) -> list[Result]:
    """Run cells that have not been run before in `out`, and write results.json and results.md there.

    Args:
        cells: What to run.
        out: Folder of the results; each cell has a run folder in it, each recording set one in out/data.
        configs: The folder configs/ of the repository.
        workers: Processes that generate; -1 for one on each core.
        at_once: Cells that run at the same time; -1 for one on each core.
        again: Whether to run cells again that have been run.

    Returns:
        The results of all cells, but for those that lack something which the project cannot make.
    """
    import joblib

    for cell in cells:
        if lacking := cell.absent():
            print(f"{cell.name} is left out: {lacking}", flush=True)
    left_out, cells = cells, [cell for cell in cells if not cell.absent()]
    if left_out and not cells:
        raise ConfigurationError("nothing is left to run")
    missing = [cell for cell in cells if again or not cell.finished(out / cell.name)]
    for cell in missing if again else ():  # a run that is there would be taken up where it ended
        shutil.rmtree(out / cell.name, ignore_errors=True)
    for recordings in dict.fromkeys(cell.recordings for cell in missing if cell.recordings is not None):
        _record(recordings, out / "data", configs, workers)
    left, start = sum(cell.minutes for cell in missing), time.monotonic()
    costs, total = {cell.name: cell.minutes for cell in missing}, left
    parallel = joblib.Parallel(n_jobs=at_once, return_as="generator_unordered", batch_size=1)
    # Worker processes outlive a call and keep the folder they started in: a relative path would mislead them.
    places = out.absolute(), configs.absolute()
    done = parallel(joblib.delayed(_measure)(cell, *places) for cell in missing)
    for number, name in enumerate(done, 1):
        left -= costs[name]
        print(f"[{number}/{len(missing)}] {name}{_remaining(time.monotonic() - start, total, left)}", flush=True)
    results = [result for cell in cells for result in read_results(out / cell.name / RESULTS)]
    write_results(out / RESULTS, results)
    write_text(out / "results.md", markdown(results))
    return results


def _measure(cell: Cell, out: Path, configs: Path) -> str:
    """Run a cell, write its results into its folder and return its name."""
    print(f"{cell.name} begins", flush=True)  # a worker draws no progress bar, and lines of a log name no cell
    data = out / "data" / (cell.recordings.folder if cell.recordings else "")
    try:
        results = cell.run(configs, data, out / cell.name)
    except ConfigurationError as error:  # as where a cell that was interrupted is another one by now
        raise ConfigurationError(
            f"{error}; physid reproduce --again --cell {cell.name} (and --profile, --out as now) fits it anew"
        ) from None
    write_results(out / cell.name / RESULTS, results)
    return cell.name


def _remaining(spent: float, total: float, left: float) -> str:
    """Say how long it will still take, from the time spent [s] and the expected costs of all cells and of the rest."""
    if left <= 0 or left >= total:
        return ""
    seconds = spent / (total - left) * left
    return f"  (about {seconds / 60:.0f} min left)" if seconds > 90 else f"  (about {seconds:.0f} s left)"


def _record(recordings: Recordings, data: Path, configs: Path, workers: int) -> None:
    """Generate a recording set, or what is missing of it."""
    settings = [f"trajectories={recordings.trajectories}", f"video={str(recordings.video).lower()}"]
    file = configs / "generate" / f"{recordings.name}.yaml"
    configuration = compose([str(file)], settings, reads=GenerateConfig)
    generate(GenerateConfig.from_mapping(configuration.values), data / recordings.folder, workers)


def report(results: Sequence[Result], out: Path) -> str:
    """Return the table, and a sentence about targets and files."""
    missed = [f"{result.cell} {result.metric}" for result in results if result.misses]
    verdict = f"missed: {', '.join(missed)}" if missed else "every target is met"
    return f"{table(results)}\n\n{verdict}; results in {out / RESULTS} and {out / 'results.md'}"
