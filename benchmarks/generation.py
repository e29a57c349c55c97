"""What generating a trajectory costs beside PyBullet's stepping and rendering alone, in CPU time of one process.

    python benchmarks/generation.py                  40 trajectories of 300 steps per case
    python benchmarks/generation.py --trajectories 8

"Alone" is the bare loop over the same trajectories: apply the force, step, read the state, and render ground and bodies
with the software renderer. "Generate" is all of it: drawing, redrawing, stepping, filming, compressing, writing.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import pybullet

from physid.data.generation.draw import draw
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.scenes import Excitation, Scene
from physid.simulators.bullet.camera import GROUND_HALF_WIDTH, Studio, matrices
from physid.simulators.bullet.engine import Engine
from physid.simulators.bullet.paint import ground_mesh, ground_tile

ALLOWED = 1.15


def bare(scene: Scene, excitation: Excitation, video: bool) -> None:
    """Step one trajectory, and render it if there is a video."""
    with Engine(scene, scene.time_step) as engine:
        engine.set_state(excitation.pose, excitation.twist)
        states = [engine.read()[0]]
        for load in excitation.wrench[:-1].tolist():
            engine.push(states[-1], load)
            engine.step()
            states.append(engine.read()[0])
    if video and scene.camera:
        with Studio(scene) as studio:
            studio._add(ground_mesh(GROUND_HALF_WIDTH), ground_tile())
            view, projection = matrices(scene.camera)
            for pose in states:
                for body, place in zip(studio._bodies, pose, strict=True):
                    client = {"physicsClientId": studio._client}
                    pybullet.resetBasePositionAndOrientation(body, place[:3], place[3:], **client)
                size = scene.camera.width, scene.camera.height
                renderer = pybullet.ER_TINY_RENDERER
                pybullet.getCameraImage(*size, view, projection, shadow=0, renderer=renderer, **client)


def measure(scene: str, video: bool, trajectories: int) -> tuple[float, float]:
    """Return the CPU time per trajectory [s]: PyBullet alone, and generate."""
    config = GenerateConfig(scene, trajectories=trajectories, video=video)
    protocols = [config.protocol_for(split) for split in config.splits()]
    drawn = [draw(config, index, protocol)[0] for index, protocol in enumerate(protocols)]
    start = time.process_time()
    for excitation in drawn:
        bare(config.true_scene(), excitation, video)
    alone = time.process_time() - start
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        generate(config, Path(folder), workers=1, quiet=True)
        whole = time.process_time() - start
    return alone / trajectories, whole / trajectories


def main() -> None:
    """Print one line per scene, with and without video."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trajectories", type=int, default=40)
    count = parser.parse_args().trajectories
    print(f"{'scene':10}{'video':>8}{'alone [ms]':>14}{'generate [ms]':>16}{'ratio':>8}   (at most {ALLOWED})")
    for video in (True, False):
        for scene in ("push", "slide", "collide", "toss"):
            alone, whole = measure(scene, video, max(4, count // 4) if video else count)
            print(f"{scene:10}{video!s:>8}{1e3 * alone:14.1f}{1e3 * whole:16.1f}{whole / alone:8.2f}", flush=True)


if __name__ == "__main__":
    main()
