"""What a fit leaves is compared with the noise that the poses themselves show: both sides of the judgement."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from physid.cli import main
from physid.estimation.measurement.misfit import Misfit
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


def test_too_few_frames_say_nothing() -> None:
    assert Misfit.of(noise(0)[:, :3], seen()[:, :3]) == Misfit(0.0, 0.0, 0.0)


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
