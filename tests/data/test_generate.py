"""Generated sets: the same bytes however they are made, resumable, with what was asked for in them."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from physid.data import RecordingSet
from physid.data.generation import generate as generation
from physid.data.generation.draw import draw
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig, Noise
from physid.data.truth import FILE, read_truth
from physid.effects import from_values
from physid.scenes import Integration
from physid.scenes.camera import Camera

SMALL = GenerateConfig("push", trajectories=6, steps=20, video=False, unknown=("block.friction",))
FILM = dataclasses.replace(SMALL, trajectories=2, steps=5, video=True)


def sums(folder: Path) -> str:
    return (folder / "SHA256SUMS").read_text()


MUJOCO = dataclasses.replace(SMALL, simulator="mujoco", frame_rate=60.0, trajectories=3)


UNEVEN = dataclasses.replace(
    SMALL, simulator="mujoco", frame_rate=60.0, steps=25, jitter=0.2, missing=0.2, force_rate=240.0, trajectories=3
)


@pytest.mark.parametrize("simulator", ["pybullet", "mujoco"])
@pytest.mark.parametrize(
    ("scene", "protocol"), [("push", "rich"), ("slide", "rich"), ("slide", "paper"), ("toss", "rich")]
)
@pytest.mark.parametrize("change", [0.1, -0.1])
def test_a_body_that_lies_starts_higher_by_half_of_what_it_is_larger_and_one_in_flight_where_it_was_drawn(
    scene: str, protocol: str, simulator: str, change: float
) -> None:
    config = GenerateConfig(scene, simulator, protocol=protocol, steps=3, video=False)
    drawn, motion, _ = draw(config, 0, protocol, [from_values("object_size", {"change": change})])
    plain, without, _ = draw(config, 0, protocol)
    assert np.array_equal(drawn.pose, plain.pose)  # what is drawn, and commanded, knows nothing of the effect
    ground, body = config.true_scene().ground, config.true_scene().bodies[0]
    lies = scene != "toss" and protocol == "rich"
    higher = change * body.size[2] / 2 * np.array(ground.normal) * lies
    assert np.abs(motion.pose[0, 0, :3] - without.pose[0, 0, :3] - higher).max() < 1e-12
    assert np.array_equal(motion.pose[0, 0, 3:], without.pose[0, 0, 3:])


@pytest.mark.parametrize("config", [SMALL, FILM, MUJOCO, UNEVEN], ids=["numbers", "video", "mujoco", "uneven"])
@pytest.mark.slow
def test_the_bytes_do_not_depend_on_the_number_of_workers(tmp_path: Path, config: GenerateConfig) -> None:
    for workers in (1, 2):
        generate(config, tmp_path / str(workers), workers, quiet=True)
    assert sums(tmp_path / "1") == sums(tmp_path / "2")


def test_an_interrupted_run_goes_on_where_it_stopped(tmp_path: Path) -> None:
    generate(SMALL, tmp_path / "whole", quiet=True)
    generate(SMALL, tmp_path / "broken", quiet=True)
    for index in (1, 4):
        (tmp_path / "broken" / "trajectories" / f"{index:06d}.h5").unlink()
    (tmp_path / "broken" / "trajectories" / "000004.h5.part").write_text("half")
    (tmp_path / "broken" / "SHA256SUMS").unlink()
    done = generate(SMALL, tmp_path / "broken", quiet=True)
    assert (done.written, done.kept) == (2, 4)
    assert sums(tmp_path / "whole") == sums(tmp_path / "broken")


def test_more_trajectories_may_be_added_but_nothing_else_changed(tmp_path: Path) -> None:
    generate(dataclasses.replace(SMALL, trajectories=3), tmp_path / "a", quiet=True)
    generate(SMALL, tmp_path / "a", quiet=True)
    generate(SMALL, tmp_path / "b", quiet=True)
    assert sums(tmp_path / "a") == sums(tmp_path / "b")
    with pytest.raises(ValueError, match=r"holds another recording set \(seed: 0 there, 1 here\)"):
        generate(dataclasses.replace(SMALL, seed=1), tmp_path / "a", quiet=True)


@pytest.mark.parametrize("written", ["write_truth", "write_scene"])
def test_a_kill_between_truth_and_description_bars_no_folder(
    written: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = getattr(generation, written)

    def killed(*given: Any) -> None:
        usual(*given)
        raise KeyboardInterrupt

    monkeypatch.setattr(generation, written, killed)
    with pytest.raises(KeyboardInterrupt):
        generate(SMALL, tmp_path / "set", quiet=True)
    monkeypatch.undo()
    generate(SMALL, tmp_path / "set", quiet=True)
    generate(SMALL, tmp_path / "other", quiet=True)
    assert sums(tmp_path / "set") == sums(tmp_path / "other")


def test_a_set_whose_truth_was_taken_away_cannot_be_known_to_be_the_same(
    tmp_path: Path,
) -> None:
    generate(SMALL, tmp_path, quiet=True)
    (tmp_path / FILE).unlink()
    with pytest.raises(ValueError, match=r"holds another recording set, or this one, whose truth is not at .*truth"):
        generate(SMALL, tmp_path, quiet=True)


def test_a_set_of_other_effects_is_another_set(tmp_path: Path) -> None:
    wind, drag = from_values("constant_force", {"x": 0.1, "y": 0.0}), from_values("viscous_drag", {"coefficient": 5.0})
    generate(dataclasses.replace(SMALL, trajectories=2), tmp_path, effects=[wind, drag], quiet=True)
    for others in ([drag], [wind], [], [drag, wind]):
        with pytest.raises(ValueError, match="holds another recording set"):
            generate(SMALL, tmp_path, effects=others, quiet=True)
    assert generate(SMALL, tmp_path, effects=[wind, drag], quiet=True).kept == 2


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"effects": {"viscous_dragg": {"coefficient": 0.6}}}, "did you mean"),
        ({"effects": {"viscous_drag": {"coefficientt": 0.6}}}, "did you mean"),
        ({"effects": {"viscous_drag": {"coefficient": -3.0}}}, "coefficient"),
        ({"simulator": "closed_form", "effects": {"quadratic_drag": {"coefficient": 0.6}}}, "not quadratic_drag"),
        pytest.param(
            {"true_values": {"block.mass": 0.05}, "steps": 300}, "left the view in all", marks=pytest.mark.slow
        ),
    ],
    ids=["effect", "key", "size", "simulator", "view"],
)
def test_what_cannot_be_made_leaves_no_description_that_bars_the_folder(
    tmp_path: Path, wrong: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        generate(dataclasses.replace(SMALL, **wrong), tmp_path / "set", quiet=True)
    assert not (tmp_path / "set").exists()
    assert generate(SMALL, tmp_path / "set", quiet=True).written == SMALL.trajectories


def test_what_cannot_be_made_leaves_a_set_that_was_begun_as_it_is(tmp_path: Path) -> None:
    generate(SMALL, tmp_path, quiet=True)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(ValueError, match="did you mean"):
        generate(dataclasses.replace(SMALL, effects={"viscous_dragg": {}}), tmp_path, quiet=True)
    assert sorted(tmp_path.rglob("*")) == before


def test_the_recording_holds_a_guess_and_the_truth_is_apart(tmp_path: Path) -> None:
    config = dataclasses.replace(SMALL, trajectories=1, true_values={"block.mass": 1.5})
    generate(config, tmp_path, quiet=True)
    scene, truth = RecordingSet(tmp_path).scene, read_truth(tmp_path)
    assert truth is not None
    assert scene.unknown == ("block.friction",)
    assert scene.value("block.friction") == pytest.approx(2 * truth.parameters["block.friction"])
    assert scene.value("block.mass") == truth.parameters["block.mass"] == 1.5
    assert scene.camera is None
    assert GenerateConfig.from_mapping(truth.generation) == config


def test_the_truth_may_be_stored_elsewhere(tmp_path: Path) -> None:
    place = tmp_path / "sealed" / "push.yaml"
    config = dataclasses.replace(SMALL, trajectories=1, truth_file=str(place))
    generate(config, tmp_path / "set", quiet=True)
    assert read_truth(tmp_path / "set") is None
    assert read_truth(place) is not None


@pytest.mark.parametrize("content", ["", "my: notes\n", "format: physid-truth\n", "\x00"])
def test_a_truth_replaces_no_file_that_is_none(tmp_path: Path, content: str) -> None:
    place = tmp_path / "precious.yaml"
    place.write_text(content)
    config = dataclasses.replace(SMALL, trajectories=1, truth_file=str(place))
    with pytest.raises(ValueError, match=r"precious\.yaml.*choose another truth_file") as caught:
        generate(config, tmp_path / "set", quiet=True)
    assert len(str(caught.value).splitlines()) == 1
    assert [path.name for path in tmp_path.rglob("*")] == ["precious.yaml"]
    assert place.read_text() == content


def test_a_truth_replaces_no_link_that_leads_nowhere_and_no_folder(tmp_path: Path) -> None:
    (tmp_path / "link.yaml").symlink_to(tmp_path / "nowhere")
    (tmp_path / "folder.yaml").mkdir()
    for name in ("link.yaml", "folder.yaml"):
        config = dataclasses.replace(SMALL, trajectories=1, truth_file=str(tmp_path / name))
        with pytest.raises(ValueError, match=f"{name}: expected a file for the truth, found something else"):
            generate(config, tmp_path / "set", quiet=True)
    assert not (tmp_path / "set").exists()


def test_a_truth_replaces_that_of_the_same_set_alone(tmp_path: Path) -> None:
    place = tmp_path / "truth" / "push.yaml"
    config = dataclasses.replace(SMALL, trajectories=1, truth_file=str(place))
    generate(config, tmp_path / "one", quiet=True)
    generate(dataclasses.replace(config, trajectories=2), tmp_path / "one", quiet=True)
    generate(dataclasses.replace(config, trajectories=2), tmp_path / "again", quiet=True)
    before = place.read_bytes()
    with pytest.raises(
        ValueError, match=r"push\.yaml holds the truth of another recording set \(seed: 0 there, 1 here"
    ):
        generate(dataclasses.replace(config, seed=1), tmp_path / "other", quiet=True)
    assert place.read_bytes() == before
    assert not (tmp_path / "other").exists()


def test_the_truth_in_the_folder_replaces_nothing_else_either(tmp_path: Path) -> None:
    (tmp_path / "truth.yaml").write_text("mine: 1\n")
    with pytest.raises(ValueError, match=r"truth\.yaml: .*it is no truth that physid wrote"):
        generate(dataclasses.replace(SMALL, trajectories=1), tmp_path, quiet=True)
    (tmp_path / "truth.yaml").write_text(
        "{format: physid-truth, version: 1, parameters: {}, effects: {}, generation: {}}"
    )
    with pytest.raises(ValueError, match=r"truth\.yaml: expected the truth of a generated set"):
        generate(dataclasses.replace(SMALL, trajectories=1), tmp_path, quiet=True)


@pytest.mark.parametrize("name", ["/tmp/x/.bashrc", "authorized_keys", "a.py", "set/recording.yaml", "a\n.yaml", ""])
def test_the_name_of_a_truth_file_says_what_it_is(name: str) -> None:
    with pytest.raises(ValueError, match=r"truth_file: expected a file \.yaml or \.yml, and not recording\.yaml, got"):
        dataclasses.replace(SMALL, truth_file=name)


def test_a_film_shows_the_bodies_and_the_empty_scene(tmp_path: Path) -> None:
    generate(FILM, tmp_path, quiet=True)
    recordings = RecordingSet(tmp_path)
    recording = recordings.read(0, video=True)
    assert isinstance(recordings.scene.camera, Camera)
    assert recording.frames is not None
    assert recording.mask is not None
    assert recording.frames.shape == (5, 128, 128, 3)
    shown = (recording.frames[0] != recording.background).any(-1)
    assert (recording.mask[0] & shown).sum() > 0.9 * shown.sum() > 100


def test_noise_has_the_size_asked_for_and_hides_the_velocities(tmp_path: Path) -> None:
    clean = dataclasses.replace(SMALL, trajectories=3, steps=100)
    noisy = dataclasses.replace(clean, noise=Noise(position=1e-3, rotation=2e-3))
    generate(clean, tmp_path / "clean", quiet=True)
    generate(noisy, tmp_path / "noisy", quiet=True)
    poses = [[one.pose for one in RecordingSet(tmp_path / name)] for name in ("clean", "noisy")]
    error = np.subtract(poses[1], poses[0])
    turn = 2 * np.linalg.norm(error[..., 3:], axis=-1)
    assert error[..., :3].std() == pytest.approx(1e-3, rel=0.1)
    assert turn.mean() == pytest.approx(2e-3 * np.sqrt(8 / np.pi), rel=0.1)
    assert RecordingSet(tmp_path / "noisy").read(0).twist is None
    assert RecordingSet(tmp_path / "clean").read(0).twist is not None


def test_an_effect_changes_the_motion_but_not_the_command(tmp_path: Path) -> None:
    with_drag = dataclasses.replace(SMALL, effects={"viscous_drag": {"coefficient": 2.0}})
    for name, config in (("plain", SMALL), ("drag", with_drag)):
        generate(config, tmp_path / name, quiet=True)
    plain, drag = (RecordingSet(tmp_path / name).read(0) for name in ("plain", "drag"))
    truth = read_truth(tmp_path / "drag")
    assert np.array_equal(plain.wrench, drag.wrench)
    assert not np.array_equal(plain.pose, drag.pose)
    assert truth is not None
    assert truth.effects == {"viscous_drag": {"coefficient": 2.0}}


def test_splits_may_have_protocols_of_their_own(tmp_path: Path) -> None:
    config = dataclasses.replace(
        SMALL, split={"fit": 2, "report_transfer": 1}, protocol_of_split={"report_transfer": "rich"}
    )
    generate(config, tmp_path, quiet=True)
    found = {(one.split, one.protocol) for one in RecordingSet(tmp_path)}
    assert found == {("fit", "paper"), ("report_transfer", "rich")}


def test_trajectories_that_leave_the_view_are_drawn_again_and_counted() -> None:
    config = GenerateConfig("push", trajectories=1, protocol="rich")
    counts = []
    for index in range(20):
        _, motion, redrawn = draw(config, index, "rich")
        scene = config.true_scene()
        assert scene.camera is not None
        assert scene.camera.sees(motion.pose, scene.sizes).all()
        counts.append(redrawn)
    assert sum(counts) > 0


@pytest.mark.slow
def test_a_scene_from_which_bodies_always_escape_is_refused() -> None:
    config = GenerateConfig("push", trajectories=1, steps=300, true_values={"block.mass": 0.05})
    with pytest.raises(ValueError, match="left the view in all of 200 draws; lower steps"):
        draw(config, 0, "paper")


def test_frames_come_at_the_rate_asked_for_and_forces_change_with_them(tmp_path: Path) -> None:
    slow = dataclasses.replace(SMALL, frame_rate=60.0, steps=20)
    for name, config in (("slow", slow), ("usual", dataclasses.replace(SMALL, steps=77))):
        generate(config, tmp_path / name, quiet=True)
    sets = [RecordingSet(tmp_path / name) for name in ("slow", "usual")]
    assert [found.scene.time_step for found in sets] == [1 / 60, 1 / 240]
    slow_one, usual_one = (found.read(0) for found in sets)
    assert slow_one.pose is not None
    assert slow_one.pose.shape == (20, 1, 7)
    assert slow_one.wrench is not None
    assert usual_one.wrench is not None
    assert np.array_equal(slow_one.wrench, usual_one.wrench[::4])


def test_two_simulators_move_a_block_alike_but_not_in_the_last_digit(tmp_path: Path) -> None:
    for name in ("pybullet", "mujoco"):
        generate(dataclasses.replace(SMALL, simulator=name, substeps=16), tmp_path / name, quiet=True)
    sets = [RecordingSet(tmp_path / name) for name in ("pybullet", "mujoco")]
    one, other = (found.read(0).pose for found in sets)
    assert one is not None
    assert other is not None
    assert [found.scene.source for found in sets] == ["pybullet", "mujoco"]
    assert 0 < np.abs(one - other)[..., :3].max() < 1e-4


def test_uneven_frames_show_the_motion_at_their_own_times_and_forces_have_their_own_clock(tmp_path: Path) -> None:
    even = dataclasses.replace(UNEVEN, jitter=0.0, missing=0.0, frame_rate=960.0, steps=400, force_rate=None)
    for name, config in (("uneven", UNEVEN), ("fine", even)):
        generate(config, tmp_path / name, 1, quiet=True)
    uneven, fine = (RecordingSet(tmp_path / name).read(0) for name in ("uneven", "fine"))
    assert uneven.time is not None
    assert uneven.wrench_time is not None
    assert uneven.wrench is not None
    assert fine.pose is not None
    assert fine.wrench is not None
    nominal = np.rint(uneven.time * 60)
    assert np.abs(uneven.time * 60 - nominal).max() <= 0.2 + 1e-9
    assert np.abs(uneven.time * 60 - nominal).max() > 0.1
    assert 12 <= len(uneven.time) < 25
    assert np.diff(uneven.wrench_time) == pytest.approx(1 / 240)
    assert np.array_equal(uneven.wrench, fine.wrench[:: 960 // 240][: len(uneven.wrench)])
    for axis in range(3):
        path = np.interp(uneven.time, fine.stamps(1 / 960), fine.pose[:, 0, axis])
        assert uneven.pose is not None
        assert np.abs(uneven.pose[:, 0, axis] - path).max() < 1e-5


@pytest.mark.parametrize("uneven", [{}, {"force_rate": 30.0}, {"jitter": 0.2, "missing": 0.1}], ids=str)
@pytest.mark.parametrize("beside", [{}, {"force_delay": {"delay": 0.02}}], ids=str)
def test_a_filter_sees_the_frames_of_its_camera_and_nothing_between_them(
    uneven: dict[str, float], beside: dict[str, dict[str, float]], tmp_path: Path
) -> None:
    plain = GenerateConfig(
        "push", protocol="straight", trajectories=1, steps=40, frame_rate=30.0, video=False, simulator="closed_form",
        effects=beside, **uneven,
    )  # fmt: skip
    filters = {"observation_lag": {"time_constant": 0.03}, "observation_smoothing": {"variance": 0.001}}
    for name, values in filters.items():
        made = dataclasses.replace(plain, effects={name: values, **beside})
        for folder, config in (("true", plain), ("seen", made)):
            generate(config, tmp_path / name / folder, 1, quiet=True)
        true, seen = (RecordingSet(tmp_path / name / folder).read(0) for folder in ("true", "seen"))
        assert true.pose is not None
        assert seen.pose is not None
        stamps = torch.from_numpy(true.stamps(1 / 30))[None]
        expected = from_values(name, values).observe(torch.from_numpy(true.pose)[None], stamps)[0]
        assert np.abs(seen.pose - true.pose).max() > 1e-4
        assert np.abs(seen.pose - expected.numpy()).max() < 1e-9


@pytest.mark.parametrize("simulator", ["closed_form", "mujoco"])
def test_a_late_camera_shows_poses_between_frames_as_they_were_and_what_was_before_the_first_one(
    tmp_path: Path, simulator: str
) -> None:
    late = {"observation_latency": {"latency": 20 / 34 / 30}}  # so many of the instants that are simulated
    rates = (("slow", 30.0, 25, late), ("fast", 300.0, 250, {}))  # bounces lie between the frames of the slow one
    for name, rate, steps, effects in rates:
        config = GenerateConfig(
            "toss", protocol="straight", trajectories=1, steps=steps, frame_rate=rate, video=False, simulator=simulator
        )
        generate(dataclasses.replace(config, effects=effects), tmp_path / name, workers=1)
    slow, fast = (RecordingSet(tmp_path / name).read(0) for name in ("slow", "fast"))
    # The motion begins when the camera takes what it shows first, and no forces act; MuJoCo's steps differ in length.
    np.testing.assert_allclose(slow.pose, fast.pose[::10], atol=1e-9 if simulator == "closed_form" else 2e-3)


def test_a_fast_camera_shows_nothing_of_what_comes_after_the_end(tmp_path: Path) -> None:
    fast = {"clock_rate": {"change": 0.1}}
    config = GenerateConfig(
        "toss", protocol="straight", trajectories=1, steps=100, video=False, simulator="closed_form"
    )
    generate(config, tmp_path / "plain", workers=1)
    generate(dataclasses.replace(config, effects=fast), tmp_path / "fast", workers=1)
    plain, seen = (RecordingSet(tmp_path / name).read(0) for name in ("plain", "fast"))
    assert seen.seen[:91].all()
    assert not seen.seen[91:].any()  # 91 frames of 1.1 times the time are 100
    np.testing.assert_allclose(seen.pose[:91:10], plain.pose[:100:11], atol=1e-9)


@pytest.mark.parametrize(("simulator", "rate"), [("closed_form", 30.0), ("mujoco", 60.0), ("pybullet", 60.0)])
def test_what_acts_late_is_simulated_between_the_frames(simulator: str, rate: float) -> None:
    config = GenerateConfig("push", trajectories=1, steps=20, frame_rate=rate, video=False, simulator=simulator)
    plain, late = config.sampling(), config.sampling([from_values("force_delay", {"delay": 0.004})])
    assert plain.step == pytest.approx(1 / rate)
    assert late.step <= (1 / 240 if simulator == "pybullet" else 1e-3)
    assert late.stamps(late.frames) == pytest.approx(plain.stamps(plain.frames))
    assert len(late.forces) == len(plain.forces)


def test_forces_that_change_between_frames_are_told_with_their_times(tmp_path: Path) -> None:
    config = dataclasses.replace(SMALL, frame_rate=30.0, steps=10, force_rate=100.0, trajectories=1)
    generate(config, tmp_path, quiet=True)
    recording = RecordingSet(tmp_path).read(0)
    assert recording.time is not None
    assert recording.wrench_time is not None
    # Frames are taken at the steps next to their times.
    assert np.abs(recording.time - np.arange(10) / 30).max() <= 0.5 / 600 + 1e-12
    assert recording.wrench_time[-1] <= recording.time[-1] < recording.wrench_time[-1] + 0.01


def test_a_simulator_that_shares_its_scheme_with_the_model_is_named_with_its_step(tmp_path: Path) -> None:
    for name, changes in (("pybullet", {"substeps": 4}), ("mujoco", {"simulator": "mujoco"})):
        generate(dataclasses.replace(SMALL, trajectories=1, **changes), tmp_path / name, quiet=True)  # type: ignore[arg-type]
    told = [RecordingSet(tmp_path / name).scene.integration for name in ("pybullet", "mujoco")]
    assert told == [Integration("semi_implicit_euler", 1 / 960), None]
