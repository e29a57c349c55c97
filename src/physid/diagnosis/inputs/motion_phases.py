"""What a body is doing at each frame: falling, hitting, sticking, sliding, coasting, being switched."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.estimation.prediction.rollout import Prediction
from physid.estimation.prediction.timeline import Timeline
from physid.physics.contact import PATCH
from physid.scenes.scene import Scene

PHASES = (
    "rest",
    "stick",
    "slide_slow",
    "slide_fast",
    "coast",
    "force_switch",
    "impact",
    "contact_between_objects",
    "free_fall",
)
"""Names of the phases; the index is their code."""

STILL = 0.01  # [m/s]
SLOW = 0.3  # [m/s]
STILL_SPIN = 0.05  # [rad/s]
LIGHT = 0.02  # share of its weight below which a contact does not carry a body
HARD = 3.0  # multiple of its weight from which on a contact is an impact
SWITCH = 0.3  # a change of a command by more than this share of the largest is a switch ...
SWITCH_TIME = 0.02  # [s] ... and this long the body is being switched
RARE = 0.2  # if more than this share of frames were switches, the command is noise and none is


def phases_of(prediction: Prediction, timeline: Timeline, scene: Scene) -> Tensor:
    """Name what each body does at each frame.

    Args:
        prediction: A single variant.
        timeline: Times of the frames, and commanded wrenches.
        scene: Masses, gravity, time step.

    Returns:
        Codes of PHASES, shape (R, T, N).
    """
    bodies = len(scene.bodies)
    wrench = timeline.wrench
    weight = torch.tensor([body.mass for body in scene.bodies], dtype=wrench.dtype)
    length = timeline.time.diff(dim=1, append=timeline.time[:, -1:] + scene.time_step).clamp_min(1e-9)
    weight = weight * torch.tensor(scene.gravity, dtype=wrench.dtype).norm() * length[..., None]
    normal = prediction.impulse[0].unflatten(-1, (-1, PATCH)).sum(-1)
    ground, between = normal[..., :bodies] / weight, _touching_others(normal, bodies)
    # The last frame of a segment has no step after it and continues the one before.
    blank = normal.sum(-1) == 0
    previous = torch.roll(ground, 1, 1)
    ground = torch.where(blank[..., None] & (previous > LIGHT), previous, ground)
    speed = prediction.twist[0, ..., 3:].norm(dim=-1)
    spin = prediction.twist[0, ..., :3].norm(dim=-1)
    pushed = wrench.norm(dim=-1) > 1e-9
    still = (speed < STILL) & (spin < STILL_SPIN)
    code = torch.where(speed < SLOW, PHASES.index("slide_slow"), PHASES.index("slide_fast"))
    code = torch.where(~pushed, PHASES.index("coast"), code)
    code = torch.where(still, torch.where(pushed, PHASES.index("stick"), PHASES.index("rest")), code)
    code = torch.where(_switched(wrench, scene.time_step), PHASES.index("force_switch"), code)
    code = torch.where(ground < LIGHT, PHASES.index("free_fall"), code)
    code = torch.where(_spread(ground > HARD, 2), PHASES.index("impact"), code)
    return torch.where(_spread(between / weight > LIGHT, 2), PHASES.index("contact_between_objects"), code)


def _touching_others(normal: Tensor, bodies: int) -> Tensor:
    """Sum the impulses between bodies that each body takes part in, shape (R, T, N)."""
    total = torch.zeros_like(normal[..., :bodies])
    pair = bodies
    for a in range(bodies):
        for b in range(a + 1, bodies):
            total[..., a] += normal[..., pair]
            total[..., b] += normal[..., pair]
            pair += 1
    return total


def _switched(wrench: Tensor, time_step: float) -> Tensor:
    """Find the frames during and shortly after large changes of the command, shape (R, T, N)."""
    change = torch.zeros_like(wrench[..., 0])
    change[:, 1:] = (wrench[:, 1:] - wrench[:, :-1]).norm(dim=-1)
    largest = wrench.norm(dim=-1).amax().clamp_min(1e-9)
    jumps = change > SWITCH * largest
    if float(jumps.double().mean()) > RARE:
        return torch.zeros_like(jumps)
    return _spread(jumps, max(1, round(SWITCH_TIME / time_step)))


def _spread(mask: Tensor, frames: int) -> Tensor:
    """Extend what is true (R, T, N) over the next frames."""
    wide = mask.clone()
    for k in range(1, frames + 1):
        wide[:, k:] |= mask[:, :-k]
    return wide
