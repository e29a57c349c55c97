"""The page in a real browser: Debian's Chromium, driven by Playwright."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dashboard.folders import DIAGNOSIS, write_runs
from physid.dashboard.page import write_dashboard

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
PLAYED = 0.2  # [s] of a film
PATIENCE = 60.0  # [s] of a busy machine
WATCH = """async (film, [played, patience]) => {
  for (const end = Date.now() + 1000 * patience; film.currentTime <= played && Date.now() < end;)
    await new Promise(resolve => setTimeout(resolve, 50));
  return film.currentTime;
}"""
PHONE = {"width": 390, "height": 844}
try:
    from playwright.sync_api import Browser, Page, expect, sync_playwright
except ImportError:
    CHROMIUM = None

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium and Playwright: apt-get install chromium"),
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield started
        started.close()


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    root = write_runs(tmp_path_factory.mktemp("page") / "runs")
    write_dashboard(root, root / "dashboard.html")
    return (root / "dashboard.html").as_uri()


def open_page(browser: Browser, address: str, **options: Any) -> tuple[Page, list[str]]:
    """Open the page; returns it with a list that collects console errors and requests to the outside."""
    page = browser.new_context(**options).new_page()
    trouble: list[str] = []
    page.on("console", lambda message: trouble.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.on("request", lambda each: None if each.url.startswith(("file:", "data:")) else trouble.append(each.url))
    page.goto(address)
    return page, trouble


def names(page: Page) -> list[str]:
    """Return the names of the runs in the table, from top to bottom."""
    return page.locator(".runs tr:not([hidden]) .name").all_inner_texts()


@pytest.fixture
def page(browser: Browser, address: str) -> Iterator[Page]:
    opened, trouble = open_page(browser, address, color_scheme="light")
    yield opened
    opened.context.close()
    assert not trouble


def test_the_table_sorts_by_number_in_both_directions_with_empty_cells_last(page: Page) -> None:
    page.get_by_role("button", name="Time", exact=True).click()
    assert names(page)[:2] == ["push_good", "push_bad"]
    page.get_by_role("button", name="Time", exact=True).click()
    assert names(page)[:2] == ["push_bad", "push_good"]
    assert page.get_by_role("columnheader", name="Time").get_attribute("aria-sort") == "descending"


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ("error<1%", {"push_good"}),
        ("seconds>10", {"push_bad"}),
        ("friction>0.15 sysid", {"push_bad"}),
        ("drag", {"diagnosis"}),
        ("accuracy", {"score"}),
        ("segment: 60", {"push_bad"}),
        ("no such run", set()),
    ],
)
def test_words_and_comparisons_filter_the_table(page: Page, query: str, expected: set[str]) -> None:
    page.get_by_label("filter runs").fill(query)
    assert set(names(page)) == expected


def test_a_kind_filters_the_table_until_it_is_pressed_again(page: Page) -> None:
    page.get_by_role("button", name="fit", exact=False).first.click()
    assert set(names(page)) == {"push_good", "push_bad", "damaged"}
    page.get_by_role("button", name="fit", exact=False).first.click()
    assert len(names(page)) == 9


def test_a_fit_shows_the_parameter_beside_the_truth_its_curves_and_a_film_that_plays_by_itself(page: Page) -> None:
    page.get_by_role("link", name="push_good").first.click()
    expect(page.locator(".run:not([hidden])").get_by_text("true 0.12")).to_be_visible()
    expect(page.locator(".run:not([hidden])").get_by_text("0.1191 to 0.1211")).to_be_visible()
    shown = page.locator(".run:not([hidden])")
    drawing = shown.get_by_role("img", name="block.friction over the fit")
    assert drawing.locator("[style*='var(--truth)']").count() == 1
    assert drawing.locator("[style*='var(--after)']").count() > 1
    titles = shown.locator("figcaption h3").all_inner_texts()
    assert {"train/loss", "blur/sigma", "lr-Adam"} <= set(titles)
    assert shown.locator("video").evaluate(WATCH, [PLAYED, PATIENCE]) > PLAYED


def test_a_diagnosis_says_its_verdict_in_a_sentence_and_opens_its_report(page: Page) -> None:
    page.get_by_role("link", name="diagnosis", exact=True).click()
    shown = page.locator(".run:not([hidden])")
    expect(shown.locator(".verdict")).to_contain_text(
        "The gap is accounted for by one of viscous drag or quadratic drag"
    )
    expect(shown.get_by_text("21 mm → 1.6 mm, 99 % closed")).to_be_visible()
    expect(shown.locator(".note")).to_contain_text("Predictive only")
    shown.get_by_text("Full report").click()
    report = shown.frame_locator("iframe")
    expect(report.get_by_role("heading", name="The report")).to_be_visible()
    expect(report.locator("body")).to_have_css("background-color", "rgb(255, 255, 255)")
    shown.get_by_role("button", name="light or dark").click()
    expect(report.locator("body")).to_have_css("background-color", "rgb(0, 0, 0)")


def test_a_benchmark_stands_beside_the_paper_and_its_targets(page: Page) -> None:
    page.get_by_role("link", name="reproduce", exact=True).click()
    shown = page.locator(".run:not([hidden])")
    expect(shown.locator(".mark")).to_have_text(["met", "missed"])
    expect(shown.locator("tr.cell")).to_have_text(["push", "collide"])


def test_an_observation_says_what_is_known_of_each_parameter(page: Page) -> None:
    page.get_by_role("link", name="identifiability").click()
    expect(page.get_by_role("row", name="block.mass 2 %")).to_contain_text("identified")
    expect(page.get_by_role("row", name="block.friction 6 %")).to_contain_text(
        "block.mass * block.friction^0.38, to 0.15 %"
    )


def test_chosen_runs_are_compared_in_figures_curves_and_settings(page: Page) -> None:
    for name in ("push_good", "push_bad"):
        page.get_by_label(f"choose {name}").check()
    page.get_by_role("button", name="Compare").click()
    expect(page.get_by_role("heading", name="Comparison of 2 runs")).to_be_visible()
    loss = page.locator("#compare figure", has=page.get_by_text("train/loss"))
    assert sorted(each.is_visible() for each in loss.locator(".line").all()) == [True, True]
    row = page.get_by_role("row", name="block.friction, relative error")
    assert row.locator(".best").all_inner_texts() == ["0.083 %"]
    row = page.get_by_role("row", name="model.segment")
    assert row.locator("td:visible").all_inner_texts() == ["model.segment", "60", "30"]


def test_diagnoses_are_compared_line_by_line(page: Page) -> None:
    for name in ("diagnosis", "diagnosis_free"):
        page.get_by_label(f"choose {name}", exact=True).check()
    page.get_by_role("button", name="Compare").click()
    assert page.get_by_role("row", name="Verdict").locator("td:visible").all_inner_texts() == [
        "Verdict",
        "group",
        "none",
    ]
    expect(page.get_by_role("row", name="Effects")).to_contain_text(
        "viscous drag, coefficient: 0.210 (0.191 to 0.230) N s/m"
    )


def test_reproductions_are_compared_beside_paper_and_target(page: Page) -> None:
    for name in ("reproduce", "reproduce_again"):
        page.get_by_label(f"choose {name}", exact=True).check()
    page.get_by_role("button", name="Compare").click()
    row = page.get_by_role("row", name="push: relative error")
    assert row.locator("td:visible").all_inner_texts() == ["push: relative error", "1e-5", "0.005", "0.02", "0.001"]


def test_figures_that_one_run_alone_has_are_not_compared(page: Page) -> None:
    for name in ("reproduce", "push_good"):
        page.get_by_label(f"choose {name}", exact=True).check()
    page.get_by_role("button", name="Compare").click()
    expect(page.get_by_role("heading", name="Comparison of 2 runs")).to_be_visible()
    expect(page.locator("#compare").get_by_role("heading", name="Results")).to_be_hidden()


def test_a_scored_bank_shows_its_figures_beside_what_is_asked(page: Page) -> None:
    page.get_by_role("link", name="score").click()
    shown = page.locator(".run:not([hidden])")
    marks = shown.locator("section", has=page.get_by_role("heading", name="Figures")).locator("tbody td:last-child")
    expect(marks).to_have_text(["good", "as wanted", "missed", ""])
    expect(page.get_by_role("heading", name="By role")).to_be_visible()
    assert page.get_by_role("heading", name="Empty").count() == 0


def test_a_damaged_file_is_named(page: Page) -> None:
    page.get_by_role("link", name="damaged").click()
    expect(page.locator(".run:not([hidden]) .note")).to_contain_text("metrics.json cannot be read")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_phone_nothing_sticks_out_in_light_and_dark(browser: Browser, address: str, scheme: Any) -> None:
    page, trouble = open_page(browser, address, viewport=PHONE, color_scheme=scheme, has_touch=True)
    brightness = {}
    for view in (
        "#/",
        "#/run/push_good",
        "#/run/diagnosis",
        "#/run/reproduce",
        "#/run/score",
        "#/compare/push_good,push_bad",
        "#/compare/diagnosis,diagnosis_free",
    ):
        page.goto(address + view)
        page.wait_for_timeout(100)
        assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"], view
        color = page.evaluate("getComputedStyle(document.body).backgroundColor")
        brightness[view] = sum(int(part) for part in color.removeprefix("rgb(").removesuffix(")").split(","))
    assert all((value > 600) == (scheme == "light") for value in brightness.values())
    page.get_by_role("button", name="light or dark").click()
    assert page.evaluate("document.documentElement.style.colorScheme") != scheme
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") != color
    page.context.close()
    assert not trouble


def test_what_a_run_smuggles_in_is_not_run(browser: Browser, tmp_path: Path) -> None:
    hostile = "<img src=x onerror=\"document.title='run'\"></script><script>document.title='run'</script>"
    folder = tmp_path / "diagnosis"
    folder.mkdir()
    (folder / "diagnosis.json").write_text(json.dumps(DIAGNOSIS | {"next_experiment": hostile}))
    (folder / "report.html").write_text(f"<h1>The report</h1>{hostile}<script>parent.document.title='run'</script>")
    (folder / "config.yaml").write_text(json.dumps({"name": hostile, hostile: hostile}))
    write_dashboard(tmp_path, tmp_path / "page.html")
    page = browser.new_page()
    page.goto((tmp_path / "page.html").as_uri())
    page.get_by_role("link", name="diagnosis", exact=True).click()
    page.get_by_text("Full report").click()
    expect(page.frame_locator("iframe").get_by_role("heading", name="The report")).to_be_visible()
    assert "run" not in page.title().split()
    page.close()
