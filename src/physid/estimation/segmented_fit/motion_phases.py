"""What a body is doing at each frame: falling, hitting, sticking, sliding, coasting, being switched."""

from __future__ import annotations

import torch
from torch import Tensor

from physid.estimation.prediction import Prediction, Timeline
from physid.estimation.segmented_fit.settings import PhaseSettings
from physid.physics.contact import PATCH
from physid.scenes import Scene

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


def phases_of(prediction: Prediction, timeline: Timeline, scene: Scene, settings: PhaseSettings) -> Tensor:
    """Name what each body does at each frame, as poses show it.

    Poses show an impact, or a contact between bodies, in the frames after it alone: it lasts `impact_time`, and
    `impact_frames` at least, however slow the camera. A frame without a step of its own, the last one of a segment,
    continues the one before; so does the first frame of a flight.

    Args:
        prediction: A single variant.
        timeline: Times of the frames, and commanded wrenches.
        scene: Gravity, time step, and the masses that were predicted with: a first guess of half a mass would make each
            resting weight an impact.
        settings: What is still, slow, light, hard, and how long an impact lasts.

    Returns:
        Codes of PHASES, shape (R, T, N).
    """
    lasting = max(settings.impact_frames, _impact_steps(scene, settings))
    return _phases(prediction, timeline, scene, settings, lasting, continued=True)


def phases_of_steps(prediction: Prediction, timeline: Timeline, scene: Scene, settings: PhaseSettings) -> Tensor:
    """Name what each body does in the step from each frame to the next (see `phases_of`).

    An impact lasts `impact_time` alone: what acts in the steps after it is no part of it, though a slow camera hardly
    distinguishes them.
    """
    return _phases(prediction, timeline, scene, settings, _impact_steps(scene, settings), continued=False)


def _impact_steps(scene: Scene, settings: PhaseSettings) -> int:
    """Return how many steps from frame to frame an impact lasts after that in which it falls."""
    return round(settings.impact_time / scene.time_step)


def _phases(
    prediction: Prediction, timeline: Timeline, scene: Scene, settings: PhaseSettings, lasting: int, continued: bool
) -> Tensor:
    """Name what each body does; an impact lasts for so many frames after that in which it falls.

    With `continued` a frame without a contact continues the one before it.
    """
    bodies = len(scene.bodies)
    wrench = timeline.wrench
    mass = torch.tensor([body.mass for body in scene.bodies], dtype=wrench.dtype)
    length = timeline.time.diff(dim=1, append=timeline.time[:, -1:] + scene.time_step).clamp_min(1e-9)
    weight = mass * torch.tensor(scene.gravity, dtype=wrench.dtype).norm() * length[..., None]
    normal = prediction.impulse[0].unflatten(-1, (-1, PATCH)).sum(-1)
    ground, between = normal[..., :bodies] / weight, _touching_others(normal, bodies)
    if continued:
        previous = torch.nn.functional.pad(ground[:, :-1], (0, 0, 1, 0))
        blank = normal.sum(-1, keepdim=True) == 0
        ground = torch.where(blank & (previous > settings.light), previous, ground)
    speed = prediction.twist[0, ..., 3:].norm(dim=-1)
    spin = prediction.twist[0, ..., :3].norm(dim=-1)
    pushed = wrench.norm(dim=-1) > 1e-9
    still = (speed < settings.still_speed) & (spin < settings.still_spin)
    code = torch.where(speed < settings.slow, PHASES.index("slide_slow"), PHASES.index("slide_fast"))
    code = torch.where(~pushed, PHASES.index("coast"), code)
    code = torch.where(still, torch.where(pushed, PHASES.index("stick"), PHASES.index("rest")), code)
    code = torch.where(_switched(wrench, scene.time_step, settings), PHASES.index("force_switch"), code)
    code = torch.where(ground < settings.light, PHASES.index("free_fall"), code)
    hit = (ground - 1) * weight / mass > settings.hard
    code = torch.where(_spread(hit, lasting), PHASES.index("impact"), code)
    touching = _spread(between / weight > settings.light, lasting)
    return torch.where(touching, PHASES.index("contact_between_objects"), code)


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


def _switched(wrench: Tensor, time_step: float, settings: PhaseSettings) -> Tensor:
    """Find the frames during and shortly after large changes of the command, shape (R, T, N).

    Each trajectory is judged by itself: beside one that is pushed now and then, another may follow a noise.
    """
    change = torch.zeros_like(wrench[..., 0])
    change[:, 1:] = (wrench[:, 1:] - wrench[:, :-1]).norm(dim=-1)
    largest = wrench.norm(dim=-1).amax((1, 2), keepdim=True).clamp_min(1e-9)
    jumps = change > settings.switch * largest
    jumps = jumps & (jumps.double().mean((1, 2), keepdim=True) <= settings.rare)
    return _spread(jumps, max(1, round(settings.switch_time / time_step)))


def _spread(mask: Tensor, frames: int) -> Tensor:
    """Extend what is true (R, T, N) over the next frames."""
    wide = mask.clone()
    for k in range(1, frames + 1):
        wide[:, k:] |= mask[:, :-k]
    return wide
