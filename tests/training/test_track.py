"""Poses read from films: as exact as the images allow, from nothing but the initial poses, or from outlines alone."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from physid.cli import main
from physid.data import Recording, RecordingSet, trajectory_path, write_scene, write_sums, write_trajectory
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.data.reading import ECHO, Reading, read_reading, write_reading
from physid.inspection.examination import examine
from physid.networks import as_image
from physid.networks.appearance import Appearance
from physid.physics.rotations import conjugate, logarithm, multiply
from physid.simulators.bullet.camera import Studio
from physid.training.runs.run import CHECKPOINT, restore
from physid.training.tracking.earlier import key_of
from physid.training.tracking.sight import require_sight
from physid.training.tracking.track import track
from physid.training.tracking.tracking_error import smoothed
from physid.training.vision import ChartName
from physid.training.vision.drawing.decoder import Decoder
from physid.training.vision.first_look import learn_look
from physid.training.vision.model import VideoModel

PIXEL = 0.0208  # [m] in the middle of the view
EXACT = 0.12  # [pixel] root mean square error of a place along each axis
TURNED = 0.02  # [rad] and of the heading
ALIKE = 2.0  # factor within which drawn films show how far off poses from real ones are
OUTLINED = 0.3  # [pixel] error of first places that outlines tell


def films_of(folder: Path, scene: str = "push", **changes: object) -> Path:
    known: dict[str, object] = {"protocol": "rich", "trajectories": 4, "steps": 40, "unknown": ("block.friction",)}
    generate(GenerateConfig(scene, **known | changes), folder, 1, quiet=True)  # type: ignore[arg-type]
    return folder


def rewritten(source: Path, folder: Path, keep: int | None) -> Path:
    """Copy films with the poses of the first `keep` frames only, nonsense behind; with none of them at all if None."""
    recordings = RecordingSet(source)
    write_scene(folder, recordings.scene)
    for index in range(len(recordings)):
        one = recordings.read(index, video=True)
        assert one.pose is not None
        pose = one.pose.copy()
        pose[keep:] = pose[:1]
        known = dataclasses.replace(one, pose=None if keep is None else pose, twist=None)
        write_trajectory(trajectory_path(folder, index), known)
    write_sums(folder)
    return folder


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return films_of(tmp_path_factory.mktemp("films") / "push")


@pytest.fixture(scope="module")
def read(films: Path) -> Path:
    track(films, films.parent / "read")
    return films.parent / "read"


def errors(first: Path, second: Path) -> tuple[Tensor, Tensor]:
    """Return how far places [pixel] and headings [rad] of two sets are apart, (R, T, N, 2) and (R, T, N)."""
    one, other = (torch.stack([torch.from_numpy(each.pose) for each in RecordingSet(path)]) for path in (first, second))
    turn = logarithm(multiply(one[..., 3:], conjugate(other[..., 3:])))
    return (one[..., :2] - other[..., :2]) / PIXEL, turn[..., 2]


def size(error: Tensor) -> float:
    return float(error.square().mean().sqrt())


@pytest.mark.slow
def test_read_poses_are_a_tenth_of_a_pixel_off(films: Path, read: Path) -> None:
    place, turn = errors(read, films)
    assert size(place) < EXACT
    assert size(turn) < TURNED


@pytest.mark.slow
def test_poses_settle_where_a_motion_changes_between_two_frames(films: Path, tmp_path: Path) -> None:
    """Poses of a body that is suddenly elsewhere than it was headed for are as exact as any others."""
    recordings = RecordingSet(films)
    write_scene(tmp_path / "films", recordings.scene)
    for index in range(2):
        one = recordings.read(index, video=True)
        assert one.frames is not None
        assert one.pose is not None
        back = np.r_[0:20, 0:20, 19:-1:-1]  # starts over, and turns round
        known = dataclasses.replace(
            one, frames=one.frames[back], pose=one.pose[back], wrench=None, twist=None, time=None, wrench_time=None
        )
        write_trajectory(trajectory_path(tmp_path / "films", index), known)
    write_sums(tmp_path / "films")
    track(tmp_path / "films", tmp_path / "read")
    place, turn = errors(tmp_path / "read", tmp_path / "films")
    assert float(place.abs().max()) < 4 * EXACT
    assert size(turn) < TURNED


@pytest.mark.slow
def test_reading_drawn_films_tells_how_far_off_read_poses_are(films: Path, read: Path) -> None:
    for own, again in zip(errors(read, films), errors(read / ECHO, read), strict=True):
        assert 1 / ALIKE < size(again) / size(own) < ALIKE


@pytest.mark.slow
def test_films_are_found_again_by_who_has_read_them(films: Path, read: Path) -> None:
    reading = read_reading(read)
    assert reading is not None
    assert reading.films_folder() == films.resolve()


@pytest.mark.slow
def test_only_first_poses_are_looked_at(films: Path, read: Path, tmp_path: Path) -> None:
    track(rewritten(films, tmp_path / "films", 1), tmp_path / "read")
    for here, there in zip(RecordingSet(tmp_path / "read"), RecordingSet(read), strict=True):
        assert np.array_equal(np.asarray(here.pose), np.asarray(there.pose))


@pytest.mark.slow
def test_without_any_pose_outlines_find_the_bodies_up_to_half_a_turn(films: Path, tmp_path: Path) -> None:
    track(rewritten(films, tmp_path / "films", None), tmp_path / "read")
    place, turn = errors(tmp_path / "read", films)
    assert float(place.abs().max()) < OUTLINED + 3 * EXACT
    half = (turn.abs() - math.pi).abs() < 5 * TURNED
    assert bool(half.all()) or bool((turn.abs() < 5 * TURNED).all()), "all alike, or all turned"
    reading = read_reading(tmp_path / "read")
    assert reading is not None
    assert reading.stretch_deviation > 0, "no pose has told the scale"


@pytest.mark.slow
def test_the_encoder_of_a_run_finds_the_bodies_and_knows_their_look(
    films: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = tmp_path / "run"
    tiny = [
        "data.batch_size=4",
        "data.every=10",
        "data.draw=1",
        "data.test=[train]",
        "model.objective.synthetic_images.frames=1",
    ]
    tiny += [
        "model.phases.warm_up=1",
        "model.phases.refine=0",
        "model.vision.pose_refinement.steps=2",
        "model.vision.pose_refinement.headings=1",
    ]
    tiny += ["trainer.max_epochs=1", "trainer.accelerator=cpu", "wandb=disabled", f"data.folder={films}"]
    config = Path(__file__).parents[2] / "configs" / "supervised" / "push_friction.yaml"
    assert main(["fit", "--config", str(config), f"--run-dir={run}", *tiny]) == 0
    blind = rewritten(films, tmp_path / "films", None)
    model = restore(run, blind)
    weights = torch.load(run / CHECKPOINT, weights_only=True)["state_dict"]
    assert all(torch.equal(value, weights[name]) for name, value in model.named_parameters())
    truth = torch.stack([torch.from_numpy(np.asarray(one.pose)[:1]) for one in RecordingSet(films)]).float()
    # One epoch teaches no encoder anything.
    monkeypatch.setattr(VideoModel, "read", lambda *_: (truth, truth))
    track(blind, tmp_path / "read", encoder=run, limit=len(truth))
    place, turn = errors(tmp_path / "read", films)
    assert size(place) < EXACT
    assert size(turn) < TURNED


def test_a_folder_without_a_run_is_no_encoder(films: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected a run of `physid fit`"):
        track(films, tmp_path / "read", encoder=tmp_path)


@pytest.mark.slow
def test_two_bodies_that_hit_each_other_are_followed(tmp_path: Path) -> None:
    films = films_of(tmp_path / "films", "collide", trajectories=2, steps=60, unknown=())
    track(films, tmp_path / "read")
    place, _ = errors(tmp_path / "read", films)
    assert size(place) < EXACT


@pytest.mark.slow
def test_an_interrupted_reading_goes_on_and_ends_as_one_that_was_not(films: Path, read: Path, tmp_path: Path) -> None:
    out = tmp_path / "read"

    def interrupt(task: str, done: int, total: int) -> None:
        if task == "reading drawn films" and done > total // 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        track(films, out, say=interrupt)
    seen: dict[str, set[float]] = {}
    track(films, out, say=lambda task, done, total: seen.setdefault(task, set()).add(done / total))
    assert seen["reading the films"] == {0.5}, "what was read is not read again"
    assert max(seen["reading drawn films"]) == 1.0
    sums = [f"{place}SHA256SUMS" for place in ("", f"{ECHO}/")]

    def same() -> bool:
        return all(len({tuple((path / one).read_text().splitlines()[1:]) for path in (out, read)}) == 1 for one in sums)

    assert same()
    # One that was lost is read in the company that it was read in: beside others, rounding is another.
    for one in sums:
        trajectory_path((out / one).parent, 1).unlink()
        (out / one).unlink()
    track(films, out)
    assert same()


@pytest.mark.slow
def test_a_lost_body_is_said_with_trajectory_and_frame(films: Path, tmp_path: Path) -> None:
    def jump(one: Recording) -> Recording:
        assert one.frames is not None
        frames = one.frames.copy()
        frames[20:] = np.roll(frames[20:], 40, 2)
        return dataclasses.replace(one, frames=frames, pose=one.pose, twist=None)

    recordings = RecordingSet(films)
    write_scene(tmp_path / "films", recordings.scene)
    for index in range(2):
        one = recordings.read(index, video=True)
        write_trajectory(trajectory_path(tmp_path / "films", index), jump(one) if index else one)
    with pytest.raises(ValueError, match=r"trajectory 1: .* lost sight of them in frame 20"):
        track(tmp_path / "films", tmp_path / "read")
    assert not (tmp_path / "read").exists(), "no half-written set"
    track(tmp_path / "films", tmp_path / "read", limit=1)
    with pytest.raises(ValueError, match="lost sight"):
        track(tmp_path / "films", tmp_path / "read")
    assert len(RecordingSet(tmp_path / "read")) == 1, "what was complete stays"
    assert read_reading(tmp_path / "read") is not None


@pytest.mark.slow
@pytest.mark.parametrize(("part", "noise"), [(0.0, 0.0), (0.0, 15.0), (0.6, 0.0), (0.6, 5.0)])
def test_frames_in_which_something_hides_a_body_are_said_and_no_others(
    films: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture, part: float, noise: float
) -> None:
    recordings = RecordingSet(films)
    write_scene(tmp_path / "films", recordings.scene)
    camera, (edge, *_) = recordings.scene.camera, recordings.scene.sizes[0]
    assert camera is not None
    for index in range(2):
        one = recordings.read(index, video=True)
        assert one.frames is not None
        assert one.pose is not None
        frames = one.frames + noise * np.random.default_rng(index).standard_normal(one.frames.shape)
        if index:
            for frame in range(15, 25):  # a dark bar covers that part of the view of the body
                column, row = camera.project(one.pose[frame, :, :3])[0, :2].astype(int)
                reach = int(edge / PIXEL)
                frames[frame, row - reach : row + reach, column - reach : int(column + (2 * part - 1) * reach / 2)] = 20
        known = dataclasses.replace(one, frames=frames.round().clip(0, 255).astype(np.uint8), twist=None)
        write_trajectory(trajectory_path(tmp_path / "films", index), known)
    track(tmp_path / "films", tmp_path / "read")
    said = [each.getMessage() for each in caplog.records if "should be bodies" in each.getMessage()]
    assert len(said) == (part > 0)
    assert all("trajectory 1: in 10 frame(s), from 15 to 24, up to" in each for each in said)
    examined = [one.what for one in examine(RecordingSet(tmp_path / "read"), range(2)) if "something hides" in one.what]
    assert len(examined) == len(said)
    assert all("trajectory 1: in 10 frame(s), from 15 to 24, up to" in each for each in examined)


def test_films_without_a_mask_are_refused(films: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recordings = RecordingSet(films)
    write_scene(tmp_path / "films", recordings.scene)
    one = dataclasses.replace(recordings.read(0, video=True), mask=None)
    write_trajectory(trajectory_path(tmp_path / "films", 0), one)
    assert main(["track", str(tmp_path / "films"), "--out", str(tmp_path / "read"), "--quiet"]) == 2
    assert "000000.h5: mask: expected it" in capsys.readouterr().err
    assert not (tmp_path / "read").exists()


@pytest.mark.slow
def test_a_folder_with_poses_of_other_films_is_kept(films: Path, read: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="read from other films"):
        track(films_of(tmp_path / "films", trajectories=1, seed=5), read)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_folder_that_holds_anything_else_is_left_as_it_is(
    films: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Another recording set has files of the same names as the set to write; a note of the user's is kept, too."""
    generate(GenerateConfig("push", trajectories=2, steps=20, video=False), tmp_path / "mine", 1, quiet=True)
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "todo.txt").write_text("precious")
    for out in (tmp_path / "mine", tmp_path / "notes", films):
        before = contents(out)
        assert main(["track", str(films), "--out", str(out), "--quiet"]) == 2
        assert "expected a new or an empty folder, or poses that were read into it" in capsys.readouterr().err
        assert contents(out) == before


def marked(films: Path, out: Path, encoder: Path | None = None, chart: ChartName | None = None) -> Path:
    """Write what a reading leaves that was interrupted at its beginning."""
    key = key_of(RecordingSet(films), encoder, chart)
    out.mkdir(parents=True)
    write_reading(out, Reading(str(films), str(encoder or ""), chart or "planar", 0.0, 0.0, key))
    return out


def test_what_is_asked_for_otherwise_is_said_and_that_films_are_the_same(films: Path, tmp_path: Path) -> None:
    out = marked(films, tmp_path / "read", chart="spatial")
    with pytest.raises(ValueError, match=r"without --encoder and with --chart planar, as .* same films .* spatial"):
        track(films, out, chart="planar")
    with pytest.raises(ValueError, match=r"with --encoder .*run and with --chart spatial, as .* without --encoder and"):
        track(films, out, chart="spatial", encoder=tmp_path / "run")
    with pytest.raises(ValueError, match="read from other films"):
        track(films_of(tmp_path / "films", trajectories=1, steps=10, seed=5), out, chart="spatial")


def test_a_reading_that_is_complete_learns_where_its_films_are(films: Path, tmp_path: Path) -> None:
    """Earlier versions did not note by what films are known again; nothing is read once more for that."""
    out = marked(films, tmp_path / "read")
    for folder in (out, out / ECHO):
        write_scene(folder, RecordingSet(films).scene)
        for index in range(4):
            trajectory_path(folder, index).parent.mkdir(exist_ok=True)
            trajectory_path(folder, index).write_bytes(b"")
    before, files = read_reading(out), contents(out)
    assert before is not None
    assert before.films_folder() is None
    track(films, out)
    after = read_reading(out)
    assert after is not None
    assert after.films_folder() == films.resolve()
    assert dataclasses.replace(after, films=before.films, seen="") == before
    again = contents(out)
    assert [name for name in files if again[name] != files[name]] == ["reading.yaml"]


def test_trajectories_that_nobody_read_end_no_reading_in_an_error_of_its_own(films: Path, tmp_path: Path) -> None:
    """Poses that are drawn again are all those of the set: with more of them than films nothing goes on."""
    out = marked(films, tmp_path / "read")
    for index in range(5):
        trajectory_path(out, index).parent.mkdir(exist_ok=True)
        trajectory_path(out, index).write_bytes(b"")
    before = contents(out)
    with pytest.raises(ValueError, match="expected at most the 4 trajectories that are asked for, found 5"):
        track(films, out)
    assert contents(out) == before


def test_smoothing_keeps_parabolas_and_the_sign_of_quaternions_does_not_matter() -> None:
    time = torch.linspace(0, 1, 40, dtype=torch.float64)
    place = torch.stack([time**2, 1 - time, 0 * time], -1)
    angle = 0.1 * time
    turn = torch.stack([0 * time, 0 * time, (angle / 2).sin(), (angle / 2).cos()], -1)
    pose = torch.cat([place, turn], -1)[:, None]
    flipped = pose.clone()
    flipped[::2, :, 3:] *= -1
    for each in (pose, flipped):
        smooth = smoothed(each)
        assert torch.allclose(smooth[..., :3], pose[..., :3])
        assert torch.allclose((smooth[..., 3:] * pose[..., 3:]).sum(-1).abs(), torch.ones(40, 1, dtype=torch.float64))


def test_cut_faces_are_laid_on_drawn_bodies_as_the_decoder_lays_them(films: Path) -> None:
    recordings = RecordingSet(films)
    decoder = Decoder(recordings.scene)
    learn_look(decoder, recordings, range(len(recordings)))
    marked = decoder.patches.clone()
    marked[..., :14, :14], marked[..., 0, :14, 18:], marked[..., 1:, :14, 18:] = 0.0, 1.0, 0.0
    pose, background = recordings.read(0).pose, recordings.film(0, [0])[2]
    assert pose is not None
    behind = as_image(torch.from_numpy(background))[None]
    wanted = decoder.renderer(torch.from_numpy(pose[:1])[None].float(), Appearance(marked), behind)[0, 0]
    differences = []
    for patches in (marked, marked.flip(-1), marked.flip(-2), marked.mT):
        faces = (255 * patches[0]).round().byte().movedim(2, -1).numpy()
        with Studio(recordings.scene, faces) as studio:
            studio.background = background
            image, which = studio.shoot(pose[0])
        away = np.abs(image / 255 - wanted.movedim(0, -1).numpy())
        differences.append(float(away[which >= 0].mean()))
    assert min(differences[1:]) > 3 * differences[0]


@pytest.mark.parametrize(("frame", "mend"), [(1, "begin the film with every body at rest"), (2, "cut the film there")])
def test_a_body_that_is_lost_before_its_speed_is_known_shall_begin_at_rest(frame: int, mend: str) -> None:
    with pytest.raises(ValueError, match=f"trajectory 4: .* in frame {frame}: 60% .*; {mend}, or record at a higher"):
        require_sight(torch.tensor([0.1, 0.6]), frame, (3, 4), torch.tensor([True, True]))
