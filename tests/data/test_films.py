"""Films become recording sets: frames of an ideal camera, a background without bodies, masks; one image in memory."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage
from tests.data import filmed

from physid.cli import main
from physid.data import RecordingSet
from physid.data.importers.video.cameras import read_camera, solve_place
from physid.data.importers.video.convert import import_films
from physid.data.importers.video.films import FilmFile, ImageFolder, counted
from physid.data.importers.video.lens import Lens
from physid.data.importers.video.shadows import Mixture, smoothed
from physid.data.importers.video.shutter import ShutterGauge
from physid.data.importers.video.sights import find_bodies, gain_of, grown, median_of
from physid.training.tracking.light import relit

cv2 = pytest.importorskip("cv2")
MATRIX = np.array([[260.0, 0, 99.0], [0, 255.0, 68.0], [0, 0, 1]])
DISTORTION = np.array([-0.21, 0.06, 0.002, -0.001, 0.0])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("film")
    filmed.write_camera(folder / "camera.yaml")
    filmed.write_film(folder / "a.mp4", filmed.images(drift=0.1))
    filmed.write_forces(folder / "a_forces.csv", 1.0)
    return folder


@pytest.fixture
def place(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A film, its camera and its forces, in a folder of the test's own."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    return tmp_path


def silhouette(number: int) -> NDArray[np.bool_]:
    empty = np.zeros((filmed.CAMERA.height, filmed.CAMERA.width, 3))
    return np.asarray(filmed.draw(filmed.path_of(24)[number], 0.4, empty).max(-1) > 5)


def test_a_film_and_a_log_of_forces_become_a_set(place: Path) -> None:
    reported: list[tuple[str, int, int]] = []
    done = import_films([place / "a.mp4"], dict(filmed.MAPPING), place / "set", lambda *words: reported.append(words))
    made = RecordingSet(done.folder)
    made.verify()
    one = made.read(0, video=True)
    assert one.frames is not None
    count = len(one.frames)
    counted = [("writing the films", k, count) for k in range(1, count + 1)]
    assert reported == [("looking at the films", 0, 0), *counted]
    assert one.mask is not None
    assert one.wrench is not None
    assert one.wrench_time is not None
    assert one.frames.shape == (24, 144, 192, 3)
    assert made.scene.time_step == pytest.approx(1 / 30)
    assert made.scene.camera is not None
    points = np.array([[0.1, 0.0, 0.0], [-0.1, 0.1, 0.05]])
    assert np.allclose(made.scene.camera.project(points), filmed.CAMERA.project(points))
    assert made.scene.unknown == ("block.friction",)
    assert one.wrench_time[1] == pytest.approx(0.01)
    true = silhouette(0)
    assert (one.mask[0] & true).sum() / (one.mask[0] | true).sum() > 0.85
    assert np.abs(one.frames[3].astype(float) - filmed.images(drift=0.1)[3]).mean() < 3


def test_forces_of_a_film_that_change_steadily_go_along_lines(place: Path) -> None:
    (place / "a_forces.csv").write_text("t,fx,fy,fz\n0,0,0,0\n0.4,4,0,0\n0.8,0,0,0\n")
    values = {**filmed.MAPPING, "forces": {**filmed.MAPPING["forces"], "between": "linear"}}
    one = RecordingSet(import_films([place / "a.mp4"], values, place / "set").folder).read(0, video=True)
    assert one.wrench is not None
    assert one.wrench_time is not None
    held = np.diff(one.wrench_time)
    assert float((one.wrench[:-1, 0, 3] * held).sum()) == pytest.approx(0.4 * 4)
    assert float(one.wrench[:, 0, 3].max()) == pytest.approx(4 * (1 - 1 / 16))


def test_columns_of_forces_without_a_log_that_holds_them_are_refused(place: Path) -> None:
    with pytest.raises(ValueError, match=r"mapping: missing forces\.file, .* a film has no columns"):
        import_films([place / "a.mp4"], {**filmed.MAPPING, "forces": None}, place / "set")


@pytest.mark.slow
def test_the_background_is_free_of_a_body_that_lingers_and_of_drifting_exposure(place: Path) -> None:
    frames = filmed.images(drift=0.1)
    filmed.write_film(place / "b.mp4", frames[:10] + frames[10:11] * 6 + frames[11:])
    made = RecordingSet(
        import_films([place / "b.mp4"], dict(filmed.MAPPING, forces={}, force=None), place / "set").folder
    )
    background = made.read(0, video=True).background
    assert background is not None
    apart = background / gain_of(background, filmed.table()) - filmed.table()
    assert np.abs(apart).max() < 25
    assert np.abs(apart).mean() < 3


@pytest.mark.parametrize("number", [1, 2, 5, 8])
def test_a_median_is_that_of_what_is_not_hidden(number: int) -> None:
    draw = np.random.default_rng(number)
    images = [draw.uniform(0, 255, (9, 7, 3)).astype(np.float32) for _ in range(number)]
    hidden = [draw.random((9, 7)) < 0.4 for _ in range(number)]
    found = median_of(images, hidden)
    assert found.dtype == np.float32
    for row, column in np.ndindex(9, 7):
        seen = [image[row, column] for image, mask in zip(images, hidden, strict=True) if not mask[row, column]]
        wanted = np.median(np.stack(seen), 0) if seen else np.full(3, np.nan)
        assert np.array_equal(found[row, column], wanted, equal_nan=True)


@pytest.mark.parametrize("share", [0.0, 1e-3, 0.1])
def test_a_mask_grows_by_steps_along_rows_and_columns(share: float) -> None:
    mask = np.random.default_rng(0).random((40, 50)) < share
    assert np.array_equal(grown(mask, 6), ndimage.binary_dilation(mask, iterations=6))


@pytest.mark.parametrize("corner", [(0, 0), (20, 25), (45, 50)])
def test_a_mask_of_a_body_is_the_same_wherever_it_is_looked_for(corner: tuple[int, int]) -> None:
    draw = np.random.default_rng(3)
    image, behind = (draw.uniform(0, 255, (60, 70, 3)) for _ in range(2))
    about = np.zeros((60, 70), dtype=bool)
    about[corner[0] : corner[0] + 15, corner[1] : corner[1] + 20] = True
    mixture = Mixture(image, behind, about)
    whole = ndimage.binary_fill_holes(ndimage.binary_opening(mixture.body > 0.5))
    assert np.array_equal(mixture.mask, whole)
    assert mixture.mask.any()
    assert not Mixture(image, behind, np.zeros_like(about)).mask.any()


def test_a_shadow_is_no_body() -> None:
    behind = filmed.table()
    dark = np.ones(behind.shape[:2])
    dark[60:110, 20:90] = 0.55
    image = filmed.draw(np.array([0.05, 0.0]), 0.4, behind * dark[..., None])
    found = find_bodies(image.round().astype(np.uint8), behind.round().astype(np.uint8), 1)[0]
    true = filmed.draw(np.array([0.05, 0.0]), 0.4, np.zeros_like(behind)).max(-1) > 5
    assert (found & true).sum() / (found | true).sum() > 0.85


@pytest.mark.parametrize("beyond", [0, 2, 8])
def test_of_a_body_that_the_border_cuts_what_is_within_is_found(beyond: int) -> None:
    background = filmed.table().round().astype(np.uint8)
    image = filmed.draw(np.array([0.05, 0.0]), 0.4, filmed.table()).round().astype(np.uint8)
    whole = find_bodies(image, background, 1)[0]
    (top, left), (bottom, right) = (change(np.argwhere(whole), axis=0) for change in (np.min, np.max))
    cuts = [np.s_[top + beyond :], np.s_[: bottom + 1 - beyond], np.s_[:, left + beyond :]]
    for cut in (*cuts, np.s_[:, : right + 1 - beyond]):
        found = find_bodies(np.ascontiguousarray(image[cut]), np.ascontiguousarray(background[cut]), 1)[0]
        assert (found ^ whole[cut]).sum() < 0.02 * whole[cut].sum()


@pytest.mark.parametrize("side", [-1, 1])
def test_a_shadow_that_touches_a_body_hardly_moves_its_mask_or_its_edges(side: int) -> None:
    behind, place = filmed.table(), np.array([0.05, 0.0])
    cover = np.asarray(filmed.draw(place, 0.4, np.zeros_like(behind)).max(-1) > 5)
    row, column = np.argwhere(cover).mean(0).astype(int)
    shade = np.ones(cover.shape)
    shade[row - 8 : row + 30, min(column, column + 50 * side) :][:, :50] = 0.5
    shade = cv2.GaussianBlur(shade, (0, 0), 1.5)
    lights = (np.ones(cover.shape), shade)
    lit, dark = (filmed.draw(place, 0.4, behind * light[..., None]).round().astype(np.uint8) for light in lights)
    background = behind.round().astype(np.uint8)
    one, other = (np.argwhere(find_bodies(image, background, 1)[0]).mean(0) for image in (lit, dark))
    assert np.abs(one - other).max() < 0.6, "[px]; a threshold on differences moves it by 0.9"
    wide, narrow = (change(cover.astype(np.uint8), np.ones((7, 7))).astype(bool) for change in (cv2.dilate, cv2.erode))
    steady = relit(dark.astype(float), background, smoothed(background), 1)
    left, before = (np.abs(image - lit.astype(float))[wide & ~narrow].mean() for image in (steady, dark))
    assert left < 0.5 * before


def test_images_in_a_folder_are_a_film_in_natural_order(place: Path) -> None:
    (place / "shots").mkdir()
    for number, image in enumerate(filmed.images(12)):
        Image.fromarray(image).save(place / "shots" / f"shot_{number}.png")
    drawn = [image for _, image in ImageFolder(place / "shots").frames()]
    assert all(np.array_equal(one, two) for one, two in zip(drawn, filmed.images(12), strict=True))
    words = ["import", "mp4", "shots", "camera=camera.yaml", f"size={filmed.EDGES.tolist()}", "mass=1", "rate=60"]
    assert main([*words, "--out=set"]) == 0
    assert RecordingSet(place / "set").scene.time_step == pytest.approx(1 / 60)


def write_opencv(path: Path) -> Path:
    data = ", ".join(map(str, MATRIX.ravel()))
    path.write_text(
        "%YAML:1.0\n---\nimage_width: 192\nimage_height: 144\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n"
        f"   dt: d\n   data: [ {data} ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n"
        f"   data: [ {', '.join(map(str, DISTORTION))} ]\nrvec: [2.3, 0.1, -0.05]\ntvec: [0.0, 0.1, 0.9]\n"
    )
    return path


def write_ros(path: Path, points: Any) -> Path:
    path.write_text(
        "image_width: 192\nimage_height: 144\ncamera_name: narrow\ndistortion_model: plumb_bob\n"
        f"camera_matrix: {{rows: 3, cols: 3, data: {MATRIX.ravel().tolist()}}}\n"
        f"distortion_coefficients: {{rows: 1, cols: 5, data: {DISTORTION.tolist()}}}\n"
        f"rectification_matrix: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}\npoints: {points}\n"
    )
    return path


def seen_at(lens: Lens, points: NDArray[np.float64]) -> NDArray[np.float64]:
    turn = cv2.Rodrigues(lens.rotation)[0]
    return np.asarray(cv2.projectPoints(points, turn, lens.translation, lens.matrix, lens.distortion)[0].reshape(-1, 2))


@pytest.mark.parametrize(
    ("names", "places", "lost"),
    [
        (["shot_1", "shot_2", "shot_3", f"shot_{10**15}"], None, ()),
        (["f0028", "f0030", "f0032", "f0033", "f0034", "f0035", "f0036"], [0, 2, 4, 5, 6, 7, 8], ("0029", "0031")),
        (["a7_x", "a8_x", "a10_x", "a11_x"], [0, 1, 3, 4], ("9",)),
        (["0001", "0002", "0003"], None, ()),
        (["10", "20", "30"], None, ()),
        (["1000", "1033", "1067", "1100"], None, ()),
        (["1", "2", "b3", "4", "6"], None, ()),
        (["one", "three", "two"], None, ()),
        (["1"], None, ()),
    ],
)
def test_images_that_are_missing_are_known_by_numbers_that_count(
    names: list[str], places: list[int] | None, lost: tuple[str, ...]
) -> None:
    """Every second number, stamps in milliseconds and mixed names say nothing of missing images."""
    found, missing = counted(names)
    assert (None if found is None else found.tolist()) == places
    assert missing == lost


def test_a_gap_in_numbered_images_is_noted_and_moves_no_later_image(place: Path) -> None:
    (place / "shots").mkdir()
    for number, image in enumerate(filmed.images(), 1):
        if number not in (9, 11):
            Image.fromarray(image).save(place / "shots" / f"{number:04}.png")
    filmed.write_forces(place / "shots_forces.csv", 24 / filmed.RATE)
    done = import_films([place / "shots"], {**filmed.MAPPING, "rate": filmed.RATE}, place / "set")
    assert [one for one in done.notes if "images 0009, 0011 are missing" in one]
    time = RecordingSet(done.folder).read(0, video=True).time
    assert time is not None
    assert np.allclose(time, np.setdiff1d(np.arange(24), [8, 10]) / filmed.RATE)


@pytest.mark.slow
@pytest.mark.parametrize(("times", "noted"), [(0.5, True), (0.8, False), (1.0, False), (1.3, False), (2.0, True)])
def test_a_film_that_lasts_much_longer_or_shorter_than_its_forces_is_noted_with_the_rate(
    place: Path, times: float, noted: bool
) -> None:
    filmed.write_film(place / "run.mp4", filmed.images(), times * filmed.RATE)
    filmed.write_forces(place / "run_forces.csv", 24 / filmed.RATE)
    done = import_films([place / "run.mp4"], dict(filmed.MAPPING), place / "set")
    said = [one for one in done.notes if "of forces; if both" in one]
    assert len(said) == noted
    for one in said:
        named = re.search(r"true rate is ([\d.]+)", one)
        assert named is not None
        assert float(named[1]) == pytest.approx(filmed.RATE, rel=0.05)


def test_camera_files_of_opencv_and_ros_say_the_same(tmp_path: Path) -> None:
    lens = read_camera(write_opencv(tmp_path / "opencv.yaml"))
    assert np.array_equal(lens.matrix, MATRIX)
    ground = np.array([[-0.1, -0.1, 0], [0.15, -0.1, 0], [0.15, 0.1, 0], [-0.1, 0.12, 0], [0.0, 0.05, 0]])
    rows = np.concatenate([seen_at(lens, ground), ground[:, :2]], 1).tolist()
    again = read_camera(write_ros(tmp_path / "ros.yaml", rows))
    assert np.allclose(again.rotation, lens.rotation, atol=1e-4)
    assert np.allclose(again.translation, lens.translation, atol=1e-4)


@pytest.mark.parametrize("size", ["{a: 1}", "-3", "1.5", ".nan", "wide"])
def test_a_size_that_is_no_number_of_pixels_is_refused_with_file_and_key(size: str, tmp_path: Path) -> None:
    path = write_opencv(tmp_path / "opencv.yaml")
    path.write_text(path.read_text().replace("image_width: 192", f"image_width: {size}"))
    with pytest.raises(ValueError, match=r"opencv\.yaml: image_width must be a whole number of at least 1"):
        read_camera(path)


def test_the_ideal_camera_sees_points_where_the_straightened_image_has_them(tmp_path: Path) -> None:
    lens = read_camera(write_opencv(tmp_path / "opencv.yaml"))
    camera, maps = lens.pinhole(), lens.maps()
    assert maps is not None
    points = np.array([[0.0, 0.0, 0.0], [0.12, 0.05, 0.02], [-0.15, -0.1, 0.0], [0.1, -0.12, 0.05]])
    wanted = camera.project(points)[:, :2] - 0.5  # OpenCV counts pixel centres
    at = [wanted[:, k].astype(np.float32).reshape(-1, 1) for k in (0, 1)]
    straight = np.stack([cv2.remap(one, *at, cv2.INTER_LINEAR) for one in maps], -1).reshape(-1, 2)
    assert np.allclose(straight, seen_at(lens, points), atol=0.05)


@pytest.mark.slow
def test_a_film_of_a_checkerboard_tells_the_lens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    matrix = np.array([[520.0, 0, 331.0], [0, 515.0, 228.0], [0, 0, 1]])
    squares, side, generator, shots = (8, 6), 0.03, np.random.default_rng(0), []
    for _ in range(16):
        turn = generator.uniform(-0.5, 0.5, 3)
        shift = np.array([*generator.uniform(-0.06, 0.06, 2), generator.uniform(0.35, 0.5)]) - [0.12, 0.09, 0]
        image = np.full((480, 640), 200, np.uint8)
        for x in range(squares[0]):
            for y in range(squares[1]):
                if (x + y) % 2:
                    continue
                edge, zero, one = np.linspace(0, 1, 9), np.zeros(9), np.ones(9)
                sides = ((edge, zero), (one, edge), (1 - edge, one), (zero, 1 - edge))
                outline = np.concatenate([np.stack(pair, -1) for pair in sides]) + np.array([x, y])
                corners = np.concatenate([side * outline, np.zeros((len(outline), 1))], 1)
                pixels = cv2.projectPoints(corners, turn, shift, matrix, DISTORTION)[0].reshape(-1, 2)
                cv2.fillPoly(image, [(64 * pixels).round().astype(np.int32)], 20, shift=6, lineType=cv2.LINE_AA)
        shots.append(np.repeat(cv2.GaussianBlur(image, (0, 0), 0.7)[..., None], 3, -1))
    filmed.write_film(tmp_path / "board.mp4", shots)
    assert main(["calibrate", "board.mp4", "--corners=7x5", "--square=0.03"]) == 0
    assert "focal length" in capsys.readouterr().out
    with (tmp_path / "camera.yaml").open("a") as file:
        file.write("position: [0, 0, 1]\ntarget: [0, 0, 0]\nup: [0, 1, 0]\n")
    lens = read_camera(tmp_path / "camera.yaml")
    assert lens.matrix[0, 0] == pytest.approx(520, rel=0.01)
    assert lens.matrix[:2, 2] == pytest.approx(matrix[:2, 2], abs=4)
    assert lens.distortion[0] == pytest.approx(DISTORTION[0], abs=0.04)
    assert main(["calibrate", "board.mp4", "--corners=9x6"]) == 2
    assert "count inner corners" in capsys.readouterr().err


def cut(place: Path) -> None:
    whole = (place / "a.mp4").read_bytes()
    (place / "a.mp4").write_bytes(whole[: len(whole) // 2])


def cut_stream(place: Path) -> None:
    """Keep the index of the film and lose its end, as a download that broke off."""
    import subprocess

    exe = filmed.imageio_ffmpeg.get_ffmpeg_exe()
    subprocess.run(
        [exe, "-loglevel", "error", "-i", "a.mp4", "-c", "copy", "-movflags", "faststart", "b.mp4"], check=True
    )
    whole = (place / "b.mp4").read_bytes()
    (place / "a.mp4").write_bytes(whole[: int(0.6 * len(whole))])


def still(place: Path) -> None:
    filmed.write_film(place / "a.mp4", filmed.images()[:1] * 20)


def short(place: Path) -> None:
    filmed.write_film(place / "a.mp4", filmed.images()[:2])


def other_size(place: Path) -> None:
    text = (place / "camera.yaml").read_text().replace("width: 192", "width: 1920")
    (place / "camera.yaml").write_text(text)


def late_forces(place: Path) -> None:
    text = (place / "a_forces.csv").read_text().splitlines()
    rows = [",".join([str(float(row.split(",")[0]) + 50), *row.split(",")[1:]]) for row in text[1:]]
    (place / "a_forces.csv").write_text("\n".join([text[0], *rows]))


def camera_without_place(place: Path) -> None:
    (place / "camera.yaml").write_text(
        "image_width: 192\nimage_height: 144\ncamera_matrix: [260, 0, 96, 0, 260, 72, 0, 0, 1]\n"
    )


def camera_points_on_a_line(place: Path) -> None:
    camera_without_place(place)
    with (place / "camera.yaml").open("a") as file:
        file.write("points: [[10, 10, 0, 0], [20, 20, 0.1, 0.1], [30, 30, 0.2, 0.2], [40, 40, 0.3, 0.3]]\n")


def fisheye(place: Path) -> None:
    camera_without_place(place)
    with (place / "camera.yaml").open("a") as file:
        file.write("distortion_model: equidistant\n")


def mistyped_camera_key(place: Path) -> None:
    camera_without_place(place)
    with (place / "camera.yaml").open("a") as file:
        file.write("distorsion_coefficients: [0, 0, 0, 0, 0]\n")


def no_permission(place: Path) -> None:
    (place / "a.mp4").chmod(0)


def no_film(place: Path) -> None:
    (place / "a.mp4").write_text("this is no film")


def empty_folder(place: Path) -> None:
    (place / "a.mp4").unlink()
    (place / "a.mp4").mkdir()


def mixed_images(place: Path) -> None:
    empty_folder(place)
    for number, size in enumerate([(192, 144)] * 4 + [(96, 72)]):
        Image.new("RGB", size).save(place / "a.mp4" / f"{number}.png")


def images_without_rate(place: Path) -> None:
    empty_folder(place)
    for number, image in enumerate(filmed.images(6)):
        Image.fromarray(image).save(place / "a.mp4" / f"{number}.png")


@pytest.mark.parametrize(
    ("last", "message"),
    [
        ([40, 31, 0.0, 0.0], "expected points that a camera can see so"),
        ([40, 31, 0.1, -0.1, 0.0, 11.0, -0.1], "expected 4 or more rows"),
        ([40, 31, 0.1], "expected 4 or more rows"),
    ],
)
def test_points_that_no_camera_sees_so_are_refused_and_so_is_a_row_with_more_than_its_numbers(
    last: list[float], message: str
) -> None:
    matrix = np.array([[60.0, 0, 31.5], [0, 60, 23.5], [0, 0, 1]])
    rows = [[31, 23, 0.0, 0.0], [40, 23, 0.1, 0.0], [31, 30, 0.0, -0.1], last]
    with pytest.raises(ValueError, match=f"camera.yaml: points: {message}"):
        solve_place(rows, matrix, np.zeros(5), "camera.yaml")


@pytest.mark.parametrize(
    ("spoil", "changes", "message"),
    [
        (cut, {}, "a.mp4: expected a film, found a file that cannot be decoded; an mp4 whose end is missing"),
        (cut_stream, {}, "the film is cut off or damaged"),
        (no_film, {}, "a.mp4: expected a film, found a file that cannot be decoded"),
        (still, {}, "expected 1 body that differ from the background, found 0; begin the film"),
        (short, {}, "expected a film of 4 frames or more, found 2"),
        (other_size, {}, "expected images of 1920 x 144 as the camera file says, found 192 x 144"),
        (late_forces, {}, "wrench_time"),
        (camera_without_place, {}, "expected the place of the camera, found none: rvec and tvec"),
        (camera_points_on_a_line, {}, "expected points that span a plane, got some on a line"),
        (fisheye, {}, "distortion_model: expected plumb_bob or rational_polynomial, got 'equidistant'"),
        (mistyped_camera_key, {}, 'unknown key "distorsion_coefficients"; did you mean "distortion_coefficients"?'),
        (no_permission, {}, "Permission denied"),
        (empty_folder, {}, "expected images (.png, .jpg"),
        (mixed_images, {"rate": 30}, "expected an image of 192 x 144 as the others, found 96 x 72"),
        (images_without_rate, {}, "expected the time between images, found none; give rate (frames per second)"),
        (None, {"camera": None}, "missing camera: a camera file; physid calibrate makes one"),
        (None, {"camera": "none.yaml"}, "none.yaml: expected a camera file, found no such file"),
        (None, {"position": ["x", "y", "z"]}, 'unknown key "position"'),
        (None, {"background": "empty.png"}, "empty.png: expected an image of the empty scene"),
        (None, {"size": None}, "missing size: its edges"),
        (None, {"forces": {"file": "x.csv", "time": "t"}}, "expected a log of forces (forces.file)"),
    ],
)  # fmt: skip
def test_a_mistake_is_answered_and_leaves_nothing(
    spoil: Any, changes: dict[str, Any], message: str, place: Path
) -> None:
    if spoil is no_permission and os.geteuid() == 0:
        pytest.skip("root may read everything")
    if spoil is not None:
        spoil(place)
    values = {key: value for key, value in {**filmed.MAPPING, **changes}.items() if value is not None}
    with pytest.raises((ValueError, OSError)) as caught:
        import_films([place / "a.mp4"], values, place / "set")
    assert message in str(caught.value)
    assert not (place / "set").exists()
    assert not (place / "set.part").exists()


def test_a_rate_that_the_header_has_wrong_is_given_and_remarked(place: Path) -> None:
    done = import_films([place / "a.mp4"], {**filmed.MAPPING, "rate": 240, "forces": {}, "force": None}, place / "set")
    assert any("240 frames per second, as the mapping says; the header of a.mp4 says 30" in note for note in done.notes)
    assert RecordingSet(place / "set").scene.time_step == pytest.approx(1 / 240)


def test_a_film_is_read_frame_by_frame_with_its_stamps(place: Path) -> None:
    stamps = [stamp for stamp, _ in FilmFile(place / "a.mp4").frames()]
    assert np.allclose(stamps, np.arange(24) / 30, atol=2e-3)


def swung(delay: float, turning: float, frames: int = 60, strips: int = 9) -> list[NDArray[np.uint8]]:
    """Draw a box that is swung to and fro, strip by strip at other times where rows follow each other."""
    generator, behind, drawn = np.random.default_rng(3), filmed.table(), []
    height = len(behind)
    for number in range(frames):
        image = np.zeros_like(behind)
        for strip in range(strips if delay else 1):
            rows = slice(height * strip // strips, height * (strip + 1) // strips) if delay else slice(height)
            time = number + (delay * ((strip + 0.5) / strips - 0.5) if delay else 0.0)
            angle = 2 * np.pi * time / frames
            place = np.array([0.18 * np.sin(3 * angle), 0.12 * np.sin(2 * angle)])
            image[rows] = filmed.draw(place, 0.4 + turning * time, behind)[rows]
        noisy = (1.05 - 0.1 * number / frames) * image + 2 * generator.standard_normal(behind.shape)
        drawn.append(noisy.round().clip(0, 255).astype(np.uint8))
    return drawn


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.8, -0.8])
@pytest.mark.parametrize("turning", [0.0, 0.01])
def test_a_rolling_shutter_is_measured_and_a_global_one_is_not_taken_for_one(
    place: Path, delay: float, turning: float
) -> None:
    gauge = ShutterGauge(filmed.table().round().clip(0, 255).astype(np.uint8))
    for image in swung(delay, turning):
        gauge.look(image)
    measured = gauge.delay()
    assert measured is not None
    found, deviation, _ = measured
    assert abs(found - delay) < 3 * deviation
    assert deviation < 0.1
    assert bool(gauge.remark()) == bool(delay)


@pytest.mark.slow
def test_an_import_says_that_a_film_has_a_rolling_shutter(place: Path) -> None:
    filmed.write_film(place / "rolling.mp4", swung(0.9, 0.0))
    done = import_films([place / "rolling.mp4"], dict(filmed.MAPPING, forces={}, force=None), place / "set")
    assert any("rolling.mp4: a rolling shutter: from the top row to the bottom one" in note for note in done.notes)


def test_a_body_that_hardly_moves_says_nothing_of_the_shutter() -> None:
    gauge = ShutterGauge(filmed.table().round().clip(0, 255).astype(np.uint8))
    for _ in range(3):
        gauge.look(filmed.images()[0])
    assert gauge.delay() is None
    assert gauge.remark() == ""
