"""Draw the picture of README.md from two real runs: one identifies two blocks, the other finds a hidden drag.

Run it (two minutes): make picture
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D

from physid.cli import main as physid
from physid.data import RecordingSet
from physid.networks import PinholeCamera
from physid.physics import Parameters, PhysicsLayer, State, World
from physid.physics.rotations import rotate
from physid.scenes import Scene, find_setup
from physid.simulators.bullet.camera import Studio

ROOT = Path(__file__).parent.parent.parent
GUESS, FOUND, TRUTH, INK, SOFT = "#d4351c", "#1d5fd1", "#12703f", "#16191f", "#5d6675"
PIXELS = 800
HIDDEN_DRAG = 0.6  # [N s/m]
MARGIN = (0.2, 0.32)  # [m] around what moves, across and along the push
ARROW = (0.08, 0.02)  # length [m], and what each newton adds [m]
CANDIDATES = 5


def identify(place: Path, trajectories: int) -> tuple[Path, Path]:
    """Record two blocks that collide, and identify mass and friction; return recordings and run."""
    data, run = place / "collide", place / "run"
    generate(place, "collide", f"trajectories={trajectories}")
    words = ["fit", "--config", str(ROOT / "configs/sysid/collide_both.yaml"), f"--run-dir={run}"]
    assert physid([*words, f"data.folder={data}"]) == 0
    return data, run


def diagnose(place: Path, trajectories: int) -> dict[str, Any]:
    """Record a pushed block with a drag that the model lacks, and return the diagnosis of the recordings."""
    drag = f"effects.viscous_drag.coefficient={HIDDEN_DRAG}"
    noise = ["noise.position=0.0002", "noise.rotation=0.002"]
    generate(place, "push_rich", f"trajectories={trajectories}", "steps=150", "guess_factor=1.0", drag, *noise)
    assert physid(["diagnose", str(place / "push_rich"), f"--out={place / 'diagnosis'}"]) == 0
    found: dict[str, Any] = json.loads((place / "diagnosis" / "diagnosis.json").read_text())
    return found


def generate(place: Path, name: str, *settings: str) -> None:
    """Make a recording set without video."""
    words = ["generate", "--config", str(ROOT / f"configs/generate/{name}.yaml"), f"--out={place / name}"]
    assert physid([*words, "--workers=1", "--quiet", "video=false", *settings]) == 0


def history(run: Path) -> dict[str, list[float]]:
    """Return the columns of a run's parameters.csv."""
    with (run / "parameters.csv").open() as file:
        rows = list(csv.DictReader(file))
    return {name: [float(row[name]) for row in rows] for name in rows[0]}


def predict(scene: Scene, pose: np.ndarray, wrench: np.ndarray, mass: float, friction: float) -> np.ndarray:
    """Predict poses (T, N, 7) from the first one, at rest, with these parameters of the pushed block."""
    masses = torch.tensor([[mass, scene.bodies[1].mass]], dtype=torch.float64)
    sizes = torch.tensor([[body.size for body in scene.bodies]], dtype=torch.float64)
    blocks = Parameters.of_boxes(sizes, masses, torch.full((1, 2), friction, dtype=torch.float64))
    start = State.at_rest(torch.from_numpy(pose[:1]))
    layer = PhysicsLayer(World(time_step=scene.time_step))
    return layer.rollout(start, torch.from_numpy(wrench[None, :-1]), blocks).pose[0].numpy()


def outlines(camera: PinholeCamera, scene: Scene, pose: np.ndarray) -> list[np.ndarray]:
    """Return the upper face of each body, closed, in the image [px]: one (5, 2) for each pose in (N, 7)."""
    corners = torch.tensor([[1, 1, 1], [-1, 1, 1], [-1, -1, 1], [1, -1, 1], [1, 1, 1]], dtype=torch.float64) / 2
    found = []
    for body, place in zip(scene.bodies, torch.from_numpy(pose), strict=True):
        world = place[:3] + rotate(place[3:].expand(5, 4), corners * torch.tensor(body.size, dtype=torch.float64))
        found.append(camera.project(world).numpy())
    return found


def draw_film(axes: list[Axes], scene: Scene, recorded: np.ndarray, force: np.ndarray, *predicted: np.ndarray) -> None:
    """Draw frames of a recording with the force, and with the first guess and what was identified over them."""
    view = find_setup(scene.name).scene.camera
    assert view is not None
    filmed = dataclasses.replace(scene, camera=dataclasses.replace(view, width=PIXELS, height=PIXELS))
    camera = PinholeCamera(**dataclasses.asdict(filmed.camera))
    places = np.concatenate([recorded, *predicted], 1)[..., :3].reshape(-1, 3)
    room = np.array([*MARGIN, 0.0]) + 0.5 * max(scene.bodies[0].size[:2])
    corners = torch.from_numpy(np.stack([places.min(0) - room, places.max(0) + room]))
    (left, bottom), (right, top) = camera.project(corners).numpy().clip(0, PIXELS)
    frames = np.linspace(0, len(recorded) - 1, len(axes)).round().astype(int)
    with Studio(filmed) as studio:
        for ax, frame in zip(axes, frames, strict=True):
            ax.imshow(studio.shoot(recorded[frame])[0])
            for pose, color, style in zip(predicted, (GUESS, FOUND), ("--", "-"), strict=True):
                for line in outlines(camera, scene, pose[frame]):
                    ax.plot(*line.T, style, color=color, linewidth=1.8)
            point_force(ax, camera, scene, recorded[frame, 0, :3], force[frame])
            ax.set_title(f"{frame * scene.time_step:.2f} s", fontsize=9, color=SOFT)
            ax.set(xticks=[], yticks=[], xlim=(left, right), ylim=(bottom, top))


def point_force(ax: Axes, camera: PinholeCamera, scene: Scene, centre: np.ndarray, force: np.ndarray) -> None:
    """Draw a force as an arrow that ends behind the body, with its strength [N]."""
    strength = float(np.linalg.norm(force))
    head = centre - force / strength * 0.6 * scene.bodies[0].size[0]
    ends = torch.from_numpy(np.stack([head - force / strength * (ARROW[0] + ARROW[1] * strength), head]))
    tail, tip = camera.project(ends).tolist()
    ax.annotate(
        "", tip, tail, arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.8, "shrinkA": 0, "shrinkB": 0}
    )
    ax.text(tail[0] + 14, (tail[1] + tip[1]) / 2, f"{strength:.0f} N", fontsize=8, color=INK, va="center")


def draw_parameters(axes: list[Axes], scene: Scene, estimates: dict[str, list[float]], true: dict[str, float]) -> None:
    """Draw how mass and friction approach the truth."""
    for ax, (name, unit) in zip(axes, (("mass", " kg"), ("friction", "")), strict=True):
        values = estimates[f"block.{name}"]
        ax.axhline(true[name], color=TRUTH, linewidth=1.6, linestyle=":")
        ax.plot(values, "o-", color=FOUND, markersize=3.5)
        ax.set_title(f"{name} {values[-1]:.4g}{unit}  (true {true[name]:.4g})", fontsize=9, loc="left")
        ax.set_xlabel("epoch", fontsize=8, color=SOFT)
        ax.set_xticks(range(0, len(values), 2))
        ax.set_ylim(0)


def draw_diagnosis(ax: Axes, diagnosis: dict[str, Any]) -> None:
    """Draw the evidence for each effect, the blamed one in colour, and what adding it does to the error."""
    blamed = {effect["name"] for effect in diagnosis["effects"]}
    ranking = [each for each in diagnosis["ranking"] if len(each["effects"]) == 1][:CANDIDATES][::-1]
    names = [each["effects"][0] for each in ranking]
    colors = [FOUND if name in blamed else "#c3cad5" for name in names]
    ax.barh([name.replace("_", " ") for name in names], [each["score"] for each in ranking], color=colors, height=0.65)
    for effect in diagnosis["effects"][:1]:
        value = next(iter(effect["parameters"].values()))
        words = f"{value['value']:.3f} {value['unit']}  (true {HIDDEN_DRAG})"
        interval = f"90 % interval {value['low']:.3f} to {value['high']:.3f}"
        ax.text(0.98, 0.08, f"{words}\n{interval}", transform=ax.transAxes, ha="right", color=FOUND, fontsize=9)
    ax.set_xlabel("evidence (score)", fontsize=8, color=SOFT)
    ax.set_xticks([])


def draw(fitted: tuple[Path, Path], diagnosis: dict[str, Any], out: Path) -> None:
    """Lay everything out on one picture."""
    recordings, estimates = RecordingSet(fitted[0]), history(fitted[1])
    held_out = recordings.indices(["test"])
    shown = recordings.read(held_out[len(held_out) // 2])
    pose, wrench = shown.pose, shown.wrench
    assert pose is not None
    assert wrench is not None
    scene = recordings.scene
    guess, found = (
        predict(scene, pose, wrench, estimates["block.mass"][k], estimates["block.friction"][k]) for k in (0, -1)
    )
    figures = json.loads((fitted[1] / "metrics.json").read_text())
    true = {name: figures[f"params/block.{name}/true"] for name in ("mass", "friction")}

    figure = Figure(figsize=(11, 4.4), dpi=150, facecolor="white")
    left, right = figure.subfigures(1, 2, width_ratios=(1.25, 1))
    films = list(
        left.subplots(1, 4, gridspec_kw={"left": 0.02, "right": 0.98, "bottom": 0.1, "top": 0.86, "wspace": 0.06})
    )
    draw_film(films, scene, pose, wrench[:, 0, 3:], guess, found)
    heading(left, 0.02, 0.975, "Record objects under known forces; predict their motion")
    keys = [Line2D([], [], color=GUESS, linestyle="--"), Line2D([], [], color=FOUND)]
    labels = ["predicted with the first guess", "predicted with what was identified"]
    left.legend(keys, labels, loc="lower left", bbox_to_anchor=(0.005, 0.0), ncols=2, frameon=False, fontsize=9)
    upper, lower = right.subfigures(2, 1, height_ratios=(1, 1.05))
    heading(upper, 0.03, 0.95, "Identify mass and friction")
    room = {"left": 0.1, "right": 0.97, "bottom": 0.25, "top": 0.7, "wspace": 0.22}
    draw_parameters(list(upper.subplots(1, 2, gridspec_kw=room)), scene, estimates, true)
    heading(lower, 0.03, 0.99, "Find what the model lacks: here a hidden drag")
    draw_diagnosis(lower.subplots(gridspec_kw={"left": 0.3, "right": 0.97, "bottom": 0.15, "top": 0.84}), diagnosis)
    for ax in [*upper.axes, *lower.axes]:
        ax.spines[["top", "right"]].set_visible(False)
        ax.tick_params(labelsize=8, colors=SOFT)
    figure.savefig(out)


def heading(part: SubFigure, x: float, y: float, text: str) -> None:
    """Write what a part of the picture shows over it."""
    part.text(x, y, text, fontsize=12, fontweight="bold", color=INK, va="top")


def main() -> None:
    """Make both runs and draw them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".png"))
    parser.add_argument("--trajectories", type=int, default=32, help="of each recording set")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        draw(identify(place, given.trajectories), diagnose(place, given.trajectories), given.out)
    print(given.out)


if __name__ == "__main__":
    main()
