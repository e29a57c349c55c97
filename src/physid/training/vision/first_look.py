"""What is learned before a fit, from first frames: what the bodies look like, and how exactly they are found."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physid.data import RecordingSet
from physid.networks import as_image
from physid.training.vision.drawing.decoder import Decoder
from physid.training.vision.model import VideoModel

MODELS = 16
"""First frames that the appearance is cut from: enough to see every side of every body in some of them."""


def look_at(model: VideoModel, recordings: RecordingSet, trajectories: Sequence[int]) -> None:
    """Teach a model the look of the bodies (see `learn_look`), and calibrate it by how exactly they are found."""
    pose, image, background = learn_look(model.decoder, recordings, trajectories)
    found = model.pose_refinement(model.chart, model.decoder, pose, image, background)
    model.calibration.measure(model.decoder.renderer.camera, found[:, 0], pose[:, 0], offset=True)


def learn_look(
    decoder: Decoder, recordings: RecordingSet, trajectories: Sequence[int]
) -> tuple[Tensor, Tensor, Tensor]:
    """Cut the look of the bodies out of the first frames of some trajectories, by their masks and initial poses.

    The paper takes shape and appearance of the objects as known in the same way; no other pose is inspected.

    Args:
        decoder: Takes the look.
        recordings: The set.
        trajectories: Which of its trajectories; the first 16 are used.

    Returns:
        What it inspected: poses (M, 1, N, 7), images (M, 1, 3, H, W) and backgrounds (M, 3, H, W).

    Raises:
        ValueError: If a trajectory has no poses, or a mask does not lie where the initial pose says.
    """
    chosen = trajectories[:MODELS]
    films = [recordings.film(index, [0]) for index in chosen]
    frame, mask, background = (torch.stack([torch.from_numpy(film[place]) for film in films]) for place in range(3))
    poses = [recordings.read(index).pose for index in chosen]
    pose = torch.stack([torch.from_numpy(one[0]) for one in poses if one is not None])
    if len(pose) < len(chosen):
        raise ValueError(f"{recordings.folder}: pose: expected initial poses to cut out the bodies' faces, found none")
    try:
        decoder.cut(as_image(frame[:, 0]), mask, pose)
    except ValueError as error:
        names = ", ".join(recordings.paths[index].name for index in chosen)
        raise ValueError(f"{recordings.folder}: {error} (samples in order: {names})") from None
    like = decoder.patches
    return pose[:, None].to(like), as_image(frame).to(like), as_image(background).to(like)
