"""What models predict, drawn over a film: the outlines lie where the model says, enlarged if they could not be seen."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest
import torch

from diagnosis.documents import said
from physid.data import RecordingSet
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.diagnosis.inputs.observations import Observations, load_observations
from physid.diagnosis.report.contents import Overlay, ReportData
from physid.diagnosis.report.enlargement import LARGER, VISIBLE
from physid.diagnosis.report.outlines import SIDE, draw_panel, view_of
from physid.diagnosis.report.overlay import FILM, overlay
from physid.diagnosis.report.page import render

LARGEST_PAGE = 3_000_000
AMBER, BLUE = (217, 119, 6), (29, 95, 209)


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("films") / "push"
    config = GenerateConfig("push", protocol="rich", trajectories=4, steps=24, split={"fit": 2, "report_same": 1})
    generate(config, folder, 1, quiet=True)
    return folder


def model_off_by(observations: Observations, shift: torch.Tensor) -> Any:
    """Return what stands for a hypothesis that is off by (R,) [m] along x."""
    residual = torch.zeros(*observations.pose.shape[:3], 6, dtype=torch.float64)
    residual[..., 3] = shift[:, None, None]
    experiment = SimpleNamespace(scale=torch.ones_like(residual))
    return SimpleNamespace(fit=SimpleNamespace(residual=residual), experiment=experiment, names=("viscous_drag",))


def drawn(films: Path, out: Path, before: torch.Tensor, after: torch.Tensor | None) -> Overlay | None:
    observations = load_observations(RecordingSet(films))
    judged: Any = SimpleNamespace(
        nominal_fit=SimpleNamespace(observations=observations),
        found=SimpleNamespace(whole_nominal=model_off_by(observations, before)),
        shown=None if after is None else model_off_by(observations, after),
    )
    return overlay(out, judged)


@pytest.mark.slow
def test_the_held_out_trajectory_that_is_missed_most_is_drawn_and_small_differences_are_enlarged(
    films: Path, tmp_path: Path
) -> None:
    roles = load_observations(RecordingSet(films)).roles
    held_out = [row for row, role in enumerate(roles) if role == "same"]
    before = torch.tensor([0.05, 0.05, 0.05, 0.05], dtype=torch.float64)
    before[held_out] = 0.004
    made = drawn(films, tmp_path, before, 0 * before)
    assert made is not None
    assert made.trajectory == f"trajectory {held_out[0]}"
    assert made.models == ("nominal model", "with viscous drag")
    assert made.stills[0].caption == "0.00 s: 4 mm → 0 m"
    assert made.larger in LARGER
    assert made.larger * 0.004 < VISIBLE * 0.5 < 2.5 * made.larger * 0.004
    assert made.film is not None
    assert made.film == tmp_path / FILM


def test_frames_are_those_of_the_film_where_a_body_is_seen_late_and_lost_for_a_while(
    films: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(films, tmp_path / "late")
    for path in (tmp_path / "late" / "trajectories").glob("*.h5"):
        with h5py.File(path, "r+") as file:
            file["pose"][:5] = np.nan
            file["pose"][9:12] = np.nan
    asked, film = list[list[int]](), RecordingSet.film
    monkeypatch.setattr(RecordingSet, "film", lambda self, index, rows: asked.append(rows) or film(self, index, rows))
    made = drawn(tmp_path / "late", tmp_path, torch.full((4,), 0.03, dtype=torch.float64), None)
    assert made is not None
    (rows,) = asked
    assert (rows[0], rows[-1], len(rows)) == (5, 23, 19)
    assert made.stills[-1].caption.startswith("0.07 s"), "18 frames of 1/240 s after the first"


@pytest.mark.slow
def test_the_page_carries_film_and_pictures_and_stays_small(films: Path, tmp_path: Path) -> None:
    before = torch.full((4,), 0.03, dtype=torch.float64)
    made = drawn(films, tmp_path, before, before / 10)
    page = render(said(), ReportData(overlay=made))
    assert page.count("data:image/webp") == len(made.stills if made else ()) == 4
    assert page.count("data:video/mp4") == 1
    assert "with viscous drag" in page
    assert len(page) < LARGEST_PAGE


def test_without_an_effect_one_model_is_drawn_and_without_films_none(films: Path, tmp_path: Path) -> None:
    before = torch.full((4,), 0.03, dtype=torch.float64)
    made = drawn(films, tmp_path, before, None)
    assert made is not None
    assert made.models == ("nominal model",)
    generate(GenerateConfig("push", trajectories=4, steps=24, video=False), tmp_path / "blind", 1, quiet=True)
    assert drawn(tmp_path / "blind", tmp_path, before, None) is None


def test_outlines_surround_the_body_and_a_model_that_is_right_lies_on_it() -> None:
    square = np.array([[10, 10], [10, 20], [20, 10], [20, 20]] * 2, dtype=float)[None]
    square = square[:, [0, 4, 1, 5, 2, 6, 3, 7]]
    view = view_of(square, 64, 64)
    empty = np.zeros((64, 64, 3), dtype=np.uint8)
    panel = draw_panel(empty, view, [(square, AMBER, 3)])
    rows, columns = np.nonzero((panel == AMBER).all(-1))
    left, top, length = view
    for pixels, start in ((columns, left), (rows, top)):
        ends = pixels.min() * length / SIDE + start, (pixels.max() + 1) * length / SIDE + start
        assert ends == pytest.approx((10, 20), abs=0.6)
    on_top = draw_panel(empty, view, [(square, AMBER, 3), (square, BLUE, 3)])
    assert not (on_top == AMBER).all(-1).any()


def test_a_view_shows_all_that_is_asked_for_and_nothing_beyond_the_image() -> None:
    points = np.array([[2.0, 50.0], [60.0, 55.0]])
    left, top, length = view_of(points, 64, 64)
    assert left >= 0
    assert top >= 0
    assert left + length <= 64
    assert top + length <= 64
    assert (points >= [left, top]).all()
    assert (points <= [left + length, top + length]).all()
