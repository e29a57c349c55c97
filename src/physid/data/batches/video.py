"""What a video must have before anything learns from it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from physid.data import RecordingSet
from physid.scenes import Scene

LEAST_PIXELS = 4  # a body of fewer pixels cannot be cut out


def check_video(recordings: RecordingSet, trajectories: Sequence[int]) -> None:
    """Check that trajectories have a usable video: camera, frames of its size, masks, every body in view.

    Args:
        recordings: The set.
        trajectories: Which of its trajectories, by index.

    Raises:
        ValueError: If something is missing; the message names the trajectory and what to do.
    """
    scene = recordings.scene
    if scene.camera is None:
        raise ValueError(
            f"{recordings.folder / 'recording.yaml'}: camera: expected a camera for learning from video, found null; "
            f"give its width, height, position, target, up and fov_y, or generate the set with video=true"
        )
    for index in trajectories:
        try:
            _check_one(recordings, index, scene)
        except ValueError as error:
            message = str(error)
            path = str(recordings.paths[index])
            raise ValueError(message if message.startswith(path) else f"{path}: {message}") from None


def _check_one(recordings: RecordingSet, index: int, scene: Scene) -> None:
    """Check the video of one trajectory."""
    frames, mask, background = recordings.film(index, [0])
    camera = scene.camera
    assert camera is not None
    wanted = (camera.height, camera.width, 3)
    for name, image in (("frames", frames[0]), ("background", background)):
        if image.shape != wanted:
            raise ValueError(f"{name}: expected images of {wanted} as the camera says, found {image.shape}")
    if (frames[0] == frames[0, 0, 0]).all():  # whatever the mask says: no pose can be read from there on
        raise ValueError(
            "frames: expected the bodies in the first frame, found a picture of one colour; start the film with every "
            "body in view"
        )
    if mask.shape != (len(scene.bodies), *wanted[:2]):
        raise ValueError(f"mask: expected shape {(len(scene.bodies), *wanted[:2])}, found {mask.shape}")
    for body, shape in zip(scene.bodies, mask, strict=True):
        if shape.sum() < LEAST_PIXELS:
            raise ValueError(
                f"mask: expected {body.name} in the first frame, found {int(shape.sum())} pixels of it; "
                f"start the recording with every body in view"
            )
    both = int((mask.sum(0) > 1).sum())
    if both:
        raise ValueError(
            f"mask: expected bodies apart in the first frame, found {both} pixels that show two of them; "
            f"start the recording with the bodies apart"
        )
    _check_view(recordings, index, scene)


def _check_view(recordings: RecordingSet, index: int, scene: Scene) -> None:
    """Check that no body's centre leaves the image, where poses are there."""
    camera = scene.camera
    if camera is None or not recordings.has_poses(index):
        return
    pose = recordings.read(index).pose
    assert pose is not None
    image = camera.project(pose[..., :3])
    column, row, depth = np.moveaxis(image, -1, 0)
    outside = (column < 0) | (column > camera.width) | (row < 0) | (row > camera.height) | (depth <= 0)
    if outside.any():
        frame, body = (int(one) for one in np.argwhere(outside)[0])
        raise ValueError(
            f"pose: expected {scene.bodies[body].name} in view, found it outside the image in frame {frame}; "
            f"cut the recording there, or move the camera back"
        )
