"""The report of a diagnosis: one HTML page for a person that needs nothing from outside."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

from physid.data.files import write_text
from physid.diagnosis.document.document import FILE, Diagnosis, Split
from physid.diagnosis.document.sentences import (
    capital,
    caveat,
    closed,
    how_far_sentence,
    join,
    percent,
    verdict_sentence,
    where_sentence,
    words,
)
from physid.diagnosis.report.contents import Curve, Film, ReportData, TimeMap
from physid.diagnosis.report.curves import error_curves, error_levels, shares
from physid.diagnosis.report.elements import Content, Markup, badge, element, section
from physid.diagnosis.report.evidence_map import evidence_map, site_bar, site_name, time_map
from physid.diagnosis.report.films import film_cards
from physid.diagnosis.report.style import STYLE
from physid.diagnosis.report.tables import effects, group, parameters, ranking

__all__ = ["Curve", "Film", "ReportData", "TimeMap", "render", "write_report"]

REPORT = "report.html"
MOST_LISTED = 2  # further members of a group that the answers name
KINDS = {"none": "good", "named": "", "group": "warn", "partial": "warn", "unknown": "bad"}
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; media-src data:"


def write_report(folder: Path, diagnosis: Diagnosis, pictures: ReportData) -> Path:
    """Write the report of a diagnosis.

    Args:
        folder: Output folder of the diagnosis; made if it is not there.
        diagnosis: The document.
        pictures: What is drawn beside it.

    Returns:
        The page, report.html in the folder.

    Raises:
        ValueError: If the document is not valid, or a film is too large to be carried by a page.
    """
    path = folder / REPORT
    write_text(path, render(diagnosis, pictures))
    return path


def render(diagnosis: Diagnosis, pictures: ReportData) -> str:
    """Return the page as one HTML document."""
    title = f"Diagnosis of {pictures.title}" if pictures.title else "Diagnosis"
    head = [
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("meta", http_equiv="Content-Security-Policy", content=POLICY),
        element("title", f"{title} · physid"),
        element("style", Markup(STYLE)),
    ]
    body = [
        _verdict(diagnosis, title),
        _answers(diagnosis),
        _where(diagnosis, pictures),
        _which(diagnosis, pictures),
        _how_far(diagnosis, pictures),
        _next(diagnosis, pictures),
        section("Recording and model", "", *_rows(*film_cards(pictures))),
        _small_print(pictures),
    ]
    page = element("html", element("head", head), element("body", element("main", body)), lang="en")
    return f"<!doctype html>\n{page}\n"


def _verdict(diagnosis: Diagnosis, title: str) -> Markup:
    """Say the verdict, how sure it is, and what it does not mean."""
    warning = caveat(diagnosis)
    confidence = diagnosis.confidence
    meter = element("span", element("i", style=f"width: {100 * confidence:.1f}%"), class_="meter")
    return element(
        "header",
        element("p", title, class_="soft small"),
        element("h1", verdict_sentence(diagnosis)),
        element(
            "p",
            badge(diagnosis.verdict, KINDS[diagnosis.verdict]),
            element("span", "confidence ", element("b", percent(confidence)), class_="number"),
            meter,
            class_="sure",
        ),
        element("p", warning, class_="note") if warning else None,
        class_=f"card verdict {KINDS[diagnosis.verdict]}".strip(),
    )


def _answers(diagnosis: Diagnosis) -> Markup:
    """Give the three answers in a few words each."""
    blamed = [words(effect.name) for effect in diagnosis.effects]
    others = len(diagnosis.group) - len(blamed) if blamed else 0
    nobody = "No effect" if diagnosis.verdict == "none" else "No known effect"
    which, more = capital(join(blamed, "and")) or nobody, ""
    if others and len(blamed) == 1 and others <= MOST_LISTED:
        which, more = capital(join(map(words, diagnosis.group), "or")), "these recordings cannot tell which"
    elif others:
        more = f"cannot be told from {others} other{'s' * (others > 1)}"
    split: Split = "transfer" if diagnosis.gap.transfer else "same"
    tiles = (
        ("Where", site_name(diagnosis), where_sentence(diagnosis)),
        ("Which", which, more or _best(diagnosis)),
        ("How far", _far(diagnosis, split), how_far_sentence(diagnosis, split)),
    )
    made = [
        element(
            "div",
            element("h3", name, class_="soft"),
            element("p", large, class_="big"),
            element("p", capital(small).replace("->", "→"), class_="small soft"),
            class_="card",
        )
        for name, large, small in tiles
    ]
    return element("div", made, class_="grid answers")


def _far(diagnosis: Diagnosis, split: Split) -> str:
    """Say in two words how far the gap closes."""
    share = diagnosis.share(split)
    if share is not None:
        return f"{closed(share)[0]} closed"
    error = diagnosis.errors(split)
    if error is not None and error.after is not None:
        return "Near the floor"
    return "Nothing to close" if diagnosis.verdict == "none" else "Not closed"


def _best(diagnosis: Diagnosis) -> str:
    """Say how the effects stand out from what chance brings."""
    best = diagnosis.ranking[:1]
    if not best:
        return "no candidate stands out"
    name = "stands out with" if diagnosis.effects else f"best candidate: {' + '.join(map(words, best[0].effects))},"
    return f"{name} p = {best[0].p_value:.2g}"


def _where(diagnosis: Diagnosis, pictures: ReportData) -> Markup | None:
    where = diagnosis.where
    # Evidence of nothing would fill the map with colours all the same.
    over_time = None if diagnosis.verdict == "none" else time_map(pictures.time_map)
    cards = (site_bar(where.site), evidence_map(where.cells), over_time)
    return section("Where", "In which part of the motion the prediction leaves the recording.", *_rows(*cards))


def _which(diagnosis: Diagnosis, pictures: ReportData) -> Markup | None:
    cards = (*effects(diagnosis, pictures), group(diagnosis), ranking(diagnosis, pictures))
    return section("Which", "What each candidate explains beyond the refitted nominal model.", *_rows(*cards))


def _how_far(diagnosis: Diagnosis, pictures: ReportData) -> Markup | None:
    cards = (
        error_curves(pictures.curves, diagnosis.gap),
        error_levels(diagnosis, pictures),
        shares(diagnosis, pictures),
        parameters(diagnosis, pictures),
    )
    return section("How far", "Errors on trajectories that took no part in the fit.", *_rows(*cards))


def _next(diagnosis: Diagnosis, pictures: ReportData) -> Markup | None:
    if not diagnosis.next_experiment:
        return None
    config: Content = None
    if pictures.next_config:
        code = element("pre", pictures.next_config)
        config = element("details", element("summary", "Configuration for physid generate"), code)
    sentence = element("p", capital(diagnosis.next_experiment))
    return section("Next experiment", "", element("div", sentence, config, class_="card"))


def _small_print(pictures: ReportData) -> Markup:
    facts = [element("span", f"{name}: ", element("b", value)) for name, value in pictures.facts.items()]
    return element("footer", facts, element("span", f"Everything here for a machine: {FILE}"))


def _rows(*cards: Markup | None) -> list[Markup]:
    """Set cards side by side, wide ones in a row of their own."""
    rows = groupby((each for each in cards if each), key=lambda each: each.startswith('<div class="card wide"'))
    return [made for wide, each in rows for made in (each if wide else [element("div", list(each), class_="grid")])]
