"""The report: everything is on the page, nothing comes from outside, and it fits a phone."""

from __future__ import annotations

import html
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.documents import diagnosis, said
from physid.diagnosis.document.document import VERDICTS, check_diagnosis
from physid.diagnosis.document.residual_sentences import residual_sentences
from physid.diagnosis.document.sentences import verdict_sentence
from physid.diagnosis.report import page as report_page
from physid.diagnosis.report.contents import Overlay
from physid.diagnosis.report.page import Curve, ReportData, TimeMap, render, write_report
from physid.pages.figures import HIGH, Series, line_chart
from physid.pages.templates import ICON

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
PHONE = {"width": 390, "height": 844}
VOID = {"meta", "br", "link", "img"}
TIME = np.linspace(0, 1.25, 300)


def pictures(folder: Path | None = None) -> ReportData:
    """Return everything that a report can draw."""
    overlay = None
    if folder is not None:
        (folder / "film.mp4").write_bytes(b"a film")
        overlay = Overlay("trajectory 3", ("nominal model",), 1, (), folder / "film.mp4")
    return ReportData(
        title="push_07",
        curves=(Curve("same", TIME, 0.001 + 0.03 * TIME**2, 0.001 + 0 * TIME),),
        time_map=TimeMap((("block", "x"), ("block", "rz")), np.linspace(0, 1.25, 4), np.array([[1, 2, 9], [0, 0, 1]])),
        levels={"sensor": 0.0012, "numerical": 0.0004},
        residual_wrench={"same": 0.0015},
        threshold=24.0,
        replicates=199,
        formulas={"viscous_drag": "F = -c v at the centre of each body."},
        next_config="scene: push\n",
        overlay=overlay,
        facts={"recordings": "24 x 300 frames"},
    )


class Outline(HTMLParser):
    """Checks that elements are closed in the order in which they are opened, and collects addresses."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href", "poster", "data")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in VOID or "svg" in self.open, f"<{tag}/> does not close itself in HTML"

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def text_of(page: str) -> str:
    """Return what a person reads."""
    body = page[page.index("<body>") :]
    return html.unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", body)))


@pytest.mark.parametrize("drawn", [True, False])
@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_page_is_well_formed_and_opens_with_the_verdict(verdict: str, drawn: bool) -> None:
    document = diagnosis(verdict)
    page = render(check_diagnosis(document), pictures() if drawn else ReportData())
    outline = Outline()
    outline.feed(page)
    assert not outline.open
    assert text_of(page).index(verdict_sentence(check_diagnosis(document))) < text_of(page).index("Where")
    assert f"<h1>{verdict_sentence(check_diagnosis(document))}</h1>" in page
    assert "nan" not in page.lower().split("<body>")[1].replace("candidate", "")


def test_the_page_lies_beside_the_document_and_asks_for_nothing_from_outside(tmp_path: Path) -> None:
    path = write_report(tmp_path / "out", said(), pictures(tmp_path))
    assert path == tmp_path / "out" / "report.html"
    page = path.read_text(encoding="utf-8")
    outline = Outline()
    outline.feed(page)
    outside = [address for address in outline.addresses if not address.startswith(("#", "data:"))]
    assert not outside
    assert sum(address.startswith("data:video/mp4;base64,") for address in outline.addresses) == 1
    assert set(re.findall(r"url\((.)", page)) <= {"#"}
    assert "http:" not in page.replace(ICON, "")
    assert "<script" not in page


def test_everything_that_was_found_is_on_the_page() -> None:
    causes = {"viscous_drag": 0.62, "quadratic_drag": 0.33, "other": 0.03, "none": 0.02}
    document = check_diagnosis(diagnosis("group") | {"excess": 450.0, "null_simulations": 199, "causes": causes})
    text = text_of(render(document, pictures()))
    for expected in (
        "confidence 97 %",
        "viscous drag 62 %", "quadratic drag 33 %", "2 others share the rest",
        "11", "coast", "slide fast",
        "0.210 N s/m", "0.190 to 0.230 N s/m",
        "F = -c v at the centre of each body.",
        "cannot tell viscous drag from quadratic drag",
        "< 0.005", "explains 28 % of the gap", "199 null simulations",
        "Sensor", "1.2 mm", "Numerics", "0.4 mm",
        "0.995 to 1.009",
        "Push at speeds from 0.2 to 2 m/s", "scene: push",
        "24 x 300 frames",
    ):  # fmt: skip
        assert re.sub(r"\s", "", expected) in re.sub(r"\s", "", text), expected


def test_intervals_have_the_probability_that_the_diagnosis_was_asked_for() -> None:
    assert "90 % interval" in text_of(render(said(), pictures()))
    document = diagnosis()
    document["settings"] = {**document.get("settings", {}), "hypothesis": {"confidence": 0.5}}
    text = text_of(render(check_diagnosis(document), pictures()))
    assert "50 % interval" in text
    assert "90 % interval" not in text


@pytest.mark.parametrize("verdict", ["unknown", "named"])
def test_what_candidates_explain_of_an_unknown_gap_is_called_no_cause(verdict: str) -> None:
    document = check_diagnosis(diagnosis(verdict) | {"excess": 450.0})
    text = text_of(render(document, pictures()))
    assert ("None predicts trajectories that it was not fitted to" in text) is (verdict == "unknown")
    assert "In null simulations, which have no effect, a candidate seldom explains more than" in text
    assert "than <" not in text


def test_without_a_transfer_set_the_page_says_so_at_the_top() -> None:
    page = render(said(transfer=False), ReportData())
    assert "Predictive only, cause not certified" in text_of(page[: page.index("</header>")])


def test_a_gap_that_reference_simulators_leave_as_well_is_not_shown_as_nothing() -> None:
    document = diagnosis("none")
    document["gap"]["same"]["before"] = 0.0621
    text = text_of(render(check_diagnosis(document), ReportData()))
    assert "Not closed" in text
    for nothing in ("Nothing to close", "Nowhere"):
        assert nothing not in text


def test_a_verdict_of_no_gap_shows_no_effect_and_no_share() -> None:
    text = text_of(render(said("none"), ReportData()))
    assert "Nothing to close" in text
    assert "Share of the gap that closes" not in text
    assert "With the effect" not in text


def test_a_name_cannot_become_markup() -> None:
    document = diagnosis()
    document["where"]["cells"][0]["body"] = "<img src=x>"
    page = render(check_diagnosis(document), ReportData(title='"><script>', facts={"a": "<b>"}))
    assert "<img" not in page
    assert "<script" not in page


def test_the_strongest_cell_is_marked_and_colours_follow_the_evidence() -> None:
    page = render(said(), ReportData())
    cells = dict(re.findall(r'title="([a-z ]+, [a-z]+): [^"]*"[^>]*>([^<]*)</td>', page))
    assert cells["coast, x"] == "11"
    assert re.search(r'class="strongest full" style="--heat: 100%" title="coast, x', page)
    assert re.search(r'style="--heat: 4%" title="slide fast, rz', page)
    assert cells["coast, rz"] == ""


def test_a_film_that_no_page_can_carry_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report_page, "MOST_BYTES", 3)
    with pytest.raises(ValueError, match=r"film\.mp4: expected a film of at most"):
        write_report(tmp_path / "out", said(), pictures(tmp_path))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Curve("rest", TIME, TIME), "Curve.split"),
        (lambda: Curve("same", TIME, TIME[1:]), "Curve.before"),
        (lambda: Curve("same", TIME, TIME, TIME * np.nan), "Curve.after"),
        (lambda: TimeMap((("block", "x"),), np.arange(3.0), np.zeros((2, 2))), "TimeMap.evidence"),
        (lambda: ReportData(levels={"noise": 1.0}), "ReportData.levels"),
    ],
)
def test_pictures_check_themselves(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium and Playwright: apt-get install chromium")
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_phone_nothing_sticks_out_in_light_and_dark(tmp_path: Path, scheme: Any) -> None:
    playwright = pytest.importorskip("playwright.sync_api")
    document = diagnosis("group")
    document["where"]["cells"] = [
        {"phase": phase, "body": body, "dof": dof, "evidence": 3.0}
        for phase in ("impact", "contact_between_objects", "free_fall")
        for body in ("left block", "right block")
        for dof in ("x", "y", "z", "rx", "ry", "rz")
    ]
    path = write_report(tmp_path, check_diagnosis(document), pictures())
    trouble: list[str] = []
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_context(viewport=PHONE, color_scheme=scheme).new_page()
        page.on("console", lambda message: trouble.append(message.text))
        page.on("request", lambda each: trouble.append(each.url) if not each.url.startswith("file:") else None)
        page.goto(path.as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
        color = page.evaluate("getComputedStyle(document.body).backgroundColor")
        browser.close()
    assert not trouble
    assert (sum(int(part) for part in re.findall(r"\d+", color)) > 600) == (scheme == "light")


def test_what_is_missing_is_said_drawn_and_cut_out_of_the_gap() -> None:
    """A force has a curve, a shift has none; both are parts of the gap on held-out trajectories of one protocol."""
    page = render(said("unknown"), pictures())
    text = text_of(page)
    assert "What is missing" in text
    for sentence in residual_sentences(said("unknown").residual):
        assert sentence in text
    assert page.count("Size over speed") == 1
    assert "Size over time" not in page
    for part in ("a force across the velocity 83 %", "a shift of the picture along x 12 %", "not explained 5 %"):
        assert text.count(part) == 1
    assert "What is missing" not in text_of(render(said("named"), pictures()))


def test_without_a_law_a_free_wrench_says_what_a_better_model_could_close() -> None:
    text = text_of(render(replace(said("unknown"), residual=()), pictures()))
    assert "a free force and torque" in text


@pytest.mark.parametrize("least", [0.5, 4.0])
def test_a_floor_is_drawn_within_the_axes_though_all_errors_exceed_it(least: float) -> None:
    lines = [Series("nominal", "before", [0, 1], [5.0, 200.0]), Series("with", "after", [0, 1], [least, 4.0])]
    drawn = line_chart(lines, "errors", "time [s]", floor=1.0, logarithmic=True, top=240)
    (height,) = re.findall(r'd="M [\d.]+ ([\d.]+) [^"]*"[^>]*dasharray[^>]*--floor', drawn)
    (whole,) = map(float, re.findall(r'viewBox="0 0 [\d.]+ ([\d.]+)"', drawn))
    assert float(height) < whole * (1 - 0.5 / HIGH), "below are numbers and the name of the axis"
