"""What a fit leaves is compared with the noise that the poses themselves show: both sides of the judgement."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter1d
from torch import Tensor

from physid.cli import main
from physid.estimation.measurement.misfit import DEVIATION, Misfit
from physid.estimation.measurement.tracking_error import TrackingError, without_line
from physid.estimation.measurement.unexplained import lack_of_fit_sentence
from physid.training.callbacks.unexplained import SIGNIFICANT

SHAPE = (6, 80, 1, 3)
NOISE = 4e-4


def noise(seed: int, law: str = "normal") -> Tensor:
    generator = np.random.default_rng(seed)
    drawn = generator.standard_normal(SHAPE) if law == "normal" else generator.standard_t(3, SHAPE) / math.sqrt(3)
    return torch.from_numpy(NOISE * drawn)


def seen(share: float = 0.0) -> Tensor:
    return torch.from_numpy(np.random.default_rng(9).random(SHAPE[:2]) >= share)


@pytest.mark.parametrize("law", ["normal", "heavy tails"])
def test_white_noise_of_any_law_leaves_a_standard_normal_score(law: str) -> None:
    scores = [Misfit.of(noise(seed, law), seen()).score for seed in range(200)]
    assert abs(np.mean(scores)) < 4 / math.sqrt(200)
    assert np.std(scores) == pytest.approx(1.0, abs=0.2)
    assert max(scores) < SIGNIFICANT + 1


def test_noise_is_measured_beside_a_motion_that_is_missing_and_where_frames_are_lost() -> None:
    wave = 1e-3 * torch.sin(torch.arange(SHAPE[1]) / 8.0)[None, :, None, None].expand(SHAPE)
    found = Misfit.of(noise(0) + wave, seen(0.1))
    assert found.noise == pytest.approx(NOISE, rel=0.1)
    assert found.size == pytest.approx(1e-3 * math.sqrt(3 / 2), rel=0.1)
    assert found.score > 10


def test_an_offset_that_all_frames_share_is_no_noise() -> None:
    assert Misfit.of(noise(0) + 1e-3, seen()).size == pytest.approx(1e-3 * math.sqrt(3), rel=0.1)


def test_the_deviation_is_twice_the_squares_of_the_off_diagonal_entries() -> None:
    weights = np.array([1.0, -3.0, 3.0, -1.0])  # of a third difference
    form = np.correlate(weights, weights, "full") / np.square(weights).sum()
    assert pytest.approx(2 * float(np.square(form).sum() - 1)) == DEVIATION


def test_too_few_frames_say_nothing() -> None:
    assert Misfit.of(noise(0)[:, :3], seen()[:, :3]) == Misfit(0.0, 0.0, 0.0)


def test_the_sentence_says_what_is_left_in_the_units_that_people_read() -> None:
    noise = {"fit/position_noise": 4e-4, "fit/rotation_noise": math.radians(0.25)}
    fine = {"fit/position_explained": 1.0, "fit/rotation_explained": 1.0}
    assert lack_of_fit_sentence(noise | fine) == (
        "the fit leaves nothing beyond the noise of the poses (0.4 mm and 0.25 deg)"
    )
    left = {"fit/rotation_explained": 0.0, "fit/rotation_share": 0.035, "fit/rotation_unexplained": math.radians(1.5)}
    assert lack_of_fit_sentence(noise | fine | left, "mine") == (
        "the model leaves 3.5 % of the turning, 1.5 deg (noise 0.25 deg): run physid diagnose mine"
    )
    turned_by_noise_alone = left | {"fit/rotation_share": 2.6e16}
    assert lack_of_fit_sentence(noise | fine | turned_by_noise_alone, "mine") == (
        "the model leaves 1.5 deg (noise 0.25 deg): run physid diagnose mine"
    )
    assert lack_of_fit_sentence(noise) is None


@pytest.mark.slow
@pytest.mark.parametrize(("drag", "explained"), [(0.0, True), (0.6, False)])
def test_a_fit_says_whether_the_model_explains_what_another_engine_recorded(
    drag: float, explained: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["simulator=mujoco", "frame_rate=60", "trajectories=5", "steps=60", "video=false", "split={train: 5}"]
    words += ["noise.position=0.0006", "noise.rotation=0.003", f"effects.viscous_drag.coefficient={drag}"]
    assert main(["generate", "--config", "generate/push_rich", "--out", "mine", "--quiet", "--workers=1", *words]) == 0
    assert main(["fit", "mine"]) == 0
    printed = capsys.readouterr().out
    assert ("run physid diagnose mine" in printed) is not explained
    assert ("nothing beyond the noise of the poses (0." in printed) is explained
    figures = json.loads((tmp_path / "runs" / "mine" / "metrics.json").read_text())
    assert figures["fit/position_noise"] == pytest.approx(6e-4, rel=0.15)


def tracked(seed: int, size: float = 1e-4) -> Tensor:
    """Errors (R, T, N, 6) as smooth from frame to frame as a reader's."""
    white = np.random.default_rng(seed).standard_normal((*SHAPE[:3], 6))
    smooth = gaussian_filter1d(white, 5.0, axis=1)
    return torch.from_numpy(size * smooth / smooth.std())


def judged(residual: Tensor, error: TrackingError, real: Tensor) -> Misfit:
    mean, unsure = error.sized(residual, real[..., None].double()).left_by_fit(real.double())
    left = without_line(residual, real.double())[..., 3:]
    return Misfit.of(left, real, (float(mean[1]), float(unsure[1])))


def test_errors_of_a_reader_are_no_misfit_of_the_model_and_a_gap_beside_them_is() -> None:
    wave = 6e-4 * torch.sin(torch.arange(SHAPE[1]) / 20.0)[None, :, None, None].expand(*SHAPE[:3], 6)
    within, beyond = [], []
    for seed in range(0, 60, 2):
        error = TrackingError(tracked(seed), torch.zeros(*SHAPE[:3], 6, dtype=torch.float64), 0.0)
        read = tracked(seed + 1)
        assert Misfit.of(read[..., 3:], seen()).score > SIGNIFICANT, "as white noise they would be accused"
        within.append(judged(read, error, seen()))
        beyond.append(judged(read + wave, error, seen()))
    assert max(one.score for one in within) < SIGNIFICANT < min(one.score for one in beyond)
    missing = float(without_line(wave, seen().double())[..., 3:].square().sum(-1).mean().sqrt())
    assert np.median([one.size for one in beyond]) == pytest.approx(missing, rel=0.15)


def test_what_initial_states_take_up_and_frames_that_do_not_count_leave_nothing() -> None:
    time = torch.arange(SHAPE[1], dtype=torch.float64)[None, :, None, None]
    line = (2.0 - 0.3 * time).expand(*SHAPE[:3], 6).clone()
    real = seen(0.2)
    line[~real] = 7.0
    error = TrackingError(line, torch.zeros_like(line), 0.0)
    mean, _ = error.left_by_fit(real.double())
    assert float(mean.max()) < 1e-20
    scaled = TrackingError(torch.zeros_like(line), tracked(3, 1.0), 0.01)
    assert torch.allclose(scaled.left_by_fit(real.double())[0], TrackingError(
        0.01 * tracked(3, 1.0), torch.zeros_like(line), 0.0).left_by_fit(real.double())[0])  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "explained"), [(0.0, True), (0.8, False)])
def test_a_fit_of_films_allows_for_the_error_of_the_tracker_and_for_nothing_more(
    gain: float, explained: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["trajectories=4", "steps=60", "split={train: 4}", f"effects.force_gain.gain={gain}"]
    assert main(["generate", "--config", "generate/push_rich", "--out", "films", "--quiet", "--workers=1", *words]) == 0
    assert main(["track", "films", "--out", "read", "--quiet"]) == 0
    assert main(["fit", "read"]) == 0
    printed = capsys.readouterr().out
    assert ("run physid diagnose read" in printed) is not explained
    assert ("nothing beyond the noise of the poses" in printed) is explained


def test_large_shares_are_written_without_an_exponent() -> None:
    figures = {f"fit/{kind}_{what}": value for kind in ("position", "rotation") for what, value in
               (("noise", 1e-3), ("unexplained", 0.1745), ("share", 1.04), ("explained", 0.0))}  # fmt: skip
    said = lack_of_fit_sentence(figures)
    assert said is not None
    assert "100 % of the motion, 170 mm" in said
    assert "e+" not in said


def test_four_frames_that_follow_each_other_are_enough() -> None:
    """Their third difference is that of the noise: of an offset it is nothing."""
    offset = torch.full((1, 4, 1, 3), 2e-3, dtype=torch.float64)
    real = torch.ones(1, 4, dtype=torch.bool)
    found = Misfit.of(offset, real)
    assert (found.size, found.noise) == pytest.approx((2e-3 * math.sqrt(3), 0.0), abs=1e-12)
    assert found.score == math.inf
    real[0, 1] = False
    assert Misfit.of(offset, real) == Misfit(0.0, 0.0, 0.0)
