"""The page that draws a set needs nothing but itself, and draws what was recorded."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.data.sets import SCENE, recording, write_set

from physid.cli import main
from physid.data import Recording, RecordingSet
from physid.inspection.page import MOST_FRAMES, SQUARES, write_page
from physid.pages.templates import ICON

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


def drawn(path: Path) -> dict:  # type: ignore[type-arg]
    """Return what the page draws."""
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', path.read_text(), re.DOTALL)
    assert found
    return dict(json.loads(found[1]))


def test_it_holds_poses_gaps_and_forces(tmp_path: Path) -> None:
    one = recording(8)
    assert one.pose is not None
    pose = one.pose.copy()
    pose[3] = np.nan
    folder = write_set(tmp_path / "set", [dataclasses.replace(one, pose=pose, twist=None), recording(1000, 1)])
    assert main(["show", str(folder), "--out", str(tmp_path / "page.html")]) == 0
    assert main(["show", str(folder), "--out", str(tmp_path / "page.mp4")]) == 2
    assert not (tmp_path / "page.mp4").exists(), "a page is no film"
    data = drawn(tmp_path / "page.html")
    first, long = data["trajectories"]
    assert first["pose"][3] == [None]
    assert np.allclose(first["pose"][4], pose[4], atol=1e-5)
    assert one.wrench is not None
    assert np.allclose(np.array(first["force"])[:-1], one.wrench[:-1, :, 3:], atol=1e-5)
    assert len(long["time"]) == MOST_FRAMES


def test_names_cannot_break_out_of_the_page_and_nothing_is_loaded(tmp_path: Path) -> None:
    scene = dataclasses.replace(SCENE, name="</script><script>alert(1)</script>")
    write_page(RecordingSet(write_set(tmp_path / "set", [recording()], scene)), [0], tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert text.count("</script>") == 2
    assert "http" not in text.replace("http-equiv", "").replace(ICON, "")
    assert "script-src 'sha256-" in text
    assert "default-src 'none'" in text


def test_the_view_fits_each_trajectory_and_squares_are_round(tmp_path: Path) -> None:
    far = recording(8, 1)
    assert far.pose is not None
    pose = far.pose.copy()
    pose[..., 0] += 300.0
    pose[4:, :, 0] += 30.0
    folder = write_set(tmp_path / "set", [recording(8), dataclasses.replace(far, pose=pose, twist=None)])
    write_page(RecordingSet(folder), [0, 1], tmp_path / "page.html")
    near, wide = drawn(tmp_path / "page.html")["trajectories"]
    for view, one in zip((near, wide), RecordingSet(folder), strict=True):
        assert one.pose is not None
        reach = np.abs(one.pose[..., :3] - view["middle"]).max()
        assert reach < view["extent"] / 2, "all of it is in view"
        assert view["extent"] < 2.4 * (reach + SCENE.sizes.max()), "and fills it"
        assert f"{view['square']:e}"[0] in "125"
        assert SQUARES / 2.5 <= view["extent"] / 1.2 / view["square"] <= 2.6 * SQUARES
    assert wide["square"] > 10 * near["square"]


@pytest.mark.parametrize(("height", "near"), [(0.5, True), (50.0, False)])
def test_the_ground_is_in_view_where_it_is_near(tmp_path: Path, height: float, near: bool) -> None:
    one = recording(8)
    assert one.pose is not None
    pose = one.pose.copy()
    pose[..., 2] += height
    pose[-1, :, 0] += 1.0
    folder = write_set(tmp_path / "set", [dataclasses.replace(one, pose=pose, twist=None)])
    write_page(RecordingSet(folder), [0], tmp_path / "page.html")
    (view,) = drawn(tmp_path / "page.html")["trajectories"]
    assert (view["middle"][2] - view["extent"] / 2 <= SCENE.ground.offset) == near


def test_films_without_poses_cannot_be_drawn(tmp_path: Path) -> None:
    one = recording(video=True)
    film = Recording(frames=one.frames, mask=one.mask, background=one.background)
    with pytest.raises(ValueError, match="expected trajectories with poses to draw, found none; see physid track"):
        write_page(RecordingSet(write_set(tmp_path / "set", [film])), [0], tmp_path / "page.html")


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium and Playwright: apt-get install chromium")
def test_it_plays_and_turns_without_an_error(tmp_path: Path) -> None:
    playwright = pytest.importorskip("playwright.sync_api")
    write_page(
        RecordingSet(write_set(tmp_path / "set", [recording(), recording(20, 1)])), [0, 1], tmp_path / "page.html"
    )
    trouble: list[str] = []
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        page.on("console", lambda message: trouble.append(message.text))
        page.on("pageerror", lambda error: trouble.append(str(error)))
        page.goto((tmp_path / "page.html").as_uri())
        page.select_option("#which", "1")
        page.locator("#frame").fill("7")
        assert "frame 7" in page.locator("#said").inner_text()
        assert "mm over the ground" in page.locator("#said").inner_text()
        assert "a square of the ground is 0." in page.locator("#grid").inner_text()
        page.mouse.move(300, 300)
        page.mouse.down()
        page.mouse.move(350, 320)
        page.mouse.up()
        page.locator("#play").click()
        page.wait_for_timeout(200)
        browser.close()
    assert not trouble
