"""How far steps of the engine put a block wrong that friction stops and a push drives back.

    python benchmarks/reversals.py

Sixteen blocks of 0.55 to 0.75 m/s, friction 0.2, are pushed back by 5 m/s^2 for a second. Printed is the deviation from
the limit of short steps (7680 a second) at the end, root of the mean square over the blocks [mm], by steps a second.
"""

from __future__ import annotations

import torch
from torch import Tensor

from physid.physics import Parameters, PhysicsLayer, State, World
from physid.physics.schemes.integration import Midpoint

CASES = ((0.0, 0.0, 0.0), (0.002, 0.0, 0.0), (0.02, 0.0, 0.0), (0.2, 0.0, 0.0), (0.02, 1.0, 0.0), (0.0, 0.0, 1.0))
CASES += ((0.0, 0.0, 5.0), (0.05, 1.0, 1.0))
"""Slip across the push [m/s], push across it [m/s^2], spin [rad/s]."""
RATES, LIMIT, BLOCKS = (30, 60, 120, 240, 960), 7680, 16


def ends(rate: int, across: float, aside: float, spin: float) -> Tensor:
    """Return where the blocks are after a second, (B, 3)."""
    pose = torch.tensor([0, 0, 0.1, 0, 0, 0, 1], dtype=torch.float64).expand(BLOCKS, 1, 7)
    twist = torch.zeros(BLOCKS, 1, 6, dtype=torch.float64)
    twist[:, 0, 2], twist[:, 0, 4] = spin, across
    twist[:, 0, 3] = torch.linspace(0.55, 0.75, BLOCKS)
    push = torch.zeros(BLOCKS, rate, 1, 6, dtype=torch.float64)
    push[..., 3], push[..., 4] = -5.0, aside
    one = torch.ones(1, 1, dtype=torch.float64)
    blocks = Parameters.of_boxes(0.2 * one[..., None].expand(-1, -1, 3), one, 0.2 * one)
    layer = PhysicsLayer(World(time_step=1 / rate, integration=Midpoint()))
    with torch.no_grad():
        return layer.rollout(State(pose, twist), push, blocks).pose[:, -1, 0, :3]


def main() -> None:
    """Print one line per case."""
    print("| across [m/s] | aside [m/s^2] | spin [rad/s] | " + " | ".join(map(str, RATES)) + " |")
    print("|---:" * (3 + len(RATES)) + "|")
    for case in CASES:
        limit = ends(LIMIT, *case)
        errors = (1e3 * (ends(rate, *case) - limit).norm(dim=-1).square().mean().sqrt() for rate in RATES)
        shown = " | ".join(f"{float(error):.2g}" for error in errors)
        print(f"| {case[0]:g} | {case[1]:g} | {case[2]:g} | {shown} |", flush=True)


if __name__ == "__main__":
    main()
