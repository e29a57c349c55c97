"""Blocks that fall flat and bounce several times, by the closed form: what check and a fit say of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.data.sets import write_set

from physid.cli import main
from physid.data import Recording
from physid.scenes import Scene, find_setup

RATE, FRAMES, G, RESTITUTION, NOISE = 120, 150, 9.81, 0.6, 5e-4
TOSS = find_setup("toss").scene
BLOCK = replace(TOSS.bodies[0], restitution=0.5)
SCENE = Scene("toss", 1 / RATE, TOSS.ground, (BLOCK,), ("block.restitution",), None, TOSS.gravity, "closed form")


def heights(start: float) -> NDArray[np.float64]:
    """Return how high a point is at the frames that is let go at a height and bounces, (FRAMES,)."""
    found, time = np.zeros(FRAMES), np.arange(FRAMES) / RATE
    since, lands, speed = 0.0, np.sqrt(2 * start / G), np.sqrt(2 * G * start)
    here = time < lands
    found[here] = start - G * time[here] ** 2 / 2
    while speed > 0.05:
        since, speed = lands, RESTITUTION * speed
        lands = since + 2 * speed / G
        here = (time >= since) & (time < lands)
        found[here] = speed * (time[here] - since) - G * (time[here] - since) ** 2 / 2
    return found


@pytest.fixture(scope="module")
def bounced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six blocks that are let go at different heights; segments around single bounces say 0.593."""
    random = np.random.default_rng(5)
    recordings = []
    for start in random.uniform(0.3, 0.6, 6):
        pose = np.zeros((FRAMES, 1, 7))
        pose[:, 0, 2], pose[:, 0, 6] = BLOCK.size[2] / 2 + heights(start), 1.0
        pose[..., :3] += random.normal(0, NOISE, (FRAMES, 1, 3))
        turn = random.normal(0, 3e-3, (FRAMES, 1, 3))
        pose[..., 3:6] = turn / 2
        pose[..., 3:] /= np.linalg.norm(pose[..., 3:], axis=-1, keepdims=True)
        recordings.append(Recording(pose=pose, wrench=np.zeros((FRAMES, 1, 6))))
    return write_set(tmp_path_factory.mktemp("bounces") / "set", recordings, SCENE)


def test_what_bounces_gains_no_energy(bounced: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(bounced)]) == 0
    assert "energy comes from nowhere" not in capsys.readouterr().out


@pytest.mark.slow
def test_several_bounces_that_a_restitution_explains_are_fitted_whole(bounced: Path, tmp_path: Path) -> None:
    assert main(["fit", str(bounced), "--run-dir", str(tmp_path / "run")]) == 0
    figures = json.loads((tmp_path / "run" / "metrics.json").read_text())
    low, high = (figures[f"params/block.restitution/{end}"] for end in ("low", "high"))
    # Cut around its impacts it would be known to a hundredth; the time of the last bounce knows a ten thousandth.
    assert high - low < 2e-3
    assert abs(figures["params/block.restitution/estimate"] - RESTITUTION) < 1.5 * (high - low)
