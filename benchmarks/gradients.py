"""Gradients of the PhysicsLayer against central finite differences, per contact mode.

Prints the table of docs/results.md:

    python benchmarks/gradients.py            all cases, 1, 30 and 300 steps
    python benchmarks/gradients.py --steps 1 30
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from physid.physics import Parameters, PhysicsLayer, State, World

TIME_STEP = 1 / 240


@dataclass(frozen=True)
class Case:
    """A contact mode: initial state, wrenches and parameters, all for a batch of one.

    Attributes:
        name: What happens.
        tolerance: Accepted relative error of the gradient.
        build: Returns (pose, twist, wrenches, mass, friction, restitution) for a number of steps.
    """

    name: str
    tolerance: float
    build: Callable[[int], tuple[Tensor, ...]]


def _one(height: float = 0.1, push: float = 0.0, friction: float = 0.3, restitution: float = 0.0, ramp: bool = False):  # noqa: ANN202
    def build(steps: int) -> tuple[Tensor, ...]:
        pose = torch.tensor([[[0.0, 0.0, height, 0.0, 0.0, 0.0, 1.0]]], dtype=torch.float64)
        twist = torch.zeros(1, 1, 6, dtype=torch.float64)
        if push and friction * 9.81 < push and not ramp:
            twist[..., 3] = 0.5
        wrench = torch.zeros(1, steps, 1, 6, dtype=torch.float64)
        profile = (
            torch.linspace(0.5, 1.5, steps, dtype=torch.float64) if ramp else torch.ones(steps, dtype=torch.float64)
        )
        wrench[0, :, 0, 3] = push * profile
        one = torch.ones(1, 1, dtype=torch.float64)
        return pose, twist, wrench, one, friction * one, restitution * one

    return build


def _tumble(steps: int) -> tuple[Tensor, ...]:
    pose, twist, wrench, mass, friction, _ = _one(height=0.2)(steps)
    pose[..., 3:] = torch.nn.functional.normalize(torch.tensor([0.3, -0.2, 0.1, 0.9], dtype=torch.float64), dim=0)
    twist[...] = torch.tensor([1.0, -2.0, 0.5, 0.4, 0.2, -0.5], dtype=torch.float64)
    return pose, twist, wrench, mass, friction, 0.3 + 0 * mass


def _two(offset: float) -> Callable[[int], tuple[Tensor, ...]]:
    def build(steps: int) -> tuple[Tensor, ...]:
        pose = torch.tensor([[[0, 0, 0.1, 0, 0, 0, 1], [0.205, offset, 0.1, 0, 0, 0, 1]]], dtype=torch.float64)
        twist = torch.zeros(1, 2, 6, dtype=torch.float64)
        twist[0, 0, 3] = 0.5
        wrench = torch.zeros(1, steps, 2, 6, dtype=torch.float64)
        wrench[..., 0, 3] = 7.0
        mass = torch.tensor([[1.0, 1.5]], dtype=torch.float64)
        return pose, twist, wrench, mass, torch.full_like(mass, 0.45), torch.zeros_like(mass)

    return build


CASES = (
    Case("slide", 1e-4, _one(push=5.0)),
    Case("stick", 1e-4, _one(push=2.0)),
    Case("stick to slip", 1e-4, _one(push=3.0, ramp=True)),
    Case("drop", 1e-4, _one(height=0.13)),
    Case("drop, restitution 0.5", 1e-4, _one(height=0.13, restitution=0.5)),
    Case("tumble", 1e-3, _tumble),
    Case("two boxes, centred", 1e-3, _two(0.0)),
    Case("two boxes, off centre", 1e-3, _two(0.03)),
)

QUANTITIES = ("mass", "friction", "restitution", "twist", "wrench")


def loss(tensors: dict[str, Tensor], reduce: bool = True) -> Tensor:
    """Return a weighted sum of the final poses and twists of each world, shape (B,) or (); the same weights always."""
    size = torch.full((1, tensors["pose"].shape[1], 3), 0.2, dtype=torch.float64)
    parameters = Parameters.of_boxes(size, tensors["mass"], tensors["friction"], tensors["restitution"])
    layer = PhysicsLayer(World(time_step=TIME_STEP))
    rollout = layer.rollout(State(tensors["pose"], tensors["twist"]), tensors["wrench"], parameters)
    final = torch.cat([rollout.pose[:, -1], rollout.twist[:, -1]], -1).flatten(1)
    weights = torch.cos(torch.arange(final.shape[1], dtype=torch.float64)) + 1.5
    return (final @ weights).sum() if reduce else final @ weights


def gradient_error(case: Case, steps: int, difference: float = 1e-5) -> dict[str, float]:
    """Compare the gradient along one direction per quantity with a central difference.

    Returns:
        |gradient - difference| / max(|difference|, 1e-2) per quantity of QUANTITIES.
    """
    names = ("pose", "twist", "wrench", "mass", "friction", "restitution")
    tensors = dict(zip(names, case.build(steps), strict=True))
    order = {name: tensors[name] for name in names}
    for name in QUANTITIES:
        order[name] = order[name].clone().requires_grad_()
    analytic = torch.autograd.grad(loss(order), [order[name] for name in QUANTITIES])
    copies = {
        name: value.detach().repeat(2 * len(QUANTITIES), *[1] * (value.ndim - 1)) for name, value in order.items()
    }
    generator = torch.Generator().manual_seed(0)
    slopes = []
    for k, (name, gradient) in enumerate(zip(QUANTITIES, analytic, strict=True)):
        direction = torch.rand(gradient.shape[1:], generator=generator, dtype=torch.float64) + 0.5
        if name == "wrench":
            direction = direction * torch.tensor([0, 0, 0, 1.0, 0, 0], dtype=torch.float64)
        if name == "restitution" and not bool(order[name].any()):
            direction = direction * 0
        copies[name][2 * k] += difference * direction
        copies[name][2 * k + 1] -= difference * direction
        slopes.append(float((gradient[0] * direction).sum()))
    values = loss(copies, reduce=False)
    numeric = [float((values[2 * k] - values[2 * k + 1]) / (2 * difference)) for k in range(len(QUANTITIES))]
    return {
        name: abs(slope - number) / max(abs(number), 1e-2)
        for name, slope, number in zip(QUANTITIES, slopes, numeric, strict=True)
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, nargs="+", default=[1, 30, 300])
    steps = parser.parse_args().steps
    print("| case | steps | " + " | ".join(QUANTITIES) + " | worst | required |")
    print("|---|---|" + "---|" * (len(QUANTITIES) + 2))
    for case in CASES:
        for count in steps:
            errors = gradient_error(case, count)
            worst = max(errors.values())
            cells = " | ".join(f"{error:.0e}" for error in errors.values())
            mark = "" if worst <= case.tolerance else " **missed**"
            print(f"| {case.name} | {count} | {cells} | {worst:.0e}{mark} | {case.tolerance:.0e} |", flush=True)


if __name__ == "__main__":
    main()
