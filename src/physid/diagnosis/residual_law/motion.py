"""Of what a residual law may be made: directions of the motion, and variables that it may depend on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from physid.effects.motion import across, course, course_from_body, from_origin, unit
from physid.estimation.prediction import Prediction, Timeline

Kind = Literal["force", "torque", "shift"]
Region = Literal["everywhere", "in contact", "in flight"]


@dataclass(frozen=True)
class Direction:
    """Along what something acts.

    Attributes:
        name: As it is said: "across the velocity".
        kind: A force, a torque, or a shift of reported positions.
        value: Unit vectors, in the last three of six components of a force or shift, in the first three of a torque;
            zero where there is no such direction, shape (R, T, N, 6). A shift away from the origin grows with the
            distance from there, and has length one at 1 m.
        commanded: Whether it is that of the command.
        rubs: Whether it is that of a friction.
    """

    name: str
    kind: Kind
    value: Tensor
    commanded: bool = False
    rubs: bool = False


@dataclass(frozen=True)
class Variable:
    """On what its size may depend.

    Attributes:
        name: As it is said: "speed".
        unit: Of its values.
        value: Shape (R, T, N).
        defined: Where it has one, shape (R, T, N).
        commanded: Whether it is the command.
        swings: Whether sizes may rise and fall with it many times, as with time.
    """

    name: str
    unit: str
    value: Tensor
    defined: Tensor
    commanded: bool = False
    swings: bool = False


def directions_of(
    prediction: Prediction, timeline: Timeline, frame: Tensor, planar: bool, still: float
) -> list[Direction]:
    """List directions: of the ground, of the velocity, of the command, of the spin.

    Args:
        prediction: What the model says, a single variant.
        timeline: What was commanded.
        frame: Axes of the ground (tangent, tangent, normal) as rows, shape (3, 3).
        planar: Whether bodies stay on the ground.
        still: Speed below which a velocity has no direction [m/s].
    """
    twist, command, place = prediction.twist[0], timeline.wrench[..., 3:], prediction.state[0, ..., :3]
    spin, velocity = twist[..., :3], twist[..., 3:]
    up = frame[2].expand_as(velocity)
    none = torch.zeros_like(up)
    axes = [(f"along {name}", axis.expand_as(velocity)) for name, axis in zip("xyz", frame, strict=True)]
    axes = axes[:2] if planar else axes

    def force(name: str, value: Tensor, commanded: bool = False, rubs: bool = False) -> Direction:
        return Direction(name, "force", torch.cat([none, value], -1), commanded, rubs)

    return [
        *(force(name, value) for name, value in axes),
        force("along the velocity", unit(velocity, still), rubs=planar),
        force("across the velocity", across(velocity, frame[2], still)),
        force("along the command", unit(command), commanded=True),
        force("across the command", across(command, frame[2]), commanded=True),
        Direction("about the vertical", "torque", torch.cat([up, none], -1)),
        Direction("along the spin", "torque", torch.cat([unit(spin), none], -1), rubs=planar),
        *(Direction(name, "shift", torch.cat([none, value], -1)) for name, value in axes),
        Direction("away from the origin", "shift", torch.cat([none, from_origin(place, frame[2])], -1)),
    ]


def variables_of(
    prediction: Prediction, timeline: Timeline, frame: Tensor, planar: bool, still: float
) -> list[Variable]:
    """List variables: place, speed, direction of the motion, command, spin, time; see `directions_of`."""
    state, twist = prediction.state[0], prediction.twist[0]
    position, velocity = state[..., :3] @ frame.T, twist[..., 3:] @ frame.T
    always = torch.ones_like(twist[..., 0], dtype=torch.bool)
    moving = velocity[..., :2].norm(dim=-1) > still
    time = (timeline.time - timeline.time[:, :1])[..., None].expand(always.shape)
    places = [Variable(name, "m", position[..., k], always) for k, name in enumerate(("x", "y", "height"))]
    return [
        *(places[:2] if planar else places),
        Variable("speed", "m/s", velocity.norm(dim=-1), always),
        Variable("course", "deg", course(twist[..., 3:], frame), moving),
        Variable("course seen from the body", "deg", course_from_body(state[..., 3:], twist[..., 3:], frame), moving),
        Variable("commanded force", "N", timeline.wrench[..., 3:].norm(dim=-1), always, commanded=True),
        Variable("spin", "rad/s", twist[..., :3].norm(dim=-1), always),
        Variable("time", "s", time, always, swings=True),
    ]
