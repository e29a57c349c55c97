"""Films, pictures and camera files of strangers: their size is inspected first, and what no camera has is refused."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import cv2
import imageio_ffmpeg
import numpy as np
import pytest
import yaml
from PIL import Image
from tests.data import filmed

from physid.cli import main
from physid.data import RecordingSet
from physid.data.importers.video import pictures
from physid.data.importers.video.calibrate import Calibrated
from physid.data.importers.video.cameras import read_camera
from physid.data.importers.video.convert import import_films
from physid.data.importers.video.films import FilmFile, ImageFolder, open_film

ALONE = {key: value for key, value in filmed.MAPPING.items() if key not in ("forces", "force")}


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    filmed.write_camera(tmp_path / "camera.yaml")
    return tmp_path


def stamped(path: Path, times: list[int]) -> Path:
    """Encode a film whose frames have stamps [ms]."""
    folder = path.with_suffix(".images")
    folder.mkdir()
    for number, image in enumerate(filmed.images(len(times))):
        Image.fromarray(image).save(folder / f"{number:03d}.png")
    chosen = "0"
    for number, time in enumerate(times):
        chosen = f"if(eq(N,{number}),{1000 * time + number},{chosen})"  # rounded to milliseconds by the container
    stamps = f"settb=1/1000000,setpts='{chosen}'"
    exe = imageio_ffmpeg.get_ffmpeg_exe()
    subprocess.run(
        [exe, "-loglevel", "error", "-framerate", "30", "-i", folder / "%03d.png", "-vf", stamps, "-fps_mode",
         "passthrough", "-enc_time_base", "1:1000000", "-c:v", "mjpeg", "-q:v", "2", "-pix_fmt", "yuvj444p", path],
        check=True,
    )  # fmt: skip
    return path


UNEVEN = [*(round(1000 * k / 30) for k in range(10)), *(333 + 12 * k for k in range(1, 15))]


def test_a_doubled_stamp_is_mended_and_the_others_stay(place: Path) -> None:
    """Frames of two rates: the header knows but one of them, and half of the film would have the wrong times."""
    film = stamped(place / "a.mkv", [*UNEVEN[:15], UNEVEN[14], *UNEVEN[16:]])
    done = import_films([film], ALONE, place / "set")
    assert any("frame 15: stamps that do not follow" in note for note in done.notes)
    time = RecordingSet(place / "set").read(0, blank=True).time
    assert time is not None
    assert 1e3 * time == pytest.approx(np.array(UNEVEN), abs=0.6)


def test_stamps_that_are_doubled_again_and_again_are_refused_with_the_frame(place: Path) -> None:
    film = stamped(place / "a.mkv", [UNEVEN[k - (k in (9, 15, 20))] for k in range(len(UNEVEN))])
    with pytest.raises(ValueError, match=r"increase, found 3 that do not, the first in frame 9 .* give rate"):
        import_films([film], ALONE, place / "set")


def test_stamps_that_are_even_but_for_their_rounding_are_those_of_the_header(place: Path) -> None:
    """Of a fast film that a container rounds to milliseconds: some frames have the stamp of those before them."""
    film = filmed.write_film(place / "a.mkv", filmed.images(24), 1200)
    assert sum(np.diff([stamp for stamp, _ in FilmFile(film).frames()]) == 0) > 2
    done = import_films([film], ALONE, place / "set")
    assert RecordingSet(place / "set").read(0, blank=True).time is None
    assert RecordingSet(place / "set").scene.time_step == pytest.approx(1 / 1200)
    assert not any("stamps" in note for note in done.notes)


def encoded(source: Path, target: Path, *words: str, before: tuple[str, ...] = ()) -> Path:
    """Write a film anew, as ffmpeg does it."""
    exe = imageio_ffmpeg.get_ffmpeg_exe()
    subprocess.run([exe, "-loglevel", "error", *before, "-i", source, *words, target], check=True)
    return target


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("b.avi", ["-c:v", "mpeg4", "-bf", "2", "-q:v", "2"]),
        ("b.avi", ["-c:v", "libx264", "-crf", "18"]),
    ],
)
@pytest.mark.slow
def test_last_frames_without_stamps_follow_those_before_them(name: str, words: list[str], place: Path) -> None:
    """OpenCV gives zero to the frames that a decoder has kept back until the end of the film."""
    film = encoded(filmed.write_film(place / "a.mp4", filmed.images()), place / name, *words)
    assert [stamp for stamp, _ in FilmFile(film).frames()][-1] == 0
    done = import_films([film], ALONE, place / "set")
    assert any("of 24) have no stamps of their own; they are taken to follow at 30 " in one for one in done.notes)
    assert RecordingSet(place / "set").read(0, blank=True).time is None
    assert RecordingSet(place / "set").scene.time_step == pytest.approx(1 / 30)


def restamp(monkeypatch: pytest.MonkeyPatch, times: list[float]) -> None:
    """Let films have these stamps [s]."""
    true = FilmFile.frames

    def frames(film: FilmFile) -> Any:
        return ((time, image) for time, (_, image) in zip(times, true(film), strict=True))

    monkeypatch.setattr(FilmFile, "frames", frames)


@pytest.mark.slow
@pytest.mark.parametrize("end", [[UNEVEN[-2] / 1e3], [0.0], [0.0, 0.0, 0.0]])
def test_a_last_stamp_that_is_doubled_or_lacks_goes_on_as_those_before_it(
    end: list[float], place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    film = filmed.write_film(place / "a.mp4", filmed.images())
    restamp(monkeypatch, [*(one / 1e3 for one in UNEVEN[: -len(end)]), *end])
    done = import_films([film], ALONE, place / "set")
    assert any(f"the last frames ({len(end)} of 24) have no stamps" in note for note in done.notes)
    assert not any("midway" in note for note in done.notes)
    time = RecordingSet(place / "set").read(0, blank=True).time
    assert time is not None
    assert 1e3 * time == pytest.approx(np.array(UNEVEN), abs=0.1)


@pytest.mark.parametrize("end", [[0.0] * 13, [0.3], [0.0, 0.1]])
def test_stamps_that_fall_back_at_the_end_are_refused(
    end: list[float], place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    film = filmed.write_film(place / "a.mp4", filmed.images())
    restamp(monkeypatch, [*(one / 1e3 for one in UNEVEN[: -len(end)]), *end])
    with pytest.raises(ValueError, match=f"expected stamps that increase, found {len(end)} that do not"):
        import_films([film], ALONE, place / "set")


def test_a_rate_that_is_given_joins_no_frames_across_a_gap(place: Path) -> None:
    """The stamps of a film in slow motion are scaled: what is missing stays missing."""
    kept = [*range(9), *range(15, 30)]
    film = stamped(place / "a.mkv", [round(1000 * k / 30) for k in kept])
    done = import_films([film], {**ALONE, "rate": 240}, place / "set")
    assert any("do not come evenly (frame 8 is followed by none for 0.029" in note for note in done.notes)
    made = RecordingSet(place / "set")
    assert made.scene.time_step == pytest.approx(1 / 240)
    time = made.read(0, blank=True).time
    assert time is not None
    assert 240 * time == pytest.approx(np.array(kept), abs=0.05)


@pytest.mark.slow
def test_a_rate_that_is_given_holds_where_stamps_say_nothing_and_where_they_are_even(place: Path) -> None:
    films = [
        stamped(place / "a.mkv", [UNEVEN[k - (k in (9, 15, 20))] for k in range(len(UNEVEN))]),
        filmed.write_film(place / "b.mkv", filmed.images(), 600),
    ]
    done = import_films(films, {**ALONE, "rate": 60}, place / "set")
    assert [one.time for one in (RecordingSet(place / "set").read(index, blank=True) for index in (0, 1))] == [None] * 2
    said = [note for note in done.notes if "stamps" in note]
    assert len(said) == 1
    assert "a.mkv: stamps that do not increase; frames are taken to come evenly, as rate says" in said[0]


def test_a_film_that_was_trimmed_without_being_encoded_anew_is_said_with_the_remedy(place: Path) -> None:
    whole = filmed.write_film(place / "a.mp4", filmed.images(60))
    film = encoded(whole, place / "b.mp4", "-c", "copy", before=("-ss", "0.5"))
    message = r"60 frames .* found 45: .* or was trimmed without being encoded anew; .*\(ffmpeg -i IN OUT\.mp4\)"
    with pytest.raises(ValueError, match=message):
        list(FilmFile(film).frames())
    assert len(list(FilmFile(encoded(film, place / "c.mp4")).frames())) == 45


def test_a_codec_that_cannot_be_decoded_is_named(place: Path) -> None:
    """Of this codec OpenCV reads the header alone."""
    film = filmed.write_film(place / "a.mp4", filmed.images(4))
    film = encoded(film, place / "b.mp4", "-c:v", "libaom-av1", "-cpu-used", "8")
    with pytest.raises(ValueError, match=r"frames that can be decoded, found none: .* \((?i:av01)\), .* -c:v libx264"):
        list(FilmFile(film).frames())


def test_a_film_of_variable_rate_is_whole_and_one_that_is_cut_off_is_not(place: Path) -> None:
    """Without an index, a header's number of frames is the duration times the rate: 44 for these 24."""
    film = stamped(place / "a.mkv", [*(round(1000 * k / 30) for k in range(12)), *(400 + 100 * k for k in range(12))])
    assert FilmFile(film).promised > 40
    assert len(list(FilmFile(film).frames())) == 24
    whole = film.read_bytes()
    film.write_bytes(whole[: int(0.6 * len(whole))])
    with pytest.raises(ValueError, match="the film is cut off or damaged"):
        list(FilmFile(film).frames())


def test_lists_of_films_are_no_films_whatever_they_are_called(place: Path) -> None:
    filmed.write_film(place / "secret.mp4", filmed.images(4))
    for name, text in (
        ("a", "ffconcat version 1.0\nfile secret.mp4\n"),
        ("b", "\ufeff#EXTM3U\n#EXTINF:1,\nsecret.mp4\n#EXT-X-ENDLIST\n"),
    ):
        (place / f"{name}.mp4").write_text(text)
        with pytest.raises(ValueError, match=rf"{name}\.mp4: expected a film, found a list of other films"):
            open_film(place / f"{name}.mp4")
    assert open_film(place / "secret.mp4").size == (filmed.CAMERA.width, filmed.CAMERA.height)


def test_ffmpeg_itself_opens_no_list_of_films(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Formats that lead to other files are more than those whose beginnings are known here."""
    filmed.write_film(place / "secret.mp4", filmed.images(4))
    (place / "a.mp4").write_text("ffconcat version 1.0\nfile secret.mp4\n")
    monkeypatch.setattr("physid.data.importers.video.films.LISTS", (b"no such beginning",))
    with pytest.raises(ValueError, match="found a file that cannot be decoded"):
        open_film(place / "a.mp4")


def refuse_to_decode(*_: object) -> None:
    raise AssertionError("something was decoded")


def test_the_size_is_compared_before_anything_is_decoded(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    large = np.zeros((600, 800, 3), np.uint8)
    filmed.write_film(place / "a.mp4", [large] * 4)
    (place / "images").mkdir()
    for number in range(4):
        Image.fromarray(large).save(place / "images" / f"{number}.png")
    Image.fromarray(large).save(place / "empty.png")
    filmed.write_film(place / "b.mp4", filmed.images(8))
    monkeypatch.setattr(FilmFile, "frames", refuse_to_decode)
    monkeypatch.setattr(Image.Image, "load", refuse_to_decode)
    for name in ("a.mp4", "images"):
        with pytest.raises(ValueError, match="expected images of 192 x 144 as the camera file says, found 800 x 600"):
            import_films([place / name], {**ALONE, "rate": 30}, place / "set")
    with pytest.raises(ValueError, match=r"empty\.png: expected an image of 192 x 144 .* found 800 x 600"):
        pictures.read_picture(place / "empty.png", (192, 144), "as the camera file says")


@pytest.mark.parametrize("side", [9000, 20000])  # Pillow itself refuses the larger one
@pytest.mark.filterwarnings("error")
def test_pictures_larger_than_any_cameras_are_refused_by_their_header(
    side: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "images").mkdir()
    Image.new("1", (side, side)).save(tmp_path / "images" / "0.png")
    monkeypatch.setattr(Image.Image, "load", refuse_to_decode)
    with pytest.raises(ValueError, match=r"0\.png: expected images of at most 64,000,000 pixels, found"):
        ImageFolder(tmp_path / "images")


def test_a_film_larger_than_any_cameras_is_refused(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    filmed.write_film(place / "a.mp4", filmed.images(4))
    monkeypatch.setattr(pictures, "MOST_PIXELS", 20_000)
    with pytest.raises(ValueError, match=r"a\.mp4: expected images of at most 20,000 pixels, found 192 x 144"):
        open_film(place / "a.mp4")


def test_sixteen_bits_keep_their_brightness_and_thirty_two_are_refused(tmp_path: Path) -> None:
    grey = np.array([[0, 257, 25_700, 65_535]], np.uint16)
    Image.fromarray(grey).save(tmp_path / "a.png")
    read = pictures.read_picture(tmp_path / "a.png", (4, 1), "")
    assert read.shape == (1, 4, 3)
    assert read[0].tolist() == [[0] * 3, [1] * 3, [100] * 3, [255] * 3]
    Image.fromarray(grey.astype(np.float32)).save(tmp_path / "b.tif")
    with pytest.raises(ValueError, match=r"b\.tif: expected an image of 8 or 16 bits to a colour, found one of 32"):
        pictures.read_picture(tmp_path / "b.tif", (4, 1), "")


@pytest.mark.parametrize("kind", ["EPS", "GIF"])
def test_a_format_that_other_programs_draw_is_no_picture(kind: str, tmp_path: Path) -> None:
    """Pillow would begin Ghostscript for the first of them."""
    Image.new("RGB", (8, 8)).save(tmp_path / "a.png", format=kind)
    with pytest.raises(ValueError, match=r"a\.png: expected an image .* cannot be read as one"):
        pictures.read_picture(tmp_path / "a.png", (8, 8), "")


def test_a_background_that_is_no_picture_is_said_with_what_is_expected(place: Path) -> None:
    filmed.write_film(place / "a.mp4", filmed.images(8))
    (place / "log.csv").write_text("t,x\n0,1\n")
    with pytest.raises(ValueError, match=r"log\.csv: expected an image \(\.png, .* that cannot be read as one; copy"):
        import_films([place / "a.mp4"], {**ALONE, "background": "log.csv"}, place / "set")
    whole = place / "whole.png"
    Image.fromarray(filmed.images(1)[0]).save(whole)
    whole.write_bytes(whole.read_bytes()[:2000])
    with pytest.raises(ValueError, match=r"whole\.png: expected an image \(\.png, "):
        import_films([place / "a.mp4"], {**ALONE, "background": "whole.png"}, place / "set")


LENS: dict[str, Any] = {
    "image_width": 160, "image_height": 120, "camera_matrix": [150, 0, 79.5, 0, 150, 59.5, 0, 0, 1],
    "distortion_coefficients": [0, 0, 0, 0, 0], "position": [0, 0, 1], "target": [0, 0, 0], "up": [0, 1, 0],
}  # fmt: skip


def as_yaml(values: dict[str, Any]) -> str:
    """Write keys; YAML takes numbers with an exponent for numbers where they have a point."""
    return "".join(f"{key}: {value}\n" for key, value in values.items()).replace("1e", "1.0e")


def write_lens(path: Path, **changes: Any) -> Path:
    values = {key: value for key, value in {**LENS, **changes}.items() if value is not None}
    path.write_text(as_yaml(values))
    return path


AWAY: dict[str, Any] = dict.fromkeys(("position", "target", "up"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"image_width": 40000, "camera_matrix": [15e3, 0, 2e4, 0, 15e3, 60, 0, 0, 1]}, "and 32766 a side, got 40000"),
        ({"image_width": 2 * 10**9, "image_height": 2 * 10**9}, "expected an image of at most 64,000,000 pixels"),
        ({"camera_matrix": [150, 0, 79.5, 0, 150, 59.5, 0, 0, 7]}, "expected rows fx, skew, cx; 0, fy, cy; 0, 0, 1"),
        ({"camera_matrix": [150, 0, 79.5, 3, 150, 59.5, 0, 0, 1]}, "expected rows fx, skew, cx; 0, fy, cy; 0, 0, 1"),
        ({"camera_matrix": [1e300, 0, 79.5, 0, 1e300, 59.5, 0, 0, 1]}, "focal lengths from 8 to 160000 px"),
        ({"camera_matrix": [150, 0, 79.5, 0, -150, 59.5, 0, 0, 1]}, "focal lengths from 8 to 160000 px"),
        ({"camera_matrix": [0.1, 0, 79.5, 0, 0.1, 59.5, 0, 0, 1]}, "focal lengths from 8 to 160000 px"),
        ({"camera_matrix": [150, 0, 79.5, 0, 600, 59.5, 0, 0, 1]}, "whose sides differ by a factor of 2.5 at most"),
        ({"camera_matrix": [150, 90, 79.5, 0, 150, 59.5, 0, 0, 1]}, "a skew of at most 0.05 fx"),
        ({"camera_matrix": [150, 0, 179.5, 0, 150, 59.5, 0, 0, 1]}, "expected a principal point within 160 x 120"),
        ({"distortion_coefficients": [1e300, -1e300, 1e9, 1e9, 0]}, "distortion_coefficients: expected numbers within"),
        ({**AWAY, "rvec": [1e300, 0, 0], "tvec": [0, 0, 1]}, "rvec: expected radians within"),
        ({**AWAY, "rvec": [0, 0, 0], "tvec": [0, 0, 1e300]}, "expected a camera within 10000 m of the origin"),
        ({"position": [0, 0, 1e300]}, "position: expected numbers within 10000"),
        ({"position": [0, 0, 20000]}, "position: expected numbers within 10000"),
    ],
)  # fmt: skip
def test_what_no_camera_has_is_refused_with_file_and_key(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"camera\.yaml: ") as caught:
        read_camera(write_lens(tmp_path / "camera.yaml", **changes))
    assert message in str(caught.value)
    assert read_camera(write_lens(tmp_path / "camera.yaml")).ideal


@pytest.mark.parametrize("changes", [{"fov_y": 1e-300}, {"position": [0, 0, 1e300]}, {"width": 10**9}])
def test_a_camera_of_physids_own_that_nobody_has_is_refused_too(changes: dict[str, Any], tmp_path: Path) -> None:
    own = {"width": 160, "height": 120, "position": [0, 0, 1], "target": [0, 0, 0], "up": [0, 1, 0], "fov_y": 45}
    (tmp_path / "camera.yaml").write_text(as_yaml({**own, **changes}))
    with pytest.raises(ValueError, match=r"camera\.yaml: (camera_matrix: |position: |)expected"):
        read_camera(tmp_path / "camera.yaml")


def test_a_lens_is_worked_with_only_where_images_have_its_size(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    filmed.write_film(place / "a.mp4", filmed.images(8))
    write_lens(place / "camera.yaml", distortion_coefficients=[0.1, 0, 0, 0, 0])
    monkeypatch.setattr("physid.data.importers.video.lens.Lens.maps", refuse_to_decode)
    with pytest.raises(ValueError, match="expected images of 160 x 120 as the camera file says, found 192 x 144"):
        import_films([place / "a.mp4"], ALONE, place / "set")


def test_a_camera_below_the_ground_is_refused_however_its_place_is_given(place: Path) -> None:
    filmed.write_film(place / "a.mp4", filmed.images(8))
    below = {"position": [0, 0, -1], "image_width": 192, "image_height": 144}
    write_lens(place / "camera.yaml", **below)
    with pytest.raises(ValueError, match=r"camera\.yaml: expected a camera above the ground, found one 1 m below it"):
        import_films([place / "a.mp4"], ALONE, place / "set")


def board(folder: Path, focal: float = 400.0) -> Path:
    """Film a checkerboard of 7 x 5 inner corners in front of a pinhole camera."""
    folder.mkdir()
    side, square = 30, 0.02
    flat = np.full((8 * side, 10 * side), 255, np.uint8)
    for row in range(6):
        for column in range(8):
            if (row + column) % 2 == 0:
                flat[(row + 1) * side : (row + 2) * side, (column + 1) * side : (column + 2) * side] = 0
    matrix = np.array([[focal, 0, 160], [0, focal, 120], [0, 0, 1.0]])
    metres = np.array([[square / side, 0, -5 * square], [0, square / side, -4 * square], [0, 0, 0], [0, 0, 1]])
    generator = np.random.default_rng(0)
    for number in range(10):
        turn = cv2.Rodrigues(generator.uniform(-0.5, 0.5, 3))[0]
        seen = matrix @ np.c_[turn, [0, 0, 0.4]] @ metres
        image = cv2.warpPerspective(flat, seen, (320, 240), borderValue=200, flags=cv2.INTER_AREA)
        Image.fromarray(image).save(folder / f"{number}.png")
    return folder


POINTS = [[83, 201, 0, 0], [259, 186, 0.6, 0], [223, 97, 0.6, 0.4], [102, 111, 0, 0.4]]


def test_a_lens_that_is_measured_anew_keeps_the_place_of_the_camera(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["calibrate", str(board(place / "board")), "--corners", "7x5", "--square", "0.02", "--out", "lens.yaml"]
    assert main(words) == 0
    with (place / "lens.yaml").open("a") as file:  # as the command says
        file.write("position: [0.1, 0, 1.5]\ntarget: [0, 0, 0]\nup: [0, 1, 0]\n")
    before = read_camera(place / "lens.yaml")
    assert main(words) == 0
    assert "the place of the camera is kept (position, target, up)" in capsys.readouterr().out
    after = read_camera(place / "lens.yaml")
    assert np.array_equal(after.position, before.position)
    assert after.matrix == pytest.approx(before.matrix, rel=1e-3)
    written = (place / "lens.yaml").read_bytes()
    assert main([*words, "--ground", str(POINTS)]) == 2
    said = capsys.readouterr().err
    assert "holds another place of the camera (position, target, up), which would be lost" in said
    assert "delete lens.yaml to replace it" in said
    assert (place / "lens.yaml").read_bytes() == written


def test_a_file_that_is_no_camera_file_is_not_replaced_by_one(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (place / "recording.yaml").write_text("scene: push\n")
    assert main(["calibrate", str(place), "--out", "recording.yaml"]) == 2
    assert 'recording.yaml: unknown key "scene"' in capsys.readouterr().err
    assert (place / "recording.yaml").read_text() == "scene: push\n"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--square", "1e308"], "square must be a number of at most 10, got 1e+308"),
        (["--square", "0"], "square must be a number of at least 0.0001, got 0"),
        (["--corners", "100000x100000"], "corners: expected two numbers from 3 to 100"),
        (["--corners", "9x2"], "corners: expected two numbers from 3 to 100"),
        (["--ground", "[[1, 2, 3, 4]]"], "--ground: points: expected 4 or more rows"),
        (["--ground", "[[1, 2"], "--ground"),
    ],
)
def test_what_is_asked_of_a_calibration_is_checked_before_the_film_is_opened(
    words: list[str], message: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["calibrate", "no_such_film.mp4", *words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("place", ["points", "position", "none"])
@pytest.mark.parametrize("lens", ["ours", "opencv", "flow"])
def test_a_lens_that_is_measured_anew_keeps_comments_and_place(tmp_path: Path, lens: str, place: str) -> None:
    """However the earlier file is written, the new one holds the new lens and the place; of keys in lines, verbatim."""
    points = (
        "# by the tape\npoints:\n- [83, 401, 0, 0]  # corner\n- [559, 386, 0.6, 0]\n# beyond\n- [523, 97, 0.6, 0.4]\n"
    )
    said = {
        "points": points,
        "position": "position: [0, 0, 1]  # of the stand\ntarget: [0, 0, 0]\nup:\n    [0, 1, 0]\n",
        "none": "# no place yet\n",
    }[place]
    known = yaml.safe_load(said) or {}
    before = {
        "ours": f"# phone, 1x\n\nimage_width: 1  # old\n{said}\nimage_height: 1\nD: [0, 0, 0, 0]\n# at the end\n",
        "opencv": f"%YAML:1.0\n---\n# phone\nimage_width: 1\ncamera_matrix: !!opencv-matrix\n   rows: 3\n{said}",
        "flow": str({"image_width": 1, **known}),
    }[lens]
    (tmp_path / "camera.yaml").write_text(before)
    made = Calibrated(640, 480, np.diag([500.0, 500.0, 1.0]), np.zeros(5), 0.1, 9, known)
    made.write(tmp_path / "camera.yaml")
    text = (tmp_path / "camera.yaml").read_text()
    made.write(tmp_path / "new.yaml")
    assert yaml.safe_load(text) == yaml.safe_load((tmp_path / "new.yaml").read_text())
    assert {name: yaml.safe_load(text)[name] for name in known} == known
    if lens != "flow":
        assert said in text
        assert all(line in text for line in before.splitlines() if line.startswith("#"))
