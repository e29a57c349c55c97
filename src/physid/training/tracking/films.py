"""Films, from the disk or drawn: what a reader of poses looks at."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import final

import numpy as np
import torch
from numpy.typing import NDArray

from physid.data import Recording, RecordingSet
from physid.data.batches.video import check_video
from physid.scenes import Scene
from physid.simulators.filming import open_studio
from physid.training.vision import CastShadow, camera_of

Image = NDArray[np.uint8]
FirstSight = tuple[Image, NDArray[np.bool_], Image]


@final
@dataclass(frozen=True)
class Filmed:
    """What is known of a filmed trajectory, beside the film.

    Attributes:
        length: Frames.
        first: Poses in the first frame, shape (N, 7); None where none is known.
        wrench: Commanded wrenches (T, N, 6), or None.
        time: Of each frame, or None.
        wrench_time: Of each row of the wrenches, or None.
        split: What it is for.
        protocol: How it was excited.
    """

    length: int
    first: NDArray[np.float64] | None
    wrench: NDArray[np.float64] | None
    time: NDArray[np.float64] | None
    wrench_time: NDArray[np.float64] | None
    split: str | None
    protocol: str | None

    @classmethod
    def of(cls, recordings: RecordingSet, index: int) -> Filmed:
        """Read trajectory `index` of a set, its poses beyond the first frame left aside."""
        one = recordings.read(index, blank=True)
        first = None if one.pose is None else one.pose[0]
        return cls(one.length, first, one.wrench, one.time, one.wrench_time, one.split, one.protocol)

    def with_poses(self, pose: NDArray[np.float64]) -> Recording:
        """Return the trajectory with poses (T, N, 7)."""
        return Recording(
            pose, self.wrench, self.time, split=self.split, protocol=self.protocol, wrench_time=self.wrench_time
        )


def filmed_of(recordings: RecordingSet, count: int) -> list[Filmed]:
    """Check the films of the first trajectories of a set, and return what is known of each beside its film.

    Raises:
        ValueError: If one has no film, or none that poses can be read from; the message names it.
    """
    check_video(recordings, range(count))
    return [Filmed.of(recordings, index) for index in range(count)]


class Footage(ABC):
    """Films of some trajectories."""

    @abstractmethod
    def first(self, index: int) -> FirstSight:
        """Return the first frame (H, W, 3) of trajectory `index`, its masks (N, H, W) and its background (H, W, 3)."""

    @abstractmethod
    def frames(self, index: int, start: int, stop: int) -> Image:
        """Return frames `start` to `stop` of trajectory `index`, shape (n, H, W, 3)."""


@final
class Recorded(Footage):
    """Films of a recording set."""

    def __init__(self, recordings: RecordingSet) -> None:
        self._recordings = recordings

    def first(self, index: int) -> FirstSight:
        """Return first frame, masks and background."""
        frames, mask, background = self._recordings.film(index, [0])
        return frames[0], mask, background

    def frames(self, index: int, start: int, stop: int) -> Image:
        """Decode some frames."""
        return self._recordings.film(index, list(range(start, stop)))[0]


@final
class Drawn(Footage, AbstractContextManager["Drawn"]):
    """Known motions, drawn by PyBullet with the look of filmed bodies on the filmed backgrounds.

    Args:
        scene: Gives camera and sizes.
        patches: Colours of the bodies' faces in [0, 255], shape (N, 6, P, P, 3).
        poses: Motions (T, N, 7) by trajectory.
        backgrounds: Images of the empty scenes by trajectory, shape (H, W, 3).
        noise: Standard deviation of a colour [of 255], drawn anew for every pixel.
        shadow: What the bodies cast on the ground.
    """

    def __init__(
        self, scene: Scene, patches: Image, poses: Sequence[NDArray[np.float64]], backgrounds: Sequence[Image],
        noise: float = 0.0, shadow: CastShadow | None = None,
    ) -> None:  # fmt: skip
        self._scene, self._shadow = scene, shadow
        self._studio = open_studio(scene, patches)
        self._poses, self._backgrounds, self._noise = poses, backgrounds, noise
        self._bodies = len(scene.bodies)

    def __exit__(self, *error: object) -> None:
        self._studio.__exit__()

    def first(self, index: int) -> FirstSight:
        """Draw the first frame and tell which pixels show which body."""
        image, which = self._shoot(index, 0)
        mask = np.stack([which == body for body in range(self._bodies)])
        return image, mask, self._backgrounds[index]

    def frames(self, index: int, start: int, stop: int) -> Image:
        """Draw some frames."""
        return np.stack([self._shoot(index, frame)[0] for frame in range(start, stop)])

    def _shoot(self, index: int, frame: int) -> tuple[Image, NDArray[np.int64]]:
        self._studio.background = self._behind(index, frame)
        image, which = self._studio.shoot(self._poses[index][frame])
        if self._noise:
            added = self._noise * np.random.default_rng([index, frame]).standard_normal(image.shape)
            image = (image + added).round().clip(0, 255).astype(np.uint8)
        return image, which

    def _behind(self, index: int, frame: int) -> Image:
        """Return the background of a frame, in shadow where there is one."""
        background = self._backgrounds[index]
        if self._shadow is None:
            return background
        pose, size = torch.from_numpy(self._poses[index][frame]).float(), torch.from_numpy(self._scene.sizes).float()
        height, width = background.shape[:2]
        light = self._shadow.light(camera_of(self._scene), pose[None, None], size, (height, width))[0, 0]
        return np.asarray((background * light.numpy()[..., None]).round(), dtype=np.uint8)
