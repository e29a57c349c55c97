"""Make a recording set with a simulator: in parallel, resumable, the same bytes for any number of workers."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physid.data import DESCRIPTION, trajectory_path, write_scene, write_sums
from physid.data.format import read_scene
from physid.data.generation.draw import OutOfViewError as OutOfViewError
from physid.data.generation.draw import draw
from physid.data.generation.record import record
from physid.data.generation.settings import GenerateConfig
from physid.data.truth import FILE, Truth, read_truth, write_truth
from physid.progress.bar import progress_bar

if TYPE_CHECKING:
    from physid.physics import Effect

REMEDY = "choose another truth_file, or move this one away"


@dataclass(frozen=True)
class Generated:
    """What a run of `generate` did.

    Attributes:
        folder: The recording set.
        written: Trajectories written by this run.
        kept: Trajectories that were there already.
        redrawn: Draws of this run that were thrown away because a body left the view.
    """

    folder: Path
    written: int
    kept: int
    redrawn: int


def generate(
    config: GenerateConfig, out: Path | str, workers: int = 1, *, effects: Sequence[Effect] = (), quiet: bool = False
) -> Generated:
    """Make a recording set, or go on with one that was interrupted.

    Args:
        config: What to make.
        out: Folder of the set.
        workers: Processes; the result does not depend on it.
        effects: Effects beside those of the configuration, say from outside the catalogue.
        quiet: Whether to hide the progress bar.

    Returns:
        What was done.

    Raises:
        ValueError: If an effect does not exist or the simulator cannot do it, the folder holds another set, the truth
            would replace something else, or no trajectory stays in view. Unless trajectories were written before,
            nothing is.
    """
    import joblib

    folder = Path(out)
    acting = (*config.build_effects(), *effects)
    begun = _is_begun(config, folder, effects)
    indices = range(config.trajectories)
    there = {path.name for path in trajectory_path(folder, 0).parent.glob("*")}
    missing = [index for index in indices if trajectory_path(folder, index).name not in there]
    splits = config.splits()
    if missing and not begun:
        # What the simulator refuses, it refuses here: a description without trajectories would bar the folder.
        draw(config, missing[0], config.protocol_for(splits[missing[0]]), acting)
    _describe(config, folder, effects)
    jobs = (joblib.delayed(record)(config, folder, index, splits[index], acting) for index in missing)
    parallel = joblib.Parallel(n_jobs=workers, return_as="generator_unordered", batch_size="auto")
    named = f"{config.scene} ({config.protocol})"
    bar = progress_bar(parallel(jobs), quiet=quiet, total=len(missing), desc=named, smoothing=0)
    redrawn = sum(bar)
    write_sums(folder)
    return Generated(folder, len(missing), len(indices) - len(missing), redrawn)


def _is_begun(config: GenerateConfig, folder: Path, extra: Sequence[Effect]) -> bool:
    """Return whether the folder holds this set already, or a part of it; refuse another one, and another truth."""
    begun, place = (folder / DESCRIPTION).exists(), _truth_file(config, folder)
    truth, before = _truth(config, extra), _earlier_truth(place)
    if not begun and before is None:
        return False
    # Sets made before a key was there had its default.
    then = {} if before is None else _made_from(before, place)
    # More trajectories may be added to a set; anything else would mix two sets in one folder.
    other = [key for key, value in truth.generation.items() if key != "trajectories" and then.get(key) != value]
    unlike = before is not None and list(before.effects.items()) != list(truth.effects.items())
    if other or unlike or (begun and read_scene(folder) != config.known_scene()):
        what = f" ({other[0]}: {then.get(other[0])!r} there, {truth.generation[other[0]]!r} here)" if other else ""
        what = what if before is not None else f", or this one, whose truth is not at {place}"
        if begun:
            raise ValueError(
                f"{folder} holds another recording set{what}; choose another folder, or delete this one first"
            )
        raise ValueError(
            f"{place} holds the truth of another recording set{what}; choose another truth_file, or delete this one "
            "first"
        )
    return begun


def _earlier_truth(place: Path) -> Truth | None:
    """Return the truth that is there already, None where nothing is; anything else is not physid's to replace."""
    if not os.path.lexists(place):
        return None
    try:
        found = read_truth(place) if place.is_file() else None
    except ValueError as error:
        raise ValueError(f"{error}; it is no truth that physid wrote, and is not replaced: {REMEDY}") from None
    if found is None:
        raise ValueError(f"{place}: expected a file for the truth, found something else, say a folder: {REMEDY}")
    return found


def _made_from(truth: Truth, place: Path) -> dict[str, Any]:
    """Return the configuration that a truth names."""
    try:
        return GenerateConfig.from_mapping(truth.generation).to_mapping()
    except ValueError as error:
        raise ValueError(f"{place}: expected the truth of a generated set, found another ({error}): {REMEDY}") from None


def _describe(config: GenerateConfig, folder: Path, extra: Sequence[Effect]) -> None:
    """Write the truth, then recording.yaml, which says that the set is begun: a kill between them bars no folder."""
    write_truth(_truth_file(config, folder), _truth(config, extra))
    write_scene(folder, config.known_scene())


def _truth(config: GenerateConfig, extra: Sequence[Effect]) -> Truth:
    """Return what the set holds in truth."""
    named = {effect.name: {name: float(value) for name, value in effect.values().items()} for effect in extra}
    return Truth(config.true_parameters(), {**config.effects, **named}, config.to_mapping())


def _truth_file(config: GenerateConfig, folder: Path) -> Path:
    """Return where the truth goes."""
    return Path(config.truth_file) if config.truth_file else folder / FILE
