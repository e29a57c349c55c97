"""How often the contact solver fails on random problems: one sliding box, one tumbling box, two boxes.

    python benchmarks/solver_robustness.py                 100,000 problems per scene
    python benchmarks/solver_robustness.py --problems 5000

Sizes, masses and friction (0 to 1) vary, and so do speeds (of the order of 1 m/s and 5 rad/s), overlaps, gaps and
wrenches.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import torch
from torch import Tensor

from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.fused.backend import Backend, use_fused
from physid.physics.fused.stepping import Stepper
from physid.physics.layer import nominal_inputs
from physid.physics.parameters import Parameters
from physid.physics.shapes.table import find_patches
from physid.physics.state import State
from physid.physics.step import Step, advance
from physid.physics.world import World

BATCH = 2500


def _uniform(low: float, high: float, *shape: int) -> Tensor:
    return low + (high - low) * torch.rand(*shape, dtype=torch.float64)


def _parameters(bodies: int) -> Parameters:
    oblong, cube = _uniform(0.05, 0.5, BATCH, bodies, 3), _uniform(0.1, 0.3, BATCH, bodies, 1).expand(-1, -1, 3)
    return Parameters.of_boxes(
        oblong if bodies == 1 else cube,
        _uniform(0.2, 5, BATCH, bodies),
        _uniform(0, 1, BATCH, bodies),
        _uniform(0, 1, BATCH, bodies) * (torch.rand(BATCH, bodies) < 0.5),
    )


def _yaw(bodies: int) -> Tensor:
    half = _uniform(-torch.pi, torch.pi, BATCH, bodies) / 2
    zero = torch.zeros_like(half)
    return torch.stack([zero, zero, half.sin(), half.cos()], -1)


def _push(bodies: int) -> tuple[Tensor, Tensor]:
    wrench = torch.zeros(BATCH, 1, bodies, 6, dtype=torch.float64)
    wrench[..., 3:] = 10 * torch.randn(BATCH, 1, bodies, 3, dtype=torch.float64)
    return wrench, 10 * torch.randn(BATCH, bodies, 3, dtype=torch.float64)


def sliding() -> tuple[State, Parameters, Tensor]:
    """Draw boxes that stand flat, slide and spin; some at rest."""
    parameters = _parameters(1)
    height = parameters.size[..., 2:] / 2 + 1e-3 * torch.randn(BATCH, 1, 1, dtype=torch.float64)
    pose = torch.cat([torch.zeros(BATCH, 1, 2, dtype=torch.float64), height, _yaw(1)], -1)
    twist = torch.randn(BATCH, 1, 6, dtype=torch.float64) * torch.tensor([0, 0, 5.0, 1, 1, 0.1])
    twist = twist * (torch.rand(BATCH, 1, 1) < 0.8)
    return State(pose, twist), parameters, _push(1)[0]


def tumbling() -> tuple[State, Parameters, Tensor]:
    """Draw boxes in any attitude that touch the ground with a corner, at any twist."""
    parameters = _parameters(1)
    quaternion = torch.nn.functional.normalize(torch.randn(BATCH, 1, 4, dtype=torch.float64), dim=-1)
    pose = torch.cat([torch.zeros(BATCH, 1, 3, dtype=torch.float64), quaternion], -1)
    twist = torch.randn(BATCH, 1, 6, dtype=torch.float64) * torch.tensor([5.0, 5, 5, 1, 1, 1])
    inputs = nominal_inputs(State(pose, twist), torch.zeros(BATCH, 1, 1, 6, dtype=torch.float64), parameters, World())
    lowest = find_patches((), pose, inputs.size, (inputs.ground_normal, inputs.ground_offset))[0].gap.amin(1)
    pose[:, 0, 2] = -lowest + 2e-3 * torch.randn(BATCH, dtype=torch.float64)
    return State(pose, twist), parameters, _push(1)[0]


def two_boxes() -> tuple[State, Parameters, Tensor]:
    """Draw two boxes on the ground, yawed at random, that touch or nearly do."""
    parameters = _parameters(2)
    half = parameters.size[..., 0] / 2
    away = half.sum(1) * _uniform(1.0, 1.4, BATCH)
    heading = _uniform(-torch.pi, torch.pi, BATCH)
    place = torch.stack([away * heading.cos(), away * heading.sin()], -1)
    position = torch.stack([torch.zeros_like(place), place], 1)
    height = half[..., None] + 1e-4 * torch.randn(BATCH, 2, 1, dtype=torch.float64)
    twist = torch.randn(BATCH, 2, 6, dtype=torch.float64) * torch.tensor([0.1, 0.1, 3.0, 1, 1, 0.1])
    return State(torch.cat([position, height, _yaw(2)], -1), twist), parameters, _push(2)[0]


SCENES: dict[str, Callable[[], tuple[State, Parameters, Tensor]]] = {
    "sliding box": sliding,
    "tumbling box": tumbling,
    "two boxes": two_boxes,
}


def solve(scene: tuple[State, Parameters, Tensor], settings: SolverSettings, backend: Backend) -> Step:
    """Advance the worlds of a scene by one step."""
    state, parameters, wrench = scene
    inputs = nominal_inputs(state, wrench, parameters, World())
    with torch.no_grad():
        if use_fused(backend, World(), state.pose):
            return Stepper(World(), settings)(state, inputs)
        return advance(state, inputs, World(), settings)


def main() -> None:
    """Print failures, Newton steps and repeats per scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--backend", default="auto", help="auto, fused, or reference (slower by 30 for two boxes)")
    options = parser.parse_args()
    print("| scene | problems | failures | repeated, more compliant | Newton steps | most | worst residual / tau |")
    print("|---|---|---|---|---|---|---|")
    once = SolverSettings(compliance=SolverSettings().compliance[:1])
    for name, draw in SCENES.items():
        torch.manual_seed(options.seed)
        failures = repeated = total = most = steps = 0
        worst, start = 0.0, time.process_time()
        while total < options.problems:
            scene = draw()
            first = step = solve(scene, once, options.backend)
            if not bool(first.converged.all()):
                step = solve(scene, SolverSettings(), options.backend)
            failures += int((~step.converged).sum())
            repeated += int((~first.converged).sum())
            total += BATCH
            steps += int(step.newton_steps.sum())
            most = max(most, int(step.newton_steps.max()))
            worst = max(worst, float(step.residual.max()))
        print(
            f"| {name} | {total} | {failures} | {repeated} | {steps / total:.1f} | {most} | {worst:.1e} |"
            f"   ({time.process_time() - start:.0f} s)",
            flush=True,
        )


if __name__ == "__main__":
    main()
