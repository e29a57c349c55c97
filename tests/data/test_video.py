"""A video that nothing can be learned from is refused before any training, with the trajectory and the remedy."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.data.sets import SCENE, SIZE, recording, write_set

from physid.data import Recording
from physid.data.batches.datamodule import RecordingsDataModule

CAMERA = dataclasses.replace(SCENE.camera, width=SIZE, height=SIZE) if SCENE.camera else None


def empty_mask(good: Recording) -> Recording:
    return dataclasses.replace(good, mask=np.zeros((1, SIZE, SIZE), dtype=bool))


def lens_cap(good: Recording) -> Recording:
    assert good.frames is not None
    return dataclasses.replace(good, frames=np.zeros_like(good.frames))


def far_away(good: Recording) -> Recording:
    assert good.pose is not None
    pose = good.pose.copy()
    pose[3, 0, 0] = 9.0
    return dataclasses.replace(good, pose=pose)


def no_masks(good: Recording) -> Recording:
    return dataclasses.replace(good, mask=None)


def no_video(good: Recording) -> Recording:
    return dataclasses.replace(good, frames=None, mask=None, background=None)


def small_frames(good: Recording) -> Recording:
    assert good.frames is not None
    assert good.background is not None
    return dataclasses.replace(good, frames=good.frames[:, :8, :8], background=good.background[:8, :8], mask=None)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (no_video, "frames: expected it for learning from video, found none; record it, or generate"),
        (no_masks, "mask: expected it for learning from video, found none"),
        (empty_mask, "mask: expected block in the first frame, found 0 pixels of it; start the recording with every"),
        (lens_cap, "frames: expected the bodies in the first frame, found a picture of one colour"),
        (far_away, "pose: expected block in view, found it outside the image in frame 3; cut the recording there"),
    ],
)
def test_a_bad_video_is_refused(tmp_path: Path, spoil: Callable[[Recording], Recording], message: str) -> None:
    good = recording(video=True)
    scene = dataclasses.replace(SCENE, camera=CAMERA)
    folder = write_set(tmp_path, [good, spoil(good)], scene)
    with pytest.raises(ValueError, match=f"000001.h5: {message}"):
        RecordingsDataModule(folder, video="all").setup("fit")


def test_frames_of_another_size_than_the_cameras_are_refused(tmp_path: Path) -> None:
    folder = write_set(tmp_path, [recording(video=True)])
    with pytest.raises(ValueError, match=r"frames: expected images of \(128, 128, 3\) as the camera says, found"):
        RecordingsDataModule(folder, video="all").setup("fit")


def test_bodies_that_overlap_in_the_first_frame_are_refused(tmp_path: Path) -> None:
    good = recording(video=True)
    doubled = {
        name: np.repeat(array, 2, axis=1)
        for name, array in good.arrays().items()
        if name in ("pose", "wrench", "twist")
    }
    assert good.mask is not None
    both = dataclasses.replace(good, **doubled, mask=np.repeat(good.mask, 2, axis=0))
    bodies = [SCENE.bodies[0], dataclasses.replace(SCENE.bodies[0], name="other")]
    scene = dataclasses.replace(SCENE, camera=CAMERA).with_bodies(bodies)
    folder = write_set(tmp_path, [both], scene)
    with pytest.raises(ValueError, match="expected bodies apart in the first frame, found 16 pixels"):
        RecordingsDataModule(folder, video="all").setup("fit")


def test_a_set_without_a_camera_is_refused(tmp_path: Path) -> None:
    folder = write_set(tmp_path, [recording(video=True)], dataclasses.replace(SCENE, camera=None))
    with pytest.raises(ValueError, match=r"recording.yaml: camera: expected a camera for learning from video"):
        RecordingsDataModule(folder, video="all").setup("fit")
