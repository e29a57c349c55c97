"""Small recordings that the tests of this folder share."""

from pathlib import Path

import numpy as np

from physid.data import Recording, trajectory_path, write_scene, write_sums, write_trajectory
from physid.scenes import Scene, find_setup

FRAMES, SIZE = 8, 16
SCENE = find_setup("push").scene


def recording(frames: int = FRAMES, seed: int = 0, split: str | None = "train", video: bool = False) -> Recording:
    """Return a random but valid trajectory of one body in the middle of the view."""
    generator = np.random.default_rng(seed)
    quaternion = generator.normal(size=(frames, 1, 4))
    quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
    mask = np.zeros((1, SIZE, SIZE), dtype=bool)
    mask[0, 4:8, 4:8] = True
    images = {
        "frames": generator.integers(0, 255, (frames, SIZE, SIZE, 3), dtype=np.uint8),
        "mask": mask,
        "background": generator.integers(0, 255, (SIZE, SIZE, 3), dtype=np.uint8),
    }
    return Recording(
        pose=np.concatenate([generator.uniform(-0.5, 0.5, (frames, 1, 3)), quaternion], -1),
        wrench=generator.normal(size=(frames, 1, 6)),
        twist=generator.normal(size=(frames, 1, 6)),
        split=split,
        protocol="paper",
        **images if video else {},
    )


def write_set(folder: Path, recordings: list[Recording], scene: Scene = SCENE) -> Path:
    """Write a recording set and return its folder."""
    write_scene(folder, scene)
    for index, each in enumerate(recordings):
        write_trajectory(trajectory_path(folder, index), each)
    write_sums(folder)
    return folder
