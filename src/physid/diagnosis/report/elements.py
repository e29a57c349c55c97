"""HTML from Python: elements whose text is escaped unless it is markup already."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import TypeAlias, final


@final
class Markup(str):
    """Text that is HTML already and is not escaped again."""

    __slots__ = ()


Content: TypeAlias = "str | Iterable[Content] | None"


def element(tag: str, *content: Content, **attributes: object) -> Markup:
    """Build an element.

    Args:
        tag: Its name.
        content: Texts (escaped), markup, lists of these; None is left out.
        attributes: Written with hyphens for underscores, `class_` as `class`; False and None are left out.

    Returns:
        The element as markup.
    """
    written = "".join(
        f" {name.rstrip('_').replace('_', '-')}" + ("" if value is True else f'="{escape(str(value))}"')
        for name, value in attributes.items()
        if value is not None and value is not False
    )
    inside = "".join(_flat(content))
    if not inside and tag in ("meta", "line", "polyline", "br", "img"):
        return Markup(f"<{tag}{written}/>")
    return Markup(f"<{tag}{written}>{inside}</{tag}>")


def _flat(content: Content) -> Iterable[str]:
    if content is None:
        return
    if isinstance(content, str):
        yield content if isinstance(content, Markup) else escape(content)
        return
    for each in content:
        yield from _flat(each)


def badge(text: str, kind: str = "") -> Markup:
    """Build a small label; kind is good, warn, bad, plain or empty."""
    return element("span", text, class_=f"badge {kind}".strip())


def section(title: str, lead: str, *content: Content) -> Markup | None:
    """Build a section with a heading and a sentence below it; None where it would be empty."""
    inside = [each for each in content if each]
    if not inside:
        return None
    return element("section", element("h2", title), element("p", lead, class_="lead") if lead else None, *inside)


def card(title: str, *content: Content, note: str = "", wide: bool = False) -> Markup | None:
    """Build a box with a title and a note below; None where it would be empty."""
    inside = [each for each in content if each]
    if not inside:
        return None
    return element(
        "div",
        element("h3", title) if title else None,
        *inside,
        element("p", note, class_="small soft below") if note else None,
        class_="card wide" if wide else "card",
    )
