"""The simpler methods do what their names say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.documents import said
from physid.benchmark.scoring.accelerations import samples
from physid.benchmark.scoring.baselines import FITTED, SPLITS, answers, free_residual, sparse_regression
from physid.benchmark.sealing.configurations import SPLIT
from physid.data import RecordingSet
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig, Noise
from physid.effects import from_values
from physid.physics import Effect

NOISE = 1e-4  # [m]
SMOOTH = 0.03  # [m/s^2] what a cubic through 0.2 s misses, in the median
EXPLAINED = 0.3  # part of the residual acceleration, with so few trajectories


def recorded(folder: Path, *effects: Effect) -> RecordingSet:
    """Return recordings of pushes with effects hidden in them."""
    config = GenerateConfig(
        scene="push", protocol="rich", protocol_of_split={"report_transfer": "paper"}, trajectories=48, steps=150,
        video=False, split=SPLIT, unknown=("block.friction",), noise=Noise(NOISE, NOISE),
    )  # fmt: skip
    generate(config, folder, effects=effects, quiet=True)
    return RecordingSet(folder)


@pytest.fixture(scope="module")
def dragged(tmp_path_factory: pytest.TempPathFactory) -> RecordingSet:
    return recorded(tmp_path_factory.mktemp("drag"), from_values("viscous_drag", {"coefficient": 2.0}))


@pytest.fixture(scope="module")
def free(tmp_path_factory: pytest.TempPathFactory) -> RecordingSet:
    return recorded(tmp_path_factory.mktemp("free"))


def test_accelerations_are_those_of_newton(free: RecordingSet) -> None:
    data, body = samples(free, FITTED), free.scene.bodies[0]
    heading = data.velocity / np.linalg.norm(data.velocity, axis=1, keepdims=True)
    true = data.force / body.mass - 0.12 * 9.81 * heading  # the scene's own friction
    assert np.median(np.abs(data.acceleration - true)) < SMOOTH
    assert data.load == pytest.approx(9.81, abs=0.5)


@pytest.mark.slow
def test_sparse_regression_names_a_strong_drag(dragged: RecordingSet) -> None:
    assert sparse_regression(dragged.scene, samples(dragged, FITTED)).named == "viscous_drag"


@pytest.mark.slow
def test_a_free_residual_explains_a_drag_and_nothing_where_nothing_is(
    dragged: RecordingSet, free: RecordingSet
) -> None:
    with_drag, without = (
        free_residual(each.scene, {name: samples(each, split) for name, split in SPLITS.items()}, NOISE)
        for each in (dragged, free)
    )
    assert with_drag.flagged
    assert (with_drag.same or 0) > EXPLAINED
    assert not without.flagged


def test_where_nothing_moves_there_is_nothing_to_regress(tmp_path: Path) -> None:
    """A block that friction holds has no frame whose acceleration could be told."""
    config = GenerateConfig(
        scene="push", protocol="paper", trajectories=12, steps=30, video=False, split=SPLIT,
        true_values={"block.friction": 5.0},
    )  # fmt: skip
    generate(config, tmp_path / "still", quiet=True)
    recordings = RecordingSet(tmp_path / "still")
    assert len(samples(recordings, FITTED).time) == 0
    found = answers(recordings, replace(said("none"), ranking=()), NOISE)
    assert not found["sparse regression"].flagged
    assert not found["free residual"].flagged
