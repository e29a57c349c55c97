"""What the compiled rollout is given: inputs packed into arrays, the constants of a world, groups of worlds."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from physid.compiler.emit import LANES
from physid.physics.contact import Speculative, Split
from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.effect import StepInputs, widths_of
from physid.physics.fused.formulas.layouts import CONSTANTS, OF_BODY, OF_WORLD
from physid.physics.fused.records import Shape
from physid.physics.guards.made_once import made_once
from physid.physics.world import World


@dataclass(frozen=True)
class Inputs:
    """What enters the steps of a rollout beside states and wrenches; a first axis of length 1 stands for all worlds.

    Attributes:
        bodies: The fields of `StepInputs` of each body, shape (B or 1, N, 18).
        shared: Ground normal and offset, friction and restitution between bodies, shape (B or 1, 6).
    """

    bodies: Tensor
    shared: Tensor

    @classmethod
    def of(cls, inputs: StepInputs) -> Inputs:
        """Pack inputs."""
        worlds, count = inputs.mass.shape
        bodies = torch.cat([getattr(inputs, name).reshape(worlds, count, -1) for name in OF_BODY], -1)
        ground = {name: getattr(inputs, name).expand(worlds, width) for name, width in widths_of("ground").items()}
        world = {name: getattr(inputs, name).reshape(worlds, -1) for name in widths_of("world")}
        shared = torch.cat([(ground | world)[name] for name in OF_WORLD], 1)
        return cls(bodies, shared)


def stepwise(world: World) -> World:
    """Return a world with a frame after each step."""
    return dataclasses.replace(world, time_step=world.step, substeps=1)


def shape_of(world: World, bodies: int) -> Shape:
    """Return what kernels are compiled for."""
    return Shape(bodies, world.ground is not None, isinstance(world.contact, Split), world.midpoint)


@made_once
def constants_of(world: World, settings: SolverSettings, shape: Shape) -> Tensor:
    """Return the numbers that every step of a world takes, one column for each lane."""
    rule, ladder = world.contact, list(settings.compliance)
    if len(ladder) > CONSTANTS.widths["ladder"]:
        raise ValueError(f"solver.compliance must have at most {CONSTANTS.widths['ladder']} values, got {len(ladder)}")
    values = {
        "step": [world.step],
        "single_step": [world.single_step or 0.0],
        "unit": [world.velocity_unit],
        "gyroscopic": [float(world.gyroscopic)],
        "speculative": [float(isinstance(rule, Speculative))],
        "split": [float(isinstance(rule, Split))],
        "correction": [1.0 if world.midpoint else rule.correction],
        "speed_limit": [getattr(rule, "speed_limit", 0.0)],
        "slop": [rule.slop],
        "tau": [settings.tau(torch.float64)],
        "accepted": [settings.residual(torch.float64)],
        "max_steps": [float(settings.max_steps)],
        "rungs": [float(len(ladder))],
        "pairs": [12.0 * shape.patches],
        "ladder": ladder + ladder[-1:] * (CONSTANTS.widths["ladder"] - len(ladder)),
    }
    row = [number for name in CONSTANTS.widths for number in values[name]]
    return torch.tensor(row, dtype=torch.float64)[:, None].repeat(1, LANES)


def by_group(lengths: Tensor | None, worlds: int, frames: int) -> Tensor:
    """Return how many frames the worlds that are computed together need, shape (B / LANES,), from those of each."""
    if lengths is None:
        return torch.full((-(-worlds // LANES),), frames)
    padded = torch.cat([lengths.to(torch.int64), torch.zeros(-worlds % LANES, dtype=torch.int64)])
    longest: Tensor = padded.unflatten(0, (-1, LANES)).amax(1)
    return longest


def lanes_of(worlds: int) -> int:
    """Return how many worlds there is room for where whole groups are computed together."""
    return -(-worlds // LANES) * LANES


def memory_size(world: World, pose: Tensor) -> int:
    """Return how many numbers a step of worlds with some poses (B, N, 7) leaves to the next one (see `roll`)."""
    return lanes_of(len(pose)) * shape_of(world, pose.shape[1]).memory
