"""What models predict, drawn over the film of a trajectory: a short film and a few pictures for the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from physid.data.mp4 import write_mp4
from physid.data.reading import film_of
from physid.diagnosis.conclusion.gap import errors_of, held_out_parts
from physid.diagnosis.conclusion.judgement import Judgement
from physid.diagnosis.report.contents import Overlay, Still
from physid.diagnosis.report.enlargement import corners_of, enlargement, smooth
from physid.diagnosis.report.outlines import Pixels, Points, draw_panel, to_webp, view_of
from physid.pages.numbers import quantity, words

FILM = "model_over_film.mp4"
RATE, MOST_FRAMES = 30, 240  # frames per second of the film, and at most
AT = (0.0, 1 / 3, 2 / 3, 1.0)  # shares of the time that pictures show
RECORDED, BEFORE, AFTER = (255, 255, 255), (217, 119, 6), (29, 95, 209)
THIN, THICK = 1, 3  # [pixel]


def overlay(out: Path, judged: Judgement) -> Overlay | None:
    """Draw the filmed trajectory whose positions the nominal model misses most, a held-out one if there is one.

    Args:
        out: Folder of the diagnosis; gets the film.
        judged: The recordings, the refitted nominal model, and what is blamed.

    Returns:
        None where no trajectory was filmed.
    """
    (out / FILM).unlink(missing_ok=True)  # of an earlier diagnosis
    row, observations = _choose(judged), judged.nominal_fit.observations
    scene, sources = observations.scene, observations.sources
    if row is None or scene.camera is None:
        return None
    models = [judged.found.whole_nominal] + ([] if judged.shown is None else [judged.shown])
    length = int(observations.present[row].any(1).nonzero().max()) + 1
    shown = np.unique(np.linspace(0, length - 1, min(length, MOST_FRAMES)).astype(int))
    away = torch.stack([smooth(model.fit.residual[row, :length])[shown] for model in models])
    pose = observations.pose[row, shown]
    larger = enlargement(scene, pose, away[0])
    recorded, *drawn = (corners_of(scene, pose, change) for change in (0 * away[0], *(-larger * away)))
    recordings, number = sources[row]
    films, index = film_of(recordings, number)
    left_out = int(recordings.read(number).seen.any(1).argmax())  # frames before a body is seen for the first time
    panels = _panels(films.film(index, (left_out + shown).tolist())[0], recorded, drawn)
    time = observations.timeline.time[row] - observations.timeline.time[row, 0]
    stills = [
        Still(_caption(float(time[shown[k]]), away[:, k]), to_webp(panels[k]))
        for k in (int(share * (len(shown) - 1)) for share in AT)
    ]
    names = ["nominal model"] + [f"with {' and '.join(map(words, one.names))}" for one in models[1:]]
    which = f"trajectory {sources[row][1]}" + " of the transfer set" * (sources[row][0] is not sources[0][0])
    film = out / FILM if write_mp4(out / FILM, panels, RATE) else None
    return Overlay(which, tuple(names), larger, tuple(stills), film)


def _choose(judged: Judgement) -> int | None:
    """Choose the trajectory with the largest error among those that have a film, held-out ones first."""
    observations = judged.nominal_fit.observations
    held_out = torch.stack(list(held_out_parts(observations).values())).any(0)
    errors = errors_of(judged.found.whole_nominal)
    for row in (errors + errors.sum() * held_out).argsort(descending=True).tolist():
        films, index = film_of(*observations.sources[row])
        if films.has_film(index):
            return int(row)
    return None


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
