"""What `check` calls useless, `fit` and `diagnose` refuse in the same words; what they can spare passes all three."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tests.diagnosis.sets import recorded, rewritten

from physid.cli import main
from physid.data import Recording, RecordingSet
from physid.data.observations.trajectories import load_trajectories
from physid.inspection.examination import require_usable_set
from physid.inspection.report import inspect
from physid.inspection.usability import Motion, mistakes_in, require_usable

CONFIG = Path(__file__).parents[2] / "configs" / "sysid" / "push_friction.yaml"


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


def resting_but(kept: int) -> Callable[[int, Recording], Recording]:
    return lambda index, one: one if index == kept else at_rest(index, one)


def never_seen(index: int, one: Recording) -> Recording:
    """Lose the body in every frame of one trajectory."""
    return one if index != 1 else dataclasses.replace(one, pose=np.full_like(one.pose, np.nan), twist=None)


def with_an_hour_between(index: int, one: Recording) -> Recording:
    """Stamp the frames; in one trajectory an hour passes in the middle."""
    time = np.arange(one.length) / 240
    time[one.length // 2 :] += 3600 * (index == 1)
    return dataclasses.replace(one, time=time)


MISTAKES = [
    (never_seen, "000001.h5: pose: expected every body in some frame, found block in none"),
    (with_an_hour_between, "000001.h5: time: expected frames about 0.00417 s apart, found none for 3600 s"),
    (in_millimetres, "expected poses in metres, found bodies of "),
    (at_rest, "push harder than friction holds"),
    (without_forces, "trajectory 0: expected the commanded forces, found none, yet a body sets off from rest"),
    (at_another_rate, "000002.h5: time: expected about 240 frames per second"),
    (with_shuffled_frames, "check the tracker and the order of the frames"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("change", "said"), MISTAKES)
def test_useless_recordings_are_called_so_by_check_and_refused_by_fit_and_diagnose(
    sound: Path,
    tmp_path: Path,
    change: Callable[[int, Recording], Recording],
    said: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    spoilt = rewritten(sound, tmp_path / "spoilt", change)
    assert main(["check", str(spoilt)]) == 1
    assert said in capsys.readouterr().out
    run = ["fit", "--config", str(CONFIG), "--run-dir", str(tmp_path / "run"), f"data.folder={spoilt}"]
    for words in (run, ["diagnose", str(spoilt), "--out", str(tmp_path / "out"), "--quiet"]):
        assert main(words) == 2
        told = capsys.readouterr().err
        assert said in told
        assert str(spoilt) in told
    assert not (tmp_path / "out").exists()


def test_sound_recordings_pass_and_some_at_rest_are_a_remark(sound: Path, tmp_path: Path) -> None:
    for folder, remarks in ((sound, 0), (rewritten(sound, tmp_path / "one", resting_but(kept=1)), 1)):
        recordings = RecordingSet(folder)
        found = mistakes_in(Motion.of(recordings.scene, load_trajectories(recordings)))
        assert len(found) == remarks
        assert not any(one.wrong for one in found)


def test_a_body_that_sets_off_by_itself_beside_pushed_ones_is_a_remark(sound: Path, tmp_path: Path) -> None:
    """Another effect may move it; where nothing is ever pushed, forces are missing."""
    some = rewritten(sound, tmp_path / "some", lambda index, one: without_forces(index, one) if index == 2 else one)
    recordings = RecordingSet(some)
    (found,) = mistakes_in(Motion.of(recordings.scene, load_trajectories(recordings)))
    assert found.what.startswith("trajectory 2: expected the commanded forces")
    assert not found.wrong


def test_a_body_that_drops_and_rolls_on_needs_no_force(sound: Path, tmp_path: Path) -> None:
    def dropped(_: int, one: Recording) -> Recording:
        assert one.pose is not None
        pose, time = np.repeat(one.pose[:1], len(one.pose), 0), np.arange(len(one.pose)) / 240
        pose[..., 2] += np.maximum(0.02 - 9.81 / 2 * time**2, 0)[:, None]
        pose[..., 0] += np.maximum(time - 0.06, 0)[:, None]
        return dataclasses.replace(one, pose=pose, wrench=None)

    recordings = RecordingSet(rewritten(sound, tmp_path / "dropped", dropped))
    assert not mistakes_in(Motion.of(recordings.scene, load_trajectories(recordings)))


def test_a_fit_learns_from_motions_that_a_diagnosis_calls_rest(sound: Path, tmp_path: Path) -> None:
    def shrunk(_: int, one: Recording) -> Recording:
        assert one.pose is not None
        pose = np.repeat(one.pose[:1], len(one.pose), 0)
        pose[..., 0] += np.linspace(0, 0.002, len(pose))[:, None]
        return dataclasses.replace(one, pose=pose)

    recordings = RecordingSet(rewritten(sound, tmp_path / "small", shrunk))
    require_usable_set(recordings, range(len(recordings)))
    motion = Motion.of(recordings.scene, load_trajectories(recordings))
    with pytest.raises(ValueError, match=r"none that goes further than 2.0 mm in 8 of 8 trajectories"):
        require_usable(recordings.folder, motion)


def test_films_of_which_the_initial_poses_alone_are_known_are_no_bodies_at_rest(sound: Path, tmp_path: Path) -> None:
    def initial(_: int, one: Recording) -> Recording:
        assert one.pose is not None
        pose = np.full_like(one.pose, np.nan)
        pose[0] = one.pose[0]
        return dataclasses.replace(one, pose=pose, twist=None)

    recordings = RecordingSet(rewritten(sound, tmp_path / "initial", initial))
    require_usable_set(recordings, range(len(recordings)))
    assert not any(one.wrong for one in inspect(recordings).findings)


def test_few_trajectories_are_a_remark_of_check(tmp_path: Path) -> None:
    few = recorded(tmp_path / "few", trajectories=2, steps=20)
    (remark,) = [one for one in inspect(RecordingSet(few)).findings if "at least 3 trajectories" in one.what]
    assert not remark.wrong


def test_a_copy_of_another_trajectory_is_refused_and_two_alike_are_not(sound: Path, tmp_path: Path) -> None:
    first = RecordingSet(sound).read(0)
    assert first.pose is not None
    shaken = dataclasses.replace(first, pose=first.pose + np.array([1e-6, 0, 0, 0, 0, 0, 0]))
    for other, copies in ((first, 1), (shaken, 0)):

        def twice(index: int, one: Recording, other: Recording = other) -> Recording:
            return other if index == 2 else one

        recordings = RecordingSet(rewritten(sound, tmp_path / str(copies), twice))
        found = mistakes_in(Motion.of(recordings.scene, load_trajectories(recordings)))
        assert [one.what.startswith("trajectory 2: expected a recording of its own") for one in found] == [
            True
        ] * copies
        assert all(one.wrong for one in found)


@pytest.mark.parametrize(
    ("changed", "what", "mend"),
    [
        ({"gravity": (0.0, 0.0, -1.0)}, "that of the Earth in g", "write gravity: [0, 0, -9.81]"),
        ({"gravity": (0.0, 0.0, -9806.65)}, "that of the Earth in mm/s^2", "write gravity: [0, 0, -9.807]"),
        ({"time_step": 4.17}, "expected seconds between frames, found 4.17: times", "units.time=ms"),
        ({"gravity": (0.0, 0.0, -1.62)}, None, None),  # the moon
        ({"gravity": (0.0, 0.0, 0.0)}, None, None),
    ],
)
def test_a_scene_in_other_units_is_refused_with_what_to_write(
    sound: Path, changed: dict[str, Any], what: str | None, mend: str | None
) -> None:
    recordings = RecordingSet(sound)
    scene = dataclasses.replace(recordings.scene, **changed)
    found = mistakes_in(Motion.of(scene, load_trajectories(recordings)))
    assert [what in one.what for one in found if what] == [True] * (what is not None)
    assert all(mend is not None and mend in one.mend and one.wrong for one in found)


def test_frames_that_were_never_recorded_do_not_thin_out_jumps(sound: Path) -> None:
    """Beside one trajectory of thrice the length the share of jumps is the same."""
    scene, loaded = RecordingSet(sound).scene, load_trajectories(RecordingSet(sound))
    motion = Motion.of(scene, loaded)
    jumping = motion.pose.clone()
    jumping[:, 3::7, :, 0] += 0.5
    longer = torch.nn.functional.pad(motion.seen, (0, 0, 0, 80))
    more = torch.arange(1, 81, dtype=torch.float64) / 240
    time = torch.cat([motion.time, motion.time[:, -1:] + more], 1)
    held = torch.cat([jumping, jumping[:, -1:].expand(-1, 80, -1, -1)], 1)
    padded = replace(motion, pose=held, seen=longer, time=time)
    reported = [[one.what for one in mistakes_in(each)] for each in (replace(motion, pose=jumping), padded)]
    assert any("found jumps: 1" in one for one in reported[0]), reported
    assert reported[0] == reported[1]
