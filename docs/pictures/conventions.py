"""Draw the frames and signs that recordings use: docs/pictures/conventions.svg.

Run it: python docs/pictures/conventions.py
"""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
PICTURE = Path(__file__).with_suffix(".svg")
SCALE, ORIGIN = 150.0, np.array([190.0, 235.0])  # [px/m], where the world's origin is drawn [px]
SIZE, CENTRE, TURN = np.array([0.9, 0.55, 0.35]), np.array([1.25, 0.55, 0.175]), np.deg2rad(25)
VIEW = np.array([[0.92, 0.12], [0.5, -0.38], [0.0, -0.9]])  # x to the right, y into the picture, z up

STYLE = """
text { font-family: system-ui, "DejaVu Sans", sans-serif; font-size: 14px; fill: #1f2933; }
.small { font-size: 12.5px; fill: #52606d; } .paper { fill: #ffffff; }
.ground { fill: #eef1f4; stroke: #cbd2d9; } .face { fill: #cfe0f5; fill-opacity: 0.85; stroke: #44607f; }
.world { stroke: #1f2933; } .body { stroke: #1d5fd1; } .force { stroke: #c2410c; } .turn { stroke: #7c3aed; }
.place { stroke: #52606d; stroke-dasharray: 4 3; }
line, path.turn { stroke-width: 2; fill: none; }
.l-body { fill: #1d5fd1; } .l-force { fill: #c2410c; } .l-turn { fill: #7c3aed; }
@media (prefers-color-scheme: dark) {
  text { fill: #e4e7eb; } .small { fill: #b3bdc9; } .paper { fill: #0d1117; }
  .ground { fill: #1a212a; stroke: #3a4654; } .face { fill: #274566; stroke: #86aedb; }
  .world { stroke: #e4e7eb; } .body { stroke: #6ea8ff; } .force { stroke: #fb923c; } .turn { stroke: #b794f6; }
  .place { stroke: #b3bdc9; }
  .l-body { fill: #6ea8ff; } .l-force { fill: #fb923c; } .l-turn { fill: #b794f6; }
}
"""
NOTES = (
    ("", "world frame: right-handed, z up, metres"),
    ("l-body", "body axes: along the edges; size = full edges (a, b, c)"),
    ("", "pose = position of the centre, then unit quaternion x y z w, which turns body axes to world axes"),
    ("l-turn", "twist = angular velocity [rad/s], then linear velocity of the centre [m/s], world frame"),
    (
        "l-force",
        "wrench = torque [N m], then force [N] at the centre of mass, world frame, held from frame t to t + 1",
    ),
    ("", "ground: the points p with n . p = offset; tilt n for an incline"),
)


def to_picture(point: Array) -> Array:
    """Return where a point (3,) of the world is drawn [px]."""
    return ORIGIN + SCALE * point @ VIEW


def arrow(kind: str, start: Array, end: Array, label: str = "", shift: tuple[float, float] = (6, 4)) -> str:
    """Return an arrow between two points of the world, with a label at its tip."""
    (a, b), (c, d) = to_picture(start), to_picture(end)
    text = f'<text class="l-{kind}" x="{c + shift[0]:.0f}" y="{d + shift[1]:.0f}">{label}</text>' if label else ""
    marker = f' marker-end="url(#{kind})"' if kind != "place" else ""
    return f'<line class="{kind}" x1="{a:.0f}" y1="{b:.0f}" x2="{c:.0f}" y2="{d:.0f}"{marker}/>{text}'


def polygon(kind: str, points: Array) -> str:
    """Return a filled polygon of points (n, 3) of the world."""
    text = " ".join(f"{x:.0f},{y:.0f}" for x, y in map(to_picture, points))
    return f'<polygon class="{kind}" points="{text}"/>'


def draw() -> str:
    """Return the picture."""
    turn = Rotation.from_rotvec([0, 0, TURN]).as_matrix()
    axes = turn.T  # rows: the body's axes in the world
    corners = {signs: CENTRE + turn @ (np.array(signs) * SIZE / 2) for signs in product((-1, 1), repeat=3)}
    faces = [
        [(-1, -1, -1), (1, -1, -1), (1, -1, 1), (-1, -1, 1)],
        [(1, -1, -1), (1, 1, -1), (1, 1, 1), (1, -1, 1)],
        [(-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)],
    ]
    zero, top = np.zeros(3), CENTRE + np.array([0, 0, SIZE[2] / 2])
    middle = to_picture(CENTRE + np.array([0, 0, 0.62]))
    parts = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 90 820 370" role="img" aria-label="Frames and signs of '
        'recordings">',
        f"<style>{STYLE}</style><defs>",
        *(
            f'<marker id="{kind}" viewBox="0 0 8 8" refX="6" refY="4" markerWidth="6" markerHeight="6" orient="auto">'
            f'<path class="{kind}" style="stroke-width:1.4;fill:none" d="M1 1L7 4L1 7"/></marker>'
            for kind in ("world", "body", "force", "turn")
        ),
        '</defs><rect class="paper" y="90" width="820" height="370"/>',
        polygon("ground", np.array([[-0.7, -0.4, 0], [2.7, -0.4, 0], [2.7, 1.5, 0], [-0.7, 1.5, 0]])),
        arrow("world", zero, np.array([0.7, 0, 0]), "x"),
        arrow("world", zero, np.array([0, 0.7, 0]), "y"),
        arrow("world", zero, np.array([0, 0, 0.9]), "z"),
        arrow("world", np.array([2.45, 1.2, 0]), np.array([2.45, 1.2, 0.45]), "n"),
        arrow("place", zero, CENTRE),
        *(polygon("face", np.array([corners[signs] for signs in face])) for face in faces),
        *(
            arrow("body", top, top + axes[k] * length, label)
            for k, length, label in ((0, 0.75, "a"), (1, 0.55, "b"), (2, 0.5, "c"))
        ),
        arrow("force", CENTRE, CENTRE + np.array([0.95, -0.35, 0.0]), "force"),
        f'<path class="turn" marker-end="url(#turn)" d="M{middle[0] - 22:.0f} {middle[1] + 4:.0f} A 24 9 0 1 0 '
        f'{middle[0] + 22:.0f} {middle[1] + 3:.0f}"/>',
        f'<text class="l-turn" x="{middle[0] + 30:.0f}" y="{middle[1] + 4:.0f}">angular velocity, torque &gt; 0</text>',
    ]
    for row, (kind, note) in enumerate(NOTES):
        parts.append(f'<text class="small {kind}" x="24" y="{338 + 20 * row}">{note}</text>')
    return "\n".join([*parts, "</svg>"]) + "\n"


if __name__ == "__main__":
    PICTURE.write_text(draw())
