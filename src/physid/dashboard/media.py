"""Videos and images of a run as data URIs."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

from physid.yaml_files import read_bytes

KINDS = {".mp4": "video/mp4", ".webm": "video/webm", ".png": "image/png", ".jpg": "image/jpeg", ".svg": "image/svg+xml"}
MOST_BYTES = 8_000_000
DRAWN_BY_THE_PAGE = ("parameters.png",)


def read_media(folder: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Read what a run has filmed and drawn.

    Args:
        folder: Run folder; films and images lie in it, or one folder below.

    Returns:
        A mapping (title, type, uri) for each file, films first, and a note for each that is too large to be carried,
        cannot be read, or lies elsewhere and is named by a link.
    """
    files = [path for path in sorted([*folder.glob("*"), *folder.glob("*/*")]) if path.suffix.lower() in KINDS]
    media, notes = [], []
    for path in sorted(files, key=lambda path: not KINDS[path.suffix.lower()].startswith("video")):
        name = path.relative_to(folder).as_posix()
        if name in DRAWN_BY_THE_PAGE or "wandb" in path.parts:
            continue
        try:
            if (size := path.lstat().st_size) > MOST_BYTES:
                notes.append(f"{name} ({size / 1e6:.0f} MB) is too large for this page")
                continue
            content = read_bytes(path, MOST_BYTES, within=folder)
        except OSError as error:  # a pipe, a device, a link that leads out of the run, or what may not be read
            notes.append(f"{name} cannot be read: {error}")
            continue
        kind = KINDS[path.suffix.lower()]
        uri = f"data:{kind};base64,{base64.b64encode(content).decode()}"
        title = path.stem.replace("_", " ")
        media.append({"title": title, "type": kind.partition("/")[0], "uri": uri})
    return media, notes
