"""Pages from templates: one HTML file each that needs nothing from outside; texts are escaped unless markup."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from physid.pages import numbers

if TYPE_CHECKING:
    from jinja2 import Environment

ICON = (
    "data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'%3E%3Cpath d='M1 14h14' "
    "stroke='%23808080' stroke-width='2'/%3E%3Crect x='4' y='5' width='8' height='8' rx='1' fill='%232563eb' "
    "transform='rotate(-8 8 9)'/%3E%3C/svg%3E"
)
FILTERS = (
    *("words", "capital", "join", "figure", "percent", "error", "quantity", "unit_of", "interval", "duration"),
    *("p_value", "named", "plural", "resolved"),
)


def render(template: str, *, script: str = "", **values: Any) -> str:
    """Return a page as one HTML document.

    Args:
        template: Name of a template in this package.
        script: Name of the script that the page may run, if any: the content security policy names it by its digest, so
            that whatever stands in the values does not run.
        values: What the template shows.

    Returns:
        The page.
    """
    code = asset(script) if script else ""
    digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
    allowed = f" script-src 'sha256-{digest}';" if script else ""
    policy = (
        f"default-src 'none'; style-src 'unsafe-inline';{allowed} img-src data: blob:; media-src data: blob:; "
        "font-src data:"
    )
    given = {  # files and texts of this package, nothing from outside
        "style": Markup(asset("style.css")),  # nosec B704
        "script": Markup(code),  # nosec B704
        "policy": Markup(policy),  # nosec B704
        "icon": Markup(ICON),  # nosec B704
    }
    return _environment().get_template(template).render(**given, **values)


def asset(name: str) -> str:
    """Return the text of a file of this package."""
    return resources.files("physid.pages").joinpath("assets", name).read_text(encoding="utf-8")


def data_uri(kind: str, content: bytes) -> str:
    """Return a file as an address that holds it; `kind` is its media type."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def as_json(values: Any) -> Markup:
    """Return values as JSON for a script element, which no text in them can end."""
    text = json.dumps(values, allow_nan=False, separators=(",", ":"))
    escaped = re.sub("[<>&\u2028\u2029]", lambda found: f"\\u{ord(found[0]):04x}", text)
    return Markup(escaped)  # no letter is left that HTML knows  # nosec B704


def breakable(name: str) -> Markup:
    """Return a name that may be broken after a slash, a dot or an underscore."""
    return Markup("<wbr>").join(re.split(r"(?<=[/_.])", name))


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from jinja2.filters import do_join

    made = Environment(
        loader=PackageLoader("physid.pages"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update({name: getattr(numbers, name) for name in FILTERS}, as_json=as_json, breakable=breakable)
    made.filters["listed"] = made.filters.pop("join")
    made.filters["join"] = do_join
    return made
