"""What cameras that look at several frames at once report of a prediction whose segments begin anew."""

from __future__ import annotations

from functools import cache

import torch
from torch import Tensor

from physid.effects.probe import draw_probe
from physid.estimation.prediction.step_effects import has, with_values
from physid.physics import Effect


def observed(effect: Effect, pose: Tensor, time: Tensor, begins: Tensor) -> Tensor:
    """Return what a camera under an effect reports of poses that jump where segments begin.

    A filter that reached across would average what two segments say of the same motion, whose errors are not alike, and
    so predict better without being at work. It is told that no time passes there, which is where filters end and begin.

    Args:
        effect: Of perception, one value for each of B rows or for all.
        pose: Shape (B, T, N, 7).
        time: Of the frames [s], shape (B, T).
        begins: Frames at which a segment begins, shape (B, T).

    Returns:
        Shape (B, T, N, 7).
    """
    if not mixes_frames(type(effect)):
        return effect.observe(pose, time)
    between = torch.nn.functional.pad(time.diff(dim=1), (1, 0))
    return effect.observe(pose, time - torch.where(begins, between, 0.0).cumsum(1))


@cache
def mixes_frames(kind: type[Effect]) -> bool:
    """Return whether what a camera reports of a frame depends on other frames, and not by its clock alone."""
    if not has(kind, "observe") or has(kind, "elapse"):
        return False
    typical = torch.tensor([[one.typical for one in kind.quantities().values()]], dtype=torch.float64)
    effect, probe = with_values(kind, typical), draw_probe()
    other, changed = probe.pose.clone(), torch.arange(probe.pose.shape[1]) == probe.pose.shape[1] // 2
    other[:, changed, :, :3] += 1
    apart = effect.observe(probe.pose, probe.time) != effect.observe(other, probe.time)
    return bool(apart[:, ~changed].any())
