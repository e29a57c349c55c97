"""How far the engine is from closed forms and from MuJoCo after two blocks have collided on the ground.

    python benchmarks/collisions.py                 a quarter of a minute
    python benchmarks/collisions.py --draws 40 --steps 1,16

Poses at 60 frames per second over 45 frames, from the same states under the same forces: the largest distance of any
block in the plane [mm], the median over the draws and, in brackets, the largest. `straight` moves along a line and has
a closed form; MuJoCo takes 64 steps from frame to frame.
"""

from __future__ import annotations

import argparse
import dataclasses
from statistics import median

import numpy as np
import torch
from numpy.typing import NDArray

from physid.physics import Parameters, PhysicsLayer, Plane, State, World
from physid.physics.schemes.integration import Midpoint
from physid.scenes import Scene, find_setup
from physid.scenes.setup import Excitation
from physid.simulators import find_simulator

RATE, FRAMES, FINE = 60, 45, 64
CASES = {"straight": ("closed_form", 1), "paper": ("mujoco", FINE), "rich": ("mujoco", FINE)}


def predicted(scene: Scene, drawn: list[Excitation], substeps: int) -> NDArray[np.float64]:
    """Return the poses that the engine predicts, shape (B, T, N, 7)."""

    def batch(values: list) -> torch.Tensor:  # type: ignore[type-arg]
        return torch.from_numpy(np.stack([np.asarray(value, dtype=float) for value in values]))

    parameters = Parameters.of_boxes(
        *(batch([[getattr(body, name) for body in scene.bodies]] * len(drawn)) for name in
          ("size", "mass", "friction", "restitution"))
    )  # fmt: skip
    ground = Plane(scene.ground.normal, scene.ground.offset)
    world = World(1 / RATE, substeps, scene.gravity, ground, integration=Midpoint())
    begin = State.checked(batch([one.pose for one in drawn]), batch([one.twist for one in drawn]))
    with torch.no_grad():
        rollout = PhysicsLayer(world).rollout(begin, batch([one.wrench[:-1] for one in drawn]), parameters)
    return rollout.pose.numpy()


def main() -> None:
    """Print one line per protocol."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=24)
    parser.add_argument("--steps", default="1,4,16,64", help="steps from frame to frame, with commas between them")
    options = parser.parse_args()
    counts = [int(count) for count in options.steps.split(",")]
    setup = find_setup("collide")
    scene = dataclasses.replace(setup.scene, time_step=1 / RATE)
    print("| protocol | against | " + " | ".join(f"{count} steps" for count in counts) + " |")
    print("|---|---|" + "---:|" * len(counts))
    for protocol, (simulator, steps) in CASES.items():
        drawn = [setup.draw(scene, protocol, np.random.default_rng(seed), FRAMES) for seed in range(options.draws)]
        motions = find_simulator(simulator).simulate(scene, drawn, substeps=steps)
        wanted = np.stack([motion.pose for motion in motions])
        cells = []
        for count in counts:
            apart = np.linalg.norm((predicted(scene, drawn, count) - wanted)[..., :2], axis=-1).max((1, 2)) * 1e3
            cells.append(f"{median(apart):.3f} ({apart.max():.3f})")
        print(f"| {protocol} | {simulator} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
