"""Speed and memory of the PhysicsLayer: trajectories per second, CPU time, first call, growth.

    python benchmarks/rollout.py                       everything, some minutes
    python benchmarks/rollout.py --scenes push --batches 64
    python benchmarks/rollout.py --backend reference --batches 16 --steps 30
    python benchmarks/rollout.py --only effects
    python benchmarks/rollout.py --device cuda --only scenes --batches 4096

Times are CPU times of the process, the median of the repeats after one that warms up, per trajectory of 300 steps; the
gradient is that of the last poses by mass and friction. On one thread unless --threads says otherwise.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

# As `physid` itself does: idle threads of torch would spin and take the cores away. Read when torch loads.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import numpy as np
import torch
from torch import Tensor

from physid.effects import CATALOGUE, from_values
from physid.physics import Effect, Parameters, PhysicsLayer, Plane, State, World
from physid.physics.fused.backend import Backend
from physid.physics.schemes.integration import Integration, Midpoint, SemiImplicit
from physid.scenes import find_setup

STEPS = 300
FIRST_CALL = """
import time
start = time.perf_counter()
import sys
sys.path.insert(0, {here!r})
from rollout import draw
work = draw({scene!r}, 64, 30)
ready = time.perf_counter()
work.gradient()
print(ready - start, time.perf_counter() - ready)
"""


@dataclass(frozen=True)
class Work:
    """Trajectories of a scene, ready to be rolled out."""

    layer: PhysicsLayer
    start: State
    wrenches: Tensor
    size: Tensor
    mass: Tensor
    friction: Tensor
    restitution: Tensor

    def forward(self) -> None:
        """Roll out without gradient."""
        with torch.no_grad():
            self._poses(self.mass, self.friction)

    def gradient(self) -> tuple[Tensor, Tensor]:
        """Roll out and return the gradient of the sum of the last poses by mass and friction."""
        mass, friction = self.mass.clone().requires_grad_(), self.friction.clone().requires_grad_()
        return torch.autograd.grad(self._poses(mass, friction)[:, -1].sum(), (mass, friction))

    def _poses(self, mass: Tensor, friction: Tensor) -> Tensor:
        parameters = Parameters.of_boxes(self.size, mass, friction, self.restitution)
        return self.layer.rollout(self.start, self.wrenches, parameters).pose


def draw(
    scene: str,
    batch: int,
    steps: int = STEPS,
    backend: Backend = "auto",
    protocol: str = "rich",
    device: str = "cpu",
    integration: Integration | None = None,
    effects: Sequence[Effect] = (),
) -> Work:
    """Draw trajectories of a scene, always the same ones."""
    setup, generator = find_setup(scene), np.random.default_rng(0)
    known = setup.scene
    drawn = [setup.draw(known, protocol, generator, steps) for _ in range(batch)]
    pose, twist, wrench = (
        torch.from_numpy(np.stack([getattr(one, name) for one in drawn])).to(device)
        for name in ("pose", "twist", "wrench")
    )
    ground = Plane(known.ground.normal, known.ground.offset)
    scheme = integration or SemiImplicit()
    world = World(time_step=known.time_step, gravity=known.gravity, ground=ground, integration=scheme)
    size, mass, friction, restitution = (
        torch.tensor([[getattr(body, name) for body in known.bodies]], dtype=torch.float64, device=device)
        for name in ("size", "mass", "friction", "restitution")
    )
    layer = PhysicsLayer(world, effects, backend=backend)
    return Work(layer, State(pose, twist), wrench, size, mass, friction, restitution)


def cpu_time(work: Callable[[], object], repeats: int) -> float:
    """Return the median CPU time of a call [s], after one that is not counted."""
    return median_time(work, repeats, time.process_time)


def median_time(work: Callable[[], object], repeats: int, clock: Callable[[], float]) -> float:
    """Return the median time of a call by a clock [s], after one that is not counted."""
    work()
    times = []
    for _ in range(repeats):
        start = clock()
        work()
        times.append(clock() - start)
    return statistics.median(times)


def gpu_clock() -> float:
    """Return the time by the clock [s] once the GPU has done what it was given."""
    torch.cuda.synchronize()
    return time.perf_counter()


def table(title: str, *columns: str) -> None:
    """Print the head of a table."""
    print(f"\n{title}\n\n| " + " | ".join(columns) + " |\n|" + "---|" * len(columns), flush=True)


def measure_scenes(options: argparse.Namespace) -> None:
    """Print CPU time per trajectory for every scene and batch."""
    clock, unit = (gpu_clock, "ms") if options.device == "cuda" else (time.process_time, "CPU ms")
    table(
        f"{options.steps} steps, {options.threads} thread(s), {options.device}, per trajectory of {STEPS} steps",
        "scene", "B", f"forward [{unit}]", f"with gradient [{unit}]", "forward [1/s]", "with gradient [1/s]",
    )  # fmt: skip
    for scene in options.scenes:
        for batch in options.batches:
            scheme = Midpoint() if options.integration == "midpoint" else SemiImplicit()
            work = draw(scene, batch, options.steps, options.backend, options.protocol, options.device, scheme)
            share = STEPS / options.steps / batch
            calls = (work.forward, work.gradient)
            forward, gradient = (share * median_time(call, options.repeats, clock) for call in calls)
            cells = f"{1e3 * forward:.3f} | {1e3 * gradient:.3f} | {1 / forward:.0f} | {1 / gradient:.0f}"
            print(f"| {scene} | {batch} | {cells} |", flush=True)


def measure_effects(options: argparse.Namespace) -> None:
    """Print what each effect that acts at steps costs, at its typical size, beside a rollout without effects."""
    table(f"Effects in push, B = 64, {options.steps} steps", "effect", "forward [CPU ms]", "with gradient [CPU ms]")
    kinds = [kind for kind in CATALOGUE if kind.act is not Effect.act]
    for chosen in ([], *([kind] for kind in kinds)):
        typical = [
            from_values(kind.name, {name: q.typical for name, q in kind.quantities().items()}) for kind in chosen
        ]
        work = draw("push", 64, options.steps, options.backend, integration=Midpoint(), effects=typical)
        forward, gradient = (1e3 * cpu_time(call, options.repeats) for call in (work.forward, work.gradient))
        print(f"| {chosen[0].name if chosen else 'none'} | {forward:.1f} | {gradient:.1f} |", flush=True)


def measure_growth(options: argparse.Namespace) -> None:
    """Print how the time of a batch grows with steps."""
    table("Growth with steps, B = 64, with gradient", "scene", "steps", "CPU ms per trajectory", "CPU us per step")
    for scene in ("push", "collide"):
        for steps in (75, 150, 300, 600):
            taken = cpu_time(draw(scene, 64, steps, options.backend).gradient, options.repeats) / 64
            print(f"| {scene} | {steps} | {1e3 * taken:.3f} | {1e6 * taken / steps:.2f} |", flush=True)


def measure_threads(options: argparse.Namespace) -> None:
    """Print the time on all cores against that on one, by the clock."""
    table("Threads, B = 256, with gradient, by the clock", "scene", "threads", "trajectories / s", "times one thread")
    for scene in ("push", "collide"):
        work, rates = draw(scene, 256, STEPS, options.backend), []
        for threads in range(1, (os.cpu_count() or 1) + 1):
            torch.set_num_threads(threads)
            work.gradient()
            times = []
            for _ in range(2 * options.repeats):
                start = time.perf_counter()
                work.gradient()
                times.append(time.perf_counter() - start)
            rates.append(256 / min(times))
            print(f"| {scene} | {threads} | {rates[-1]:.0f} | {rates[-1] / rates[0]:.2f} |", flush=True)
    torch.set_num_threads(options.threads)


def measure_first_call() -> None:
    """Print what the first gradient of a process takes, without and with machine code on disk."""
    table("First gradient of a process, B = 64", "scene", "machine code", "imports [s]", "first call [s]")
    for scene in ("push", "collide"):
        with tempfile.TemporaryDirectory() as cache:
            for kind in ("compiled", "from disk"):
                script = FIRST_CALL.format(here=os.path.dirname(os.path.abspath(__file__)), scene=scene)
                environment = os.environ | {"XDG_CACHE_HOME": cache, "OMP_NUM_THREADS": "1"}
                run = subprocess.run(
                    [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
                )
                imports, first = (float(number) for number in run.stdout.split())
                print(f"| {scene} | {kind} | {imports:.1f} | {first:.2f} |", flush=True)


def measure_memory() -> None:
    """Print the peak memory of a large derivative; run first, since a peak does not go down."""
    work = draw("collide", 900)
    draw("collide", 8, 2).gradient()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    work.gradient()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    table("Memory", "work", "peak over what is held before [MB]")
    print(f"| gradient of 900 trajectories of two boxes, 300 steps | {peak / 1024:.0f} |", flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=["push", "slide", "collide", "toss"])
    parser.add_argument("--batches", nargs="+", type=int, default=[1, 64, 256, 1024])
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--protocol", default="rich", help="how the scenes are excited: rich or paper")
    parser.add_argument("--integration", choices=["semi-implicit", "midpoint"], default="semi-implicit")
    parser.add_argument("--backend", default="auto", help="auto, fused or reference")
    parser.add_argument(
        "--device", choices=["cpu", "cuda"], default="cpu", help="cuda: times by the clock, scenes only"
    )
    parser.add_argument(
        "--only", choices=["scenes", "effects", "growth", "threads", "first", "memory"], help="one table"
    )
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    tables: dict[str, Callable[[], None]] = {
        "memory": measure_memory,
        "first": measure_first_call,
        "scenes": lambda: measure_scenes(options),
        "effects": lambda: measure_effects(options),
        "growth": lambda: measure_growth(options),
        "threads": lambda: measure_threads(options),
    }
    for name, print_table in tables.items():
        if options.only in (None, name):
            print_table()


if __name__ == "__main__":
    main()
