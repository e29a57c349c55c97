"""Films in the report: recording and model, before and after."""

from __future__ import annotations

import base64

from physid.diagnosis.report.contents import Film, Overlay, ReportData
from physid.diagnosis.report.elements import Markup, card, element

MOST_BYTES = 16_000_000  # of one film; a page beyond this does not open well on a phone


def film_cards(pictures: ReportData) -> list[Markup | None]:
    """Make the cards of all films.

    Raises:
        ValueError: If a film is too large to be carried by a page.
    """
    drawn = [] if pictures.overlay is None else [_overlay(pictures.overlay)]
    return [*drawn, *(card(film.title, _video(film)) for film in pictures.films)]


def _overlay(overlay: Overlay) -> Markup | None:
    """Show a film with the outlines of the models, and pictures out of it."""
    keys = [
        element("span", element("i", class_=f"key {kind}"), name)
        for kind, name in zip(("before", "after"), overlay.models, strict=False)
    ]
    white = element("span", element("i", class_="key recorded"), "recorded")
    wide = len(overlay.models) > 1
    stills = [
        element("figure", element("img", src=_data("image/webp", one.picture), alt=one.caption, loading="lazy"),
                element("figcaption", one.caption, class_="number"))
        for one in overlay.stills
    ]  # fmt: skip
    many = f", drawn {overlay.larger} times as large as they are" if overlay.larger > 1 else ""
    return card(
        f"Outlines over the film of {overlay.trajectory}, where the nominal model is furthest off",
        element("div", white, keys, class_="legend"),
        element("div", _video(overlay.film), class_="wide-film" if wide else "film") if overlay.film else None,
        element("div", stills, class_="stills wide-stills" if wide else "stills"),
        note=f"Differences of the positions and headings{many}; below each picture the time and their size.",
        wide=True,
    )


def _video(film: Film) -> Markup:
    content = film.path.read_bytes()
    if len(content) > MOST_BYTES:
        size = f"{len(content) / 1e6:.0f} MB"
        raise ValueError(f"{film.path}: expected a film of at most 16 MB, found {size}; make it shorter or smaller")
    source = _data("video/mp4", content)
    return element("video", src=source, controls=True, loop=True, muted=True, playsinline=True, preload="metadata")


def _data(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
