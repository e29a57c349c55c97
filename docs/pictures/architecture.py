"""Draw the packages of physid and their imports, as the source has them: docs/pictures/architecture.svg.

Run it: make architecture
"""

from __future__ import annotations

import ast
import html
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
SOURCE = ROOT / "src" / "physid"
PICTURE = Path(__file__).with_suffix(".svg")

GROUPS = {"command line": ("cli", "commands")}
"""Packages that are one box; modules beside the packages follow by themselves."""
RECORDS, BORDER = "runs and configurations", "checked input"
ABOUT = {
    "command line": "one typed function per command",
    RECORDS: "what a run is given, and what it leaves",
    BORDER: "YAML, typed files, class names, one writer per folder",
    "benchmark": "sealed effects, verdicts, scores",
    "reproduce": "all experiments in one go",
    "dashboard": "all runs on one page",
    "training": "SysID and learning from video",
    "diagnosis": "where, which and how far a model is off",
    "estimation": "least squares, initial states profiled out",
    "pages": "templates, stylesheet and figures of all pages",
    "progress": "how far a command is: a bar, or lines in a log",
    "inspection": "whether recordings can be trusted",
    "data": "recordings on disk, importers",
    "simulators": "PyBullet, MuJoCo, closed forms",
    "effects": "what a nominal model may lack, one file each",
    "scenes": "bodies, ground, camera, ways to excite them",
    "networks": "images to poses and back",
    "physics": "the PhysicsLayer: rigid bodies in contact",
    "compiler": "formulas to machine code, with derivatives",
}
WIDTH, MARGIN, GAP, ROW_GAP, LINE = 1080, 24, 18, 46, 15
LETTER = 6.9
"""Width of a letter of the small print; text is wrapped by it."""


@dataclass(frozen=True)
class Box:
    """A package where it is drawn."""

    name: str
    about: tuple[str, ...]
    rooms: tuple[str, ...]
    x: float
    y: float
    width: float
    height: float


def imported(path: Path) -> set[str]:
    """Return the packages and modules at the top of physid that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "physid":
            parts = node.module.split(".")
            found |= {parts[1]} if len(parts) > 1 else {alias.name for alias in node.names}
    return found


def read_imports() -> dict[str, set[str]]:
    """Return which boxes each box imports."""
    direct: dict[str, set[str]] = {}
    for path in SOURCE.rglob("*.py"):
        name = path.relative_to(SOURCE).parts[0].removesuffix(".py")
        if name not in ("__init__", "__main__"):
            direct.setdefault(name, set()).update(imported(path))
    direct = {name: {other for other in others if other in direct} - {name} for name, others in direct.items()}
    box = {name: name for name in direct} | {name: group for group, names in GROUPS.items() for name in names}
    lowest = {name for name in direct if not (SOURCE / name).is_dir()}
    while beyond := {name for name in lowest if direct[name] - lowest}:
        lowest -= beyond
    for name in direct:
        if box[name] == name and (not (SOURCE / name).is_dir() or name == "schema"):
            box[name] = BORDER if name in lowest else RECORDS
    arrows: dict[str, set[str]] = {}
    for name, others in direct.items():
        arrows.setdefault(box[name], set()).update(box[other] for other in others)
    return {name: others - {name} for name, others in arrows.items()}


def floors(arrows: Mapping[str, Iterable[str]]) -> dict[str, int]:
    """Return the floor of each box, counted from the top: one below the lowest of those that import it."""
    importers = {name: [other for other, others in arrows.items() if name in others] for name in arrows}
    found: dict[str, int] = {}

    def floor(name: str, below: tuple[str, ...] = ()) -> int:
        if name in below:
            raise ValueError(f"packages import each other in a circle: {' -> '.join((name, *below))}")
        if name not in found:
            found[name] = 1 + max((floor(other, (name, *below)) for other in importers[name]), default=-1)
        return found[name]

    for name in arrows:
        floor(name)
    return found


def reduced(arrows: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """Return the arrows without those that a longer way says already."""

    def reach(name: str) -> set[str]:
        return arrows[name].union(*(reach(other) for other in arrows[name]))

    return {name: others - set().union(*(reach(other) for other in others)) for name, others in arrows.items()}


def rooms(name: str) -> str:
    """Return the folders inside a package, or the modules of a box that is none."""
    members = [path.stem for path in SOURCE.glob("*.py")]
    if name in GROUPS or name in (RECORDS, BORDER):
        return ""
    folders = sorted(path.name for path in (SOURCE / name).iterdir() if (path / "__init__.py").exists())
    return ", ".join(folder for folder in folders if folder not in members)


def lay_out(arrows: Mapping[str, set[str]]) -> dict[str, Box]:
    """Place the boxes from the top floor down, each about where those that import it stand."""
    at, boxes, y = floors(arrows), dict[str, Box](), float(MARGIN)
    for floor in range(max(at.values()) + 1):
        row = [name for name, here in at.items() if here == floor]
        middle = {name: _mean([box.x for box in boxes.values() if name in arrows[box.name]]) for name in row}
        row.sort(key=lambda name: (middle[name], name))
        width = min(330.0, (WIDTH - 2 * MARGIN - GAP * (len(row) - 1)) / len(row))
        letters = int((width - 24) / LETTER)
        about = {name: tuple(textwrap.wrap(ABOUT.get(name, ""), letters)) for name in row}
        inside = {name: tuple(textwrap.wrap(rooms(name), letters)) for name in row}
        height = 36 + LINE * max(len(about[name]) + len(inside[name]) for name in row)
        x = (WIDTH - len(row) * width - (len(row) - 1) * GAP) / 2
        for name in row:
            boxes[name] = Box(name, about[name], inside[name], x, y, width, height)
            x += width + GAP
        y += height + ROW_GAP
    return boxes


def _mean(values: list[float]) -> float:
    return sum(values) / len(values) if values else 0.0


STYLE = """
text { font-family: system-ui, "DejaVu Sans", sans-serif; fill: #1f2933; }
.name { font-size: 15px; font-weight: 600; } .line { font-size: 12px; fill: #52606d; }
.room { font: 11px ui-monospace, "DejaVu Sans Mono", monospace; fill: #7a5c00; }
.box { fill: #f5f7fa; stroke: #9aa5b1; } .arrow { fill: none; stroke: #7b8794; stroke-width: 1.2; }
.far { stroke-dasharray: 2 4; } .head { fill: #7b8794; } .paper { fill: #ffffff; }
@media (prefers-color-scheme: dark) {
  text { fill: #e4e7eb; } .line { fill: #b3bdc9; } .room { fill: #e0c060; } .box { fill: #1c232c; stroke: #52606d; }
  .arrow { stroke: #8896a5; } .head { fill: #8896a5; } .paper { fill: #0d1117; }
}
"""


def draw() -> str:
    """Return the picture."""
    arrows = reduced(read_imports())
    boxes = lay_out(arrows)
    height = max(box.y + box.height for box in boxes.values()) + MARGIN
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height:.0f}" role="img" '
        'aria-label="Packages of physid; an arrow leads to what a package imports">',
        f"<style>{STYLE}</style>",
        '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path class="head" d="M0 0L8 4L0 8z"/></marker></defs>',
        f'<rect class="paper" width="{WIDTH}" height="{height:.0f}"/>',
    ]
    for name, others in arrows.items():
        for other in sorted(others):
            parts.append(_arrow(boxes[name], boxes[other]))
    for box in boxes.values():
        frame = f'x="{box.x:.0f}" y="{box.y:.0f}" width="{box.width:.0f}" height="{box.height:.0f}"'
        parts.append(f'<rect class="box" {frame} rx="6"/>')
        parts.append(f'<text class="name" x="{box.x + 12:.0f}" y="{box.y + 22:.0f}">{html.escape(box.name)}</text>')
        kinds = ["line"] * len(box.about) + ["room"] * len(box.rooms)
        for number, (kind, line) in enumerate(zip(kinds, box.about + box.rooms, strict=True)):
            y = box.y + 40 + LINE * number
            parts.append(f'<text class="{kind}" x="{box.x + 12:.0f}" y="{y:.0f}">{html.escape(line)}</text>')
    return "\n".join([*parts, "</svg>"]) + "\n"


def _arrow(start: Box, end: Box) -> str:
    """Return a curve from the lower edge of a box to the upper edge of another."""
    middle = start.x + start.width / 2, end.x + end.width / 2
    a = min(max(middle[1], start.x + 16), start.x + start.width - 16) * 0.5 + middle[0] * 0.5
    b = min(max(middle[0], end.x + 16), end.x + end.width - 16) * 0.5 + middle[1] * 0.5
    top, bottom = start.y + start.height, end.y
    kind = "arrow far" if bottom - top > ROW_GAP else "arrow"
    bend = min(60.0, (bottom - top) * 0.6)
    return (
        f'<path class="{kind}" marker-end="url(#head)" d="M{a:.0f} {top:.0f}C{a:.0f} {top + bend:.0f} '
        f'{b:.0f} {bottom - bend:.0f} {b:.0f} {bottom:.0f}"/>'
    )


if __name__ == "__main__":
    PICTURE.write_text(draw())
