"""From films to a verdict: what is hidden is named, and a reader's own error is not taken for physics."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest
import torch

from physid.cli import main
from physid.data import RecordingSet, trajectory_path, write_scene, write_sums, write_trajectory
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.data.reading import ECHO, FILE, read_reading
from physid.diagnosis.document.document import read_diagnosis
from physid.diagnosis.inputs.observations import load_observations
from physid.estimation.measurement.sensor_noise import Noise, estimate_noise
from physid.estimation.measurement.tracking_error import SURE, TrackingError

DRAG = 0.8
WIDER = 2.0  # a 90 % interval misses now and then


def error_of(track: torch.Tensor, deviation: float = 0.0) -> TrackingError:
    return TrackingError(track, torch.ones_like(track), deviation)


def correlated(rows: int, frames: int, share: float, seed: int = 0) -> torch.Tensor:
    """Draw e_t = share e_{t-1} + sqrt(1 - share^2) w_t, of unit variance, shape (R, T, 1, 6)."""
    white = torch.randn(rows, frames, 1, 6, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    track = white.clone()
    for frame in range(1, frames):
        track[:, frame] = share * track[:, frame - 1] + (1 - share**2) ** 0.5 * white[:, frame]
    return track


@pytest.mark.parametrize("share", [0.0, 0.5, 0.8])
def test_errors_that_are_alike_in_neighbouring_frames_count_as_more_noise(share: float) -> None:
    """Power at low frequencies is (1 + a) / (1 - a) times that of white noise."""
    error = error_of(correlated(40, 300, share))
    expected = ((1 + share) / (1 - share)) ** 0.5
    assert bool(((0.8 * expected < error.spread) & (error.spread < 1.4 * expected)).all())


def test_a_depth_that_is_hardly_seen_spoils_no_other_direction_and_one_that_is_not_read_counts_as_unseen() -> None:
    track = correlated(40, 100, 0.0)
    track[..., 5] *= 50.0
    track[..., :2] = 0.0
    spread = error_of(track).spread
    assert spread.tolist() == pytest.approx([1.0, 1.0, 1.0, 1.0, 1.0, 50.0], rel=0.3)
    track[..., 5] = 0.0
    track[..., 1] = track[..., 2]
    spread = error_of(track).spread
    assert spread[5] == pytest.approx(float(spread[3:5].min()), rel=0.1)


def test_the_size_of_the_error_is_that_of_the_recordings_and_never_smaller_than_drawn_films_show() -> None:
    track = correlated(20, 200, 0.5)
    weight = torch.ones(20, 200, 1, dtype=torch.float64)
    scale = torch.tensor([2.0] * 3 + [3.0] * 3, dtype=torch.float64)
    trend = torch.linspace(0, 50, 200, dtype=torch.float64)[:, None, None]
    larger = error_of(track).sized(scale * correlated(20, 200, 0.5, seed=1) + trend, weight)
    assert larger.factors == pytest.approx((2.0, 3.0), rel=0.05), "an error of the model does not enter"
    assert error_of(track).sized(0.1 * track, weight).factors == (1.0, 1.0)


def test_drawn_errors_have_the_size_of_the_track_and_a_common_scale() -> None:
    track = correlated(10, 100, 0.5)
    generator = torch.Generator().manual_seed(0)
    drawn = error_of(track).draw(200, track, generator)
    assert drawn.shape == (200, 10, 100, 1, 6)
    assert float(drawn.square().mean().sqrt()) == pytest.approx(float(track.square().mean().sqrt()), rel=2 * SURE)
    scaled = error_of(0 * track, deviation=0.01).draw(400, track, generator)
    assert float(scaled[:, 0, 0, 0, 0].std()) == pytest.approx(0.01, rel=0.1)
    assert torch.equal(scaled[:, 0], scaled[:, 5]), "the scale is off in all trajectories alike"


def test_the_floor_is_what_a_first_place_and_velocity_do_not_take_up() -> None:
    line = torch.linspace(-1, 1, 60, dtype=torch.float64)[:, None, None].expand(3, 60, 1, 6)
    assert error_of(line).floor == pytest.approx(0.0, abs=1e-9)
    assert error_of(correlated(30, 200, 0.0)).floor == pytest.approx(3**0.5, rel=0.05)


def test_without_a_reader_noise_is_white() -> None:
    residual = 0.001 * correlated(20, 100, 0.0)
    noise = estimate_noise(residual, torch.ones(20, 100, 1))
    assert noise.error is None
    assert noise.floor == pytest.approx(3**0.5 * noise.position)
    drawn = Noise(0.01, 0.001).draw(50, residual, torch.Generator().manual_seed(0))
    assert float(drawn[..., 3:].std()) == pytest.approx(0.001, rel=0.05)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("from_video")


def filmed(folder: Path, trajectories: int, steps: int, effects: dict[str, Any] | None = None) -> Path:
    split = {"fit": 5, "report_same": 1}
    known = GenerateConfig(
        "push", protocol="rich", trajectories=trajectories, steps=steps, unknown=("block.friction",), split=split,
        guess_factor=1.3, effects=effects or {},
    )  # fmt: skip
    generate(known, folder, 1, quiet=True)
    return folder


def without_poses(source: Path, folder: Path) -> Path:
    recordings = RecordingSet(source)
    write_scene(folder, recordings.scene)
    for index in range(len(recordings)):
        one = recordings.read(index, video=True)
        write_trajectory(trajectory_path(folder, index), dataclasses.replace(one, pose=None, twist=None))
    write_sums(folder)
    return folder


@pytest.mark.slow
def test_films_alone_are_read_by_themselves_and_once_only(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    films = without_poses(filmed(folder / "small", 4, 24), folder / "films")
    out = folder / "out"
    assert main(["diagnose", str(films), f"--out={out}"]) == 0
    assert "Poses are read from the films" in capsys.readouterr().out
    assert read_diagnosis(out / "diagnosis.json").verdict == "none"
    assert "Diagnosis of films" in (out / "report.html").read_text()
    assert "data:image/webp" in (out / "report.html").read_text(), "the films are found for the overlay"
    written = (out / "read" / FILE).stat().st_mtime_ns
    assert load_observations(RecordingSet(out / "read")).error is not None
    assert main(["diagnose", str(films), f"--out={out}", "--quiet"]) == 0
    assert (out / "read" / FILE).stat().st_mtime_ns == written
    _assert_no_pair(out / "read", folder / "small")


def _assert_no_pair(read: Path, known: Path) -> None:
    """A set that was read and one that was not are no pair."""
    assert read_reading(read) is not None
    with pytest.raises(ValueError, match="physid track on both sets"):
        load_observations(RecordingSet(read), RecordingSet(known))
    both = load_observations(RecordingSet(read), RecordingSet(read))
    assert both.error is not None
    assert both.error.track.shape[0] == 8
    assert (read / ECHO).is_dir()


@pytest.mark.slow
def test_a_drag_is_named_from_films_and_films_without_an_effect_show_none(folder: Path) -> None:
    # A dozen films hardly distinguish a drag that grows with the speed from one that grows with its square.
    for verdicts, effects in ((["none"], {}), (["named", "group"], {"viscous_drag": {"coefficient": DRAG}})):
        films = filmed(folder / verdicts[0], 12, 100, effects)
        out = folder / f"of_{verdicts[0]}"
        assert main(["diagnose", str(films), "--from-video", f"--out={out}", "--quiet"]) == 0
        found = read_diagnosis(out / "diagnosis.json")
        assert found.verdict in verdicts
        assert list(found.blamed) == list(effects)
        assert set(found.group) <= {*effects, "quadratic_drag"}
    size = found.effects[0].parameters["coefficient"]
    assert abs(size.value - DRAG) < WIDER * (size.high - size.low) / 2
