"""Noise of trackers that is alike in neighbouring frames, as a fit shows it."""

from __future__ import annotations

from torch import Tensor

from physid.estimation.measurement import CorrelatedNoise, NoiseSettings, correlated_noise, pose_difference
from physid.scenes import Scene
from physid.training.parameters import Trajectories


def noise_of_tracker(predicted: Tensor, cut: Trajectories, scene: Scene) -> CorrelatedNoise | None:
    """Return the noise of poses where it is alike in neighbouring frames; None where it is white, and of films.

    Args:
        predicted: Poses that a fit predicts, shape (B, T, N, 7).
        cut: What they are fitted to.
        scene: The time from frame to frame, and the ground.
    """
    if cut.again is not None:
        return None
    cut, predicted = cut.to("cpu"), predicted.detach().cpu().double()
    good = cut.real[..., None].expand(cut.pose.shape[:3])
    residual, up = pose_difference(cut.pose, predicted), scene.ground.normal
    return correlated_noise(residual, predicted, good, scene.time_step, up, NoiseSettings())
