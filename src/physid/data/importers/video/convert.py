"""Films and logs of forces to a recording set with films, which `physid track` reads poses from."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physid.data import Recording
from physid.data.importers.finding import force_logs
from physid.data.importers.reading_logs import along_lines, read_force_log
from physid.data.importers.sets import Imported, new_set, write_films
from physid.data.importers.video.mapping import FilmMap
from physid.data.importers.video.shutter import ShutterGauge
from physid.data.importers.video.survey import (
    RATE_DIFFERS,
    Survey,
    common_background,
    empty_scene,
    first_masks,
    straightener,
    survey,
    unlike_outlines,
)
from physid.data.observations.stamps import check_clocks, unlike_lengths

Image = NDArray[np.uint8]
MOST_BYTES, MOST_IMAGES = 256_000_000, 41
"""Of the frames that a background is the median of."""
BETTER = "name an image of the empty scene (background=FILE) where a body rests for most of the time"


def _silent(task: str, done: int, total: int) -> None:
    """Show nothing."""


def import_films(
    films: Sequence[Path], values: dict[str, Any], out: Path, say: Callable[[str, int, int], None] = _silent
) -> Imported:
    """Convert films to a recording set; it is there whole or not at all.

    Frames are turned into those of an ideal pinhole camera at the same place, one by one. All films have one camera
    file, so that the camera is at one place: what is behind the bodies is the same in all of them.

    Args:
        films: Film files, or folders of images.
        values: The mapping (see `FilmMap`).
        out: Folder of the set; must not exist, or be empty.
        say: Called with what is done to the films, and how many frames are done, of how many (0 if that is unknown).

    Raises:
        FileNotFoundError: If a film or the camera file is missing.
        ValueError: If the mapping or a film is wrong; the message names file, frame and what to do.
    """
    known = FilmMap.from_mapping(values)
    logs, straighten, notes = force_logs(films, known.log.forces.file), straightener(known.lens), known.notes
    with new_set(out, values) as part:
        say("looking at the films", 0, 0)
        most = max(3, min(MOST_IMAGES, MOST_BYTES // (3 * known.lens.width * known.lens.height)) // len(films))
        most = 0 if known.background else most
        surveys = [survey(path, known.lens, straighten, known.rate, most) for path in films]
        notes += dict.fromkeys(note for each in surveys for note in each.notes)
        background = _background(known, surveys, straighten, notes)
        source = f"filmed, imported from {films[0].name}" + (f" and {len(films) - 1} more" if len(films) > 1 else "")
        scene = known.scene(_one_step(surveys), source)
        many, done = sum(each.count for each in surveys), itertools.count(1)
        converted = _converted(
            known, surveys, logs, background, straighten, notes, lambda: say("writing the films", next(done), many)
        )
        write_films(part, scene, converted, len(films), known.log.split)
    return Imported(out, len(films), tuple(notes))


def _converted(
    known: FilmMap,
    surveys: Sequence[Survey],
    logs: Sequence[Path | None],
    background: Image,
    straighten: Callable[[Image], Image],
    notes: list[str],
    written: Callable[[], None],
) -> Iterator[tuple[Recording, Iterable[Image]]]:
    """Yield what is known of each film, and its images as the ideal camera would take them; note what they show.

    Each image that has been written is counted by a call of `written`.
    """
    for found, path in zip(surveys, logs, strict=True):
        film, forces = found.film, None if path is None else read_force_log(path, known.log)
        wrench, wrench_time = (None, None) if forces is None else (forces.wrench, forces.time)
        if wrench is not None and known.log.forces.between == "linear":
            if wrench_time is None:
                raise ValueError(f"{path}: expected stamps for forces.between=linear, found none; say forces.rate")
            wrench_time, wrench = along_lines(wrench_time, wrench, found.step)
        recording = Recording(
            pose=np.full((found.count, len(known.log.bodies), 7), np.nan),
            time=found.time,
            protocol=known.log.protocol,
            wrench=wrench,
            wrench_time=wrench_time,
        )
        if forces is not None and forces.time is not None:
            length = found.count * found.step if found.time is None else float(np.ptp(found.time))
            remark = unlike_lengths(length, float(np.ptp(forces.time)), 1 / found.step)
            notes += [] if remark is None else [f"{film.path}: {remark}"]
        try:
            check_clocks(recording, found.step)
            mask = _in_order(first_masks(film, straighten, background, len(known.log.bodies)), known)
        except ValueError as error:
            raise ValueError(f"{film.path}: {error}") from None
        notes += [f"{film.path}: {remark}" for remark in unlike_outlines(mask, known.scene(found.step, ""))]
        shape = np.broadcast_to(np.uint8(0), (found.count, *background.shape))  # no memory: the images follow
        filmed = replace(recording, pose=None, mask=mask, background=background, frames=shape)
        gauge = ShutterGauge(background) if len(known.log.bodies) == 1 else None
        yield filmed, _watched((straighten(image) for _, image in film.frames()), gauge, written)
        if gauge is not None and (remark := gauge.remark()):
            notes.append(f"{film.path}: {remark}")


def _watched(images: Iterable[Image], gauge: ShutterGauge | None, written: Callable[[], None]) -> Iterator[Image]:
    """Pass images on, one by one, let a gauge look at each, and call `written` after it."""
    for image in images:
        if gauge is not None:
            gauge.look(image)
        yield image
        written()


def _background(
    known: FilmMap, surveys: Sequence[Survey], straighten: Callable[[Image], Image], notes: list[str]
) -> Image:
    """Return the empty scene: as given, or as the films show it."""
    if known.background is not None:
        return empty_scene(known.background, known.lens, straighten)
    notes.append(f"background: the median of {'the film' if len(surveys) == 1 else 'all films'}; {BETTER}")
    return common_background(surveys, len(known.log.bodies))


def _one_step(surveys: Sequence[Survey]) -> float:
    """Return the time between frames [s], which all films share."""
    steps = [each.step for each in surveys]
    if max(steps) > (1 + RATE_DIFFERS) * min(steps):
        raise ValueError(
            f"expected films of one rate, found {1 / max(steps):.4g} to {1 / min(steps):.4g} frames per second; import "
            "them into sets of their own"
        )
    return steps[0]


def _in_order(masks: NDArray[np.bool_], known: FilmMap) -> NDArray[np.bool_]:
    """Give the largest mask to the largest body."""
    order = np.argsort([-float(np.prod(each.body.size)) for each in known.log.bodies])
    return masks[np.argsort(order)]
