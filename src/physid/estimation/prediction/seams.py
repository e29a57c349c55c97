"""What cameras that look at several frames at once report of a prediction whose segments begin anew."""

from __future__ import annotations

from functools import cache

import torch
from torch import Tensor

from physid.effects.probe import draw_probe
from physid.estimation.prediction.step_effects import has, typical
from physid.physics import Effect


def observe_apart(effect: Effect, pose: Tensor, time: Tensor, seams: Tensor) -> Tensor:
    """Return what a camera under an effect reports of poses that jump at the seams between segments.

    A filter that reached across would average what two segments say of the same motion, whose errors are not alike, and
    so predict better without being at work. For it no time passes at a seam: a filter ends before a frame that has the
    time of the one before, and begins anew there.

    Args:
        effect: Of perception, one value for each of B rows or for all.
        pose: Shape (B, T, N, 7).
        time: Of the frames [s], shape (B, T).
        seams: Frames before which a segment ends, shape (B, T).

    Returns:
        Shape (B, T, N, 7).
    """
    if not mixes_frames(type(effect)):
        return effect.observe(pose, time)
    between = torch.nn.functional.pad(time.diff(dim=1), (1, 0))
    shifted = time - torch.where(seams, between, 0.0).cumsum(1)
    # At a seam the time of the frame before, to the last bit: rounding would leave a step that a filter divides by.
    before = torch.where(seams, 0, torch.arange(seams.shape[1], device=seams.device)).cummax(1).values
    return effect.observe(pose, shifted.gather(1, before))


@cache
def mixes_frames(kind: type[Effect]) -> bool:
    """Return whether what a camera reports of a frame depends on other frames, and not by its clock alone."""
    if not has(kind, "observe") or has(kind, "elapse"):
        return False
    effect, probe = typical(kind), draw_probe()
    other, changed = probe.pose.clone(), torch.arange(probe.pose.shape[1]) == probe.pose.shape[1] // 2
    other[:, changed, :, :3] += 1
    apart = effect.observe(probe.pose, probe.time) != effect.observe(other, probe.time)
    return bool(apart[:, ~changed].any())
