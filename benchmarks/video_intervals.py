"""How often the 90 % intervals of parameters learned from video hold the truth.

One trained encoder and its decoder read many small sets of fresh recordings, each with true parameters of its own; only
the last phase, which gives the intervals, is carried out for each, from a tenth above the truth, about where the phases
before it end.

    python benchmarks/video_intervals.py --run runs/reproduce/supervised/push_friction --sets 20
    python benchmarks/video_intervals.py --run runs/reproduce/supervised/slide_friction --sets 20
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from physid.configuration import compose
from physid.data.batches.datamodule import RecordingsDataModule
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.networks import as_image
from physid.scenes import Scene
from physid.training.learners.supervised import SupervisedID
from physid.training.learners.video import Objective
from physid.training.parameters.intervals import intervals
from physid.training.parameters.physical_parameters import PhysicalParameters
from physid.training.parameters.pose_loss import PoseLoss
from physid.training.refinement.horizon import Horizon
from physid.training.refinement.kesten_step import KestenStep
from physid.training.refinement.normal_equations import NormalEquations
from physid.training.refinement.refinement import LARGEST_STEP, Readings, add_to
from physid.training.vision.first_look import look_at
from physid.training.vision.pose_refinement import PoseRefinement
from physid.training.vision.reading import Vision
from physid.training.vision.shown_frames import at_frames, over_time

CONFIGS = Path(__file__).parents[1] / "configs" / "generate"
RANGES = {"block.friction": (0.06, 0.25), "block.mass": (1.0, 3.0)}
STEPS, SETTLED = 16, 1e-5
"""Most steps of the last phase; the change of ln(parameter) that ends it."""
FRAMES = 60
"""Frames between those that are read without supervision."""
Bounds = dict[str, tuple[float, float, float]]


def record(folder: Path, scene: str, names: list[str], number: int, trajectories: int) -> dict[str, float]:
    """Make a set with parameters of its own, and return these."""
    generator = np.random.default_rng(number)
    true = {name: float(generator.uniform(*RANGES[name])) for name in names}
    values = ", ".join(f"{name}: {value}" for name, value in true.items())
    settings = [
        f"trajectories={trajectories}",
        f"seed={1000 + number}",
        f"true_values={{{values}}}",
        "guess_factor=1.1",
    ]
    generate(
        GenerateConfig.from_mapping(compose([str(CONFIGS / f"{scene}.yaml")], settings, reads=GenerateConfig).values),
        folder,
        1,
    )
    return true


def load(run: Path) -> tuple[SupervisedID, str]:
    """Return the module that a supervised run has trained, and the name of its scene."""
    state = torch.load(run / "checkpoints" / "last.ckpt", map_location="cpu", weights_only=True)["state_dict"]
    arguments = compose([str(run / "config.yaml")]).values
    recordings = RecordingsDataModule(arguments["data"]["init_args"]["folder"]).recordings
    given = arguments["model"]["init_args"]
    vision, objective = given["vision"], given["objective"]
    module = SupervisedID(
        given["learn"],
        vision=Vision(vision["chart"], pose_refinement=PoseRefinement(**vision["pose_refinement"])),
        objective=Objective(PoseLoss(**objective["pose_loss"]), horizon=Horizon(objective["horizon"].get("frames"))),
    ).attach(recordings.scene)
    module.load_state_dict(state, strict=False)
    return module.eval(), recordings.scene.name


def identify(module: SupervisedID, folder: Path) -> dict[str, Bounds]:
    """Return estimates and intervals, with known poses as goals and with those read from images."""
    model = module.model
    data = RecordingsDataModule(folder, video="all", every=FRAMES, fit=("train", "test"), shuffle=False)
    look_at(model, data.recordings, data.trajectories("fit"))
    batch = module.objective.horizon.cut(next(iter(data.train_dataloader())), all_trajectories=True)
    _, encoded = model.read(as_image(batch["frames"]), as_image(batch["background"]))
    goal, real = over_time(encoded.double(), batch)
    everywhere, known = torch.ones_like(real), at_frames(batch["pose"], batch["shown"])
    return {
        "supervised": refine(module, data.scene, batch, known, batch["pose"], everywhere, from_images=False),
        "self-supervised": refine(module, data.scene, batch, encoded, goal, real, from_images=True),
    }


def refine(
    module: SupervisedID,
    scene: Scene,
    batch: dict[str, Any],
    encoded: Tensor,
    goal: Tensor,
    real: Tensor,
    *,
    from_images: bool,
) -> Bounds:
    """Carry out the last phase from a scene's first guesses; returns estimates and intervals."""
    model = module.model
    model.physical = PhysicalParameters(scene, model.physical.names)
    bounds: dict[str, tuple[float, float]] = {}
    calm = KestenStep()
    for _ in range(STEPS):
        equations = NormalEquations()
        known = Readings(encoded, goal, real, from_images)
        add_to(equations, model, module.objective.pose_loss, batch, known)
        step = calm(equations.step(LARGEST_STEP), equations.normal.matrix.sum(0))
        with torch.no_grad():
            model.physical.coordinates.add_(step)
        bounds = intervals(model.physical.estimates(), equations.covariance())
        if step.abs().max() < SETTLED:
            break
    return {name: (value, *bounds[name]) for name, value in model.physical.estimates().items()}


def main() -> None:
    """Print every set, and for each parameter the share of intervals that hold the truth."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", type=Path, required=True, help="a supervised run")
    parser.add_argument("--sets", type=int, default=20)
    parser.add_argument("--trajectories", type=int, default=24)
    options = parser.parse_args()
    torch.set_num_threads(1)
    module, scene = load(options.run)
    names, held = list(module.physical.names), Counter[tuple[str, str]]()
    errors: defaultdict[tuple[str, str], list[float]] = defaultdict(list)
    for number in range(options.sets):
        with tempfile.TemporaryDirectory() as folder:
            true = record(Path(folder), scene, names, number, options.trajectories)
            for method, found in identify(module, Path(folder)).items():
                for name, (estimate, low, high) in found.items():
                    held[method, name] += low <= true[name] <= high
                    errors[method, name].append(abs(estimate / true[name] - 1))
                    shown = f"true {true[name]:.5f}  {estimate:.5f} [{low:.5f}, {high:.5f}]"
                    print(f"{number:3d} {method:15s} {name} {shown}", flush=True)
    for (method, name), off in errors.items():
        share = held[method, name]
        print(f"{method} {name}: {share} of {options.sets} intervals hold the truth, mean error {np.mean(off):.3%}")


if __name__ == "__main__":
    main()
