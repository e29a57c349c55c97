"""Colours: on a terminal, never in a pipe or a file, and not where NO_COLOR asks for none (no-color.org)."""

from __future__ import annotations

import os
from typing import Literal, TextIO

CODES = {"bold": 1, "red": 31, "green": 32}


def styled(text: str, style: Literal["bold", "red", "green"], stream: TextIO) -> str:
    """Return a text as a stream can show it: with ECMA-48's escape sequences on a terminal, else unchanged."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb" or not stream.isatty()
    return text if plain else f"\x1b[{CODES[style]}m{text}\x1b[0m"
