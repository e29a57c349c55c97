"""Contact with the ground as smooth measures: does a body touch, how hard does it press, how fast does it slip."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.physics import State, StepInputs
from physid.physics.shapes.table import reach

NEAR = 1e-3  # [m] a body at most this far away touches; bodies at rest stay within 0.01 mm in both engines
FAR = 3e-3  # [m] a body at least this far away does not


def lowest_gap(state: State, inputs: StepInputs) -> Tensor:
    """Compute the distance of each body from the ground, n . p - offset - reach, of a box sum_i |n . a_i| s_i / 2.

    Returns:
        Gaps of the lowest point, negative in overlap [m], shape (B, N).
    """
    height = reach(inputs.shapes, state.quaternion, inputs.size, inputs.ground_normal)
    return state.position @ inputs.ground_normal - inputs.ground_offset - height


def touching(state: State, inputs: StepInputs) -> Tensor:
    """Measure whether each body touches the ground: 1 below a gap of 1 mm, 0 above 3 mm, t^2 (3 - 2 t) between.

    Returns:
        Shape (B, N).
    """
    t = ((FAR - lowest_gap(state, inputs)) / (FAR - NEAR)).clamp(0, 1)
    return t**2 * (3 - 2 * t)


def normal_load(inputs: StepInputs) -> Tensor:
    """Compute how hard weight and forces press each body to the ground, N = max(0, -(m g + f) . n).

    Returns:
        Loads [N], shape (B, N).
    """
    force = inputs.mass[..., None] * inputs.gravity + inputs.wrench[..., 3:]
    return (-(force @ inputs.ground_normal)).clamp_min(0)


def grain(x: Tensor, y: Tensor, square: Tensor, along: Tensor, oblique: Tensor) -> Tensor:
    """Compute the factor of friction over a grain, 1 + a cos 2p + b sin 2p.

    Args:
        x: Slip along the first axis of the grain, |v| cos p, shape (B, N) [m/s].
        y: Slip along the second axis, |v| sin p, shape (B, N) [m/s].
        square: Speed of slip by which the heading is normed, squared, shape (B, N) [m^2/s^2].
        along: a, shape (B,).
        oblique: b, shape (B,).

    Returns:
        Shape (B, N).
    """
    factor: Tensor = 1 + along[:, None] * (x**2 - y**2) / square + oblique[:, None] * 2 * x * y / square
    return factor


def slip(state: State, inputs: StepInputs) -> Tensor:
    """Compute how fast each body slips over the ground, below its centre.

    That is v + w x r without its normal part, with r from the centre down to the ground.

    Returns:
        Shape (B, N, 3), world frame [m/s].
    """
    normal = inputs.ground_normal
    height = state.position @ normal - inputs.ground_offset
    # Without a ground there is nothing to slip over, and an infinite lever would make a number that is none.
    height = torch.where(height.isfinite(), height, torch.zeros_like(height))
    lever = -height[..., None] * normal
    velocity = state.velocity + torch.linalg.cross(state.angular_velocity, lever)
    across: Tensor = velocity - (velocity @ normal)[..., None] * normal
    return across
