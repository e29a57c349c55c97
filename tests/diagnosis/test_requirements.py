"""Recordings from which nothing can be concluded are refused in one line that says what would be needed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from diagnosis.sets import recorded, rewritten
from physid.cli import main
from physid.data.format import RecordingSet, write_scene
from physid.data.recording import Recording
from physid.diagnosis.diagnose import diagnose
from physid.diagnosis.document.document import FILE


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("sound") / "set", steps=40, noise={})


def in_millimetres(_: int, one: Recording) -> Recording:
    assert one.pose is not None
    return dataclasses.replace(one, pose=one.pose * np.array([1e3, 1e3, 1e3, 1, 1, 1, 1]))


def at_rest(_: int, one: Recording) -> Recording:
    assert one.pose is not None
    return dataclasses.replace(one, pose=np.repeat(one.pose[:1], len(one.pose), 0))


def without_forces(_: int, one: Recording) -> Recording:
    assert one.pose is not None
    along = np.maximum(np.arange(len(one.pose)) - 12, 0)[:, None] * 0.005
    pose = np.repeat(one.pose[:1], len(one.pose), 0)
    pose[..., 0] += along
    return dataclasses.replace(one, pose=pose, wrench=None)


def at_another_rate(index: int, one: Recording) -> Recording:
    return dataclasses.replace(one, time=np.arange(one.length) / (60 if index == 2 else 240))


def with_shuffled_frames(_: int, one: Recording) -> Recording:
    assert one.pose is not None
    return dataclasses.replace(one, pose=np.random.default_rng(0).permutation(one.pose))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (in_millimetres, "Divide positions by 1000"),
        (at_rest, "push harder than friction holds"),
        (without_forces, "add the dataset `wrench`"),
        (at_another_rate, "000002.h5: time: expected about 240 frames per second .* found 60"),
        (with_shuffled_frames, "check the tracker"),
    ],
)
def test_a_set_that_says_nothing_is_refused(
    sound: Path, tmp_path: Path, change: Callable[[int, Recording], Recording], said: str
) -> None:
    spoilt = rewritten(sound, tmp_path / "spoilt", change)
    with pytest.raises(ValueError, match=said):
        diagnose(RecordingSet(spoilt), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_few_trajectories_are_refused(tmp_path: Path) -> None:
    few = recorded(tmp_path / "few", trajectories=2, steps=20)
    with pytest.raises(ValueError, match="at least 3 trajectories"):
        diagnose(RecordingSet(few), tmp_path / "out")


def test_a_transfer_set_of_another_body_is_refused(sound: Path, tmp_path: Path) -> None:
    other = rewritten(sound, tmp_path / "other", lambda _, one: one)
    scene = RecordingSet(sound).scene
    write_scene(other, scene.with_bodies([dataclasses.replace(scene.bodies[0], size=(0.1, 0.1, 0.1))]))
    with pytest.raises(ValueError, match="expected the bodies of"):
        diagnose(RecordingSet(sound), tmp_path / "out", transfer=RecordingSet(other))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere"], "found no recording.yaml"),
        (["SET", "--model", "nowhere.yaml"], "nowhere.yaml does not exist"),
        (["SET", "--transfer", "nowhere"], "found no recording.yaml"),
        (["SET", "--effects", "nowhere.py:Own"], "no file nowhere.py"),
        (["SET", "--modle", "x"], "did you mean"),
    ],
)
def test_the_command_says_in_one_line_what_is_wrong(
    sound: Path, tmp_path: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [str(sound) if word == "SET" else word for word in words]
    assert main(["diagnose", *given, "--out", str(tmp_path / "out"), "--quiet"]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out" / FILE).exists()


def test_a_model_that_names_another_body_is_refused(sound: Path, tmp_path: Path) -> None:
    model = tmp_path / "model.yaml"
    model.write_text("model: {values: {ball.mass: 1.0}}\n")
    with pytest.raises(ValueError, match=r"model.yaml: unknown parameter \"ball.mass\""):
        diagnose(RecordingSet(sound), tmp_path / "out", model=model)
