"""A page that draws recorded boxes and forces, so that a wrong axis is seen at once; one file, no network."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from physid.data import Recording, RecordingSet
from physid.data.files import PAGES, require_ending, write_text
from physid.data.observations.step_grid import lay_steps
from physid.pages.templates import render
from physid.scenes import Scene
from physid.scenes.camera import corners

MOST_FRAMES = 600  # of a trajectory that are drawn
DIGITS = 5  # of numbers on the page: a hundredth of a millimetre
SQUARES = 8
"""About how many squares of the ground lie along a trajectory."""
GROUND_IN_VIEW = 1.0
"""Extents of a trajectory by which the ground may be away and still be in view; else its bodies would be tiny."""


def write_page(recordings: RecordingSet, indices: Sequence[int], path: Path) -> int:
    """Write the page.

    Args:
        recordings: The set.
        indices: Which trajectories.
        path: The HTML file.

    Returns:
        How many trajectories are drawn; those without poses are not.

    Raises:
        ValueError: If none has poses, a file is damaged, or the name is not that of a page.
    """
    require_ending(path, *PAGES)
    scene = recordings.scene
    shown = [(index, recordings.read(index)) for index in indices if recordings.has_poses(index)]
    if not shown:
        raise ValueError(f"{recordings.folder}: expected trajectories with poses to draw, found none; see physid track")
    parts = [_trajectory(index, one, scene.time_step) | _view(one, scene) for index, one in shown]
    strongest = max((float(np.abs(part["force"]).max()) for part in parts if part["force"] is not None), default=0.0)
    data = {
        "name": f"{scene.name}: {recordings.folder.resolve().name}",
        "bodies": [{"name": body.name, "size": list(body.size)} for body in scene.bodies],
        "normal": list(scene.ground.normal),
        "offset": scene.ground.offset,
        "strongest": strongest or 1.0,
        "trajectories": [part | {"force": None if part["force"] is None else part["force"].tolist()} for part in parts],
    }
    write_text(path, render("recordings.html", script="recordings.js", title=data["name"], data=data))
    return len(shown)


def _view(one: Recording, scene: Scene) -> dict[str, Any]:
    """Return what the page looks at while it draws a trajectory: the bodies all the way, and the ground if it is near.

    Returns:
        `middle` [m], `extent` (what should fit into the window [m]), `origin` (where the axes are drawn [m]), and
        `square`, the side of a square of the ground: 1, 2 or 5 times a power of ten [m].
    """
    points = _corners(one, scene.sizes).reshape(-1, 3)
    points = points if len(points) else np.zeros((1, 3))
    normal = np.array(scene.ground.normal)
    extent = max(float(np.ptp(points, axis=0).max()), float(scene.sizes.max()))
    height = points @ normal - scene.ground.offset
    near = np.abs(height) < GROUND_IN_VIEW * extent
    points = np.concatenate([points, points[near] - height[near, None] * normal])
    low, high = points.min(0), points.max(0)
    extent = max(float((high - low).max()), extent)
    power = 10.0 ** np.floor(np.log10(extent / SQUARES))
    return {
        "middle": ((low + high) / 2).tolist(),
        "origin": [*((low + high) / 2 - 0.5 * extent)[:2].tolist(), float(low[2])],
        "extent": 1.2 * extent,
        "square": float(f"{power * max(each for each in (1, 2, 5) if each * power <= extent / SQUARES * 1.001):.3g}"),
    }


def _corners(one: Recording, sizes: Any) -> Any:
    """Return the corners of all poses that were seen."""
    assert one.pose is not None
    return np.concatenate([corners(one.pose[one.seen[:, n], n][:, None], sizes[n : n + 1]) for n in range(len(sizes))])


def _trajectory(index: int, one: Recording, time_step: float) -> dict[str, Any]:
    """Return what the page draws of a trajectory: so many frames, and the mean force from each to the next."""
    assert one.pose is not None
    time = one.stamps(time_step)
    frames = np.unique(np.linspace(0, one.length - 1, min(one.length, MOST_FRAMES)).round().astype(int))
    pose = np.round(one.pose[frames], DIGITS)
    force = None
    if one.wrench is not None:
        steps = lay_steps(time[frames], one.wrench, one.wrench_stamps(time_step), time_step, np.inf)
        held = (
            np.concatenate([steps.wrench, steps.wrench[-1:]])
            if len(steps.wrench)
            else np.zeros((1, *one.wrench.shape[1:]))
        )
        force = np.round(held[steps.frame_step, :, 3:], DIGITS)
    label = f"{index}" + (f" ({one.split})" if one.split else "")
    return {
        "label": label,
        "frames": frames.tolist(),
        "time": np.round(time[frames] - time[0], DIGITS).tolist(),
        "pose": [[each.tolist() if np.isfinite(each[0]) else None for each in row] for row in pose],
        "force": force,
    }
