"""Recordings from which nothing can be concluded are refused in one line that says what would be needed."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from diagnosis.sets import recorded, rewritten
from physid.cli import main
from physid.data import RecordingSet, write_scene
from physid.diagnosis.diagnose import diagnose
from physid.diagnosis.document.document import FILE
from physid.diagnosis.inputs.observations import load_observations
from physid.diagnosis.inputs.requirements import require_usable
from physid.diagnosis.settings.settings import Settings


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("sound") / "set", steps=40, noise={})


def test_few_trajectories_are_refused(tmp_path: Path) -> None:
    few = recorded(tmp_path / "few", trajectories=2, steps=20)
    with pytest.raises(ValueError, match="at least 3 trajectories"):
        diagnose(RecordingSet(few), tmp_path / "out")


def test_sound_recordings_are_not_refused_and_short_ones_are(sound: Path) -> None:
    observations, settings = load_observations(RecordingSet(sound)), Settings()
    require_usable(observations, settings.requirements, settings.noise)
    least = settings.requirements.model_copy(update={"least_frames": observations.pose.shape[1] + 1})
    with pytest.raises(ValueError, match=f"of {least.least_frames} frames or more"):
        require_usable(observations, least, settings.noise)


def test_a_force_that_acts_for_a_while_is_what_sets_a_body_off_and_without_any_they_are_missing(
    tmp_path: Path,
) -> None:
    pushed = recorded(tmp_path / "pushed", protocol="paper", protocol_of_split={}, steps=60, noise={})
    observations, settings = load_observations(RecordingSet(pushed)), Settings()
    require_usable(observations, settings.requirements, settings.noise)
    silent = rewritten(
        pushed, tmp_path / "silent", lambda _, one: dataclasses.replace(one, wrench=np.zeros_like(one.wrench))
    )
    with pytest.raises(ValueError, match="expected the commanded forces"):
        require_usable(load_observations(RecordingSet(silent)), settings.requirements, settings.noise)


def test_what_looks_like_a_mistake_in_a_transfer_set_names_that_set(sound: Path, tmp_path: Path) -> None:
    other = recorded(tmp_path / "other", steps=40, noise={}, seed=7)
    turned = rewritten(other, tmp_path / "turned", lambda _, one: dataclasses.replace(one, wrench=-one.wrench))
    settings = Settings()
    for sets, named in (((sound, turned), f"{turned}: "), ((turned, sound), "")):
        observations = load_observations(*map(RecordingSet, sets))
        odd = [one.what for one in require_usable(observations, settings.requirements, settings.noise)]
        (pushed,) = [one for one in odd if "the other sign" in one or "against" in one or "opposite" in one]
        assert pushed.startswith(named)
        assert (str(turned) in pushed) is bool(named)


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
