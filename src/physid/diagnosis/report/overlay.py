"""What models predict, drawn over the film of a trajectory: a short film and a few pictures for the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from physid.data import DESCRIPTION, RecordingSet
from physid.data.mp4 import write_mp4
from physid.data.reading import read_reading
from physid.diagnosis.conclusion.conclusion import Conclusion
from physid.diagnosis.conclusion.gap import errors_of, held_out_parts
from physid.diagnosis.inputs import Observations
from physid.diagnosis.report.contents import Film, Overlay, Still
from physid.diagnosis.report.outlines import Pixels, Points, draw_panel, to_webp, view_of
from physid.diagnosis.testing import Hypothesis
from physid.pages.numbers import quantity, words
from physid.physics.rotations import exponential, multiply
from physid.scenes import Scene
from physid.scenes.camera import corners

FILM = "model_over_film.mp4"
RATE, MOST_FRAMES = 30, 240  # frames per second of the film, and at most
SMOOTH = 9  # frames over which differences are averaged: the noise of the poses is not the model's
VISIBLE = 0.3  # share of a body's size in the picture that the largest differences shall take up
LARGER = (1, 2, 5, 10, 20)
AT = (0.0, 1 / 3, 2 / 3, 1.0)  # shares of the time that pictures show
RECORDED, BEFORE, AFTER = (255, 255, 255), (217, 119, 6), (29, 95, 209)
THIN, THICK = 1, 3  # [pixel]


def overlay(
    out: Path,
    sources: Sequence[tuple[RecordingSet, int]],
    observations: Observations,
    nominal: Hypothesis,
    conclusion: Conclusion,
) -> Overlay | None:
    """Draw the filmed trajectory whose positions the nominal model misses most, a held-out one if there is one.

    Args:
        out: Folder of the diagnosis; gets the film.
        sources: Recording set of each trajectory, and its number there.
        observations: What was recorded.
        nominal: The refitted nominal model.
        conclusion: What was concluded.

    Returns:
        None where no trajectory was filmed.
    """
    row = _choose(sources, observations, nominal)
    scene = observations.scene
    if row is None or scene.camera is None:
        return None
    models = [nominal] + ([] if conclusion.judgement.shown is None else [conclusion.judgement.shown])
    length = int(observations.present[row, :, 0].sum())
    shown = np.unique(np.linspace(0, length - 1, min(length, MOST_FRAMES)).astype(int))
    away = torch.stack([_smooth(model.fit.residual[row, :length])[shown] for model in models])
    pose = observations.pose[row, shown]
    larger = _enlargement(scene, pose, away[0])
    recorded, *drawn = (_corners(scene, _moved(pose, change)) for change in (0 * away[0], *(-larger * away)))
    films, index = _films_of(*sources[row])
    panels = _panels(films.film(index, shown.tolist())[0], recorded, drawn)
    stills = [
        Still(_caption(scene.time_step * float(shown[k]), away[:, k]), to_webp(panels[k]))
        for k in (int(share * (len(shown) - 1)) for share in AT)
    ]
    names = ["nominal model"] + [f"with {' and '.join(map(words, one.names))}" for one in models[1:]]
    which = f"trajectory {sources[row][1]}" + " of the transfer set" * (sources[row][0] is not sources[0][0])
    film = Film("", out / FILM) if write_mp4(out / FILM, panels, RATE) else None
    return Overlay(which, tuple(names), larger, tuple(stills), film)


def _choose(sources: Sequence[tuple[RecordingSet, int]], observations: Observations, nominal: Hypothesis) -> int | None:
    """Choose the trajectory with the largest error among those that have a film, held-out ones first."""
    held_out = torch.stack(list(held_out_parts(observations).values())).any(0)
    errors = errors_of(nominal)
    for row in (errors + errors.sum() * held_out).argsort(descending=True).tolist():
        films, index = _films_of(*sources[row])
        if films.has_film(index):
            return int(row)
    return None


def _films_of(recordings: RecordingSet, index: int) -> tuple[RecordingSet, int]:
    """Return where the film of a trajectory is: in its own set, or in that from which its poses were read."""
    reading = read_reading(recordings.folder)
    if reading is None or not (Path(reading.films) / DESCRIPTION).is_file():
        return recordings, index
    return RecordingSet(reading.films), index


def _smooth(value: Tensor) -> Tensor:
    """Average (T, N, 6) over some frames."""
    flat = value.flatten(1).T[None]
    reach = min(SMOOTH, len(value) - 1 + len(value) % 2)
    mean = torch.nn.functional.avg_pool1d(flat, reach, 1, reach // 2, count_include_pad=False)
    return mean[0].T.reshape(value.shape)


def _enlargement(scene: Scene, pose: Tensor, away: Tensor) -> int:
    """Choose how many times as large differences (T, N, 6) are drawn, so that the largest can be seen."""
    own, moved = (_corners(scene, each) for each in (pose, _moved(pose, -away)))
    size = np.ptp(own, axis=-2).max()
    largest = float(np.quantile(np.linalg.norm(moved - own, axis=-1), 0.98))
    return max((each for each in LARGER if each * largest <= VISIBLE * size), default=1)


def _moved(pose: Tensor, change: Tensor) -> Tensor:
    """Move poses (..., 7) by rotation vectors and positions (..., 6)."""
    return torch.cat([pose[..., :3] + change[..., 3:], multiply(exponential(change[..., :3]), pose[..., 3:])], -1)


def _corners(scene: Scene, pose: Tensor) -> Points:
    """Project the corners of the bodies at poses (T, N, 7), shape (T, N, 8, 2) [pixel]."""
    assert scene.camera is not None
    return scene.camera.project(corners(pose.numpy(), scene.sizes))[..., :2]


def _panels(frames: Pixels, recorded: Points, drawn: Sequence[Points]) -> list[Pixels]:
    """Draw each model beside the other, over frames (T, H, W, 3)."""
    view = view_of(np.concatenate([recorded, *drawn]), frames.shape[2], frames.shape[1])
    return [
        np.concatenate(
            [
                draw_panel(frame, view, ((recorded[k], RECORDED, THIN), (own[k], colour, THICK)))
                for own, colour in zip(drawn, (BEFORE, AFTER), strict=False)
            ],
            1,
        )
        for k, frame in enumerate(frames)
    ]


def _caption(time: float, away: Tensor) -> str:
    """Say when, and how far off the models are (M, N, 6)."""
    errors = away[..., 3:].norm(dim=-1).amax(-1)
    return f"{time:.2f} s: {' → '.join(quantity(float(error), 'm') for error in errors)}"
