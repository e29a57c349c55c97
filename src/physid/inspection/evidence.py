"""What rules look at: the recordings of a set, their kinematics, and a few choices of frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from physid.data import Recording
from physid.data.observations.trajectories import from_recordings
from physid.estimation.measurement import UNSEEN, Noise
from physid.inspection.kinematics import Kinematics, acceleration_noise, kinematics_of, noise_of, window_for
from physid.inspection.origin import Origin
from physid.inspection.usability import Motion
from physid.scenes import Scene

Array = NDArray[np.float64]
FREE = 0.05  # share of the weight below which a force is none
SMOOTH = 4.0  # deviations of the noise by which positions may leave a parabola
LEAST_SMOOTH = 1e-4  # [m] the same, where there is hardly any noise
EXACT = 0.05  # share of gravity to which accelerations shall be known
STILL = 0.01  # [m/s] below which the direction of a motion is noise
FLOAT = 0.02  # share of the smallest edge by which a lying body may seem to float or sink
TOUCHES = 2e-3  # [m] at least, by which the lowest corner of a body may be off that touches the ground
TURNED = 1e-3  # [rad] per frame below which nothing turns


@dataclass(frozen=True)
class Evidence:
    """The recordings of a set that have poses.

    Attributes:
        scene: The scene.
        recordings: At least one.
        indices: Their numbers in the set.
        origin: What the mapping of their import said of axes and forces.
    """

    scene: Scene
    recordings: list[Recording]
    indices: list[int]
    origin: Origin = field(default_factory=Origin)

    def scaled(self, factor: float) -> Evidence:
        """Return the same with other positions: these, times a factor."""
        change = np.array([factor] * 3 + [1.0] * 4)
        moved = [
            one if one.pose is None else replace(one, pose=one.pose * change, twist=None) for one in self.recordings
        ]
        return replace(self, recordings=moved)

    @cached_property
    def motion(self) -> Motion:
        """Poses of all trajectories, filled up to the same length."""
        return Motion.of(self.scene, from_recordings(self.recordings, self.scene.time_step, self.indices))

    @cached_property
    def kinematics(self) -> Kinematics:
        """Local parabolas through the positions."""
        return kinematics_of(self.recordings, self.scene, self.kinematics_window)

    @cached_property
    def kinematics_window(self) -> int:
        """Frames of a parabola, an odd number."""
        wanted = EXACT * float(np.linalg.norm(self.weight))
        return window_for(self.noise.position, self.scene.time_step, wanted)

    @cached_property
    def acceleration_noise(self) -> float:
        """Standard deviation of the accelerations [m/s^2]."""
        return acceleration_noise(self.noise.position, self.scene.time_step, self.kinematics_window)

    @cached_property
    def force_step(self) -> float | None:
        """Median time between two rows of forces [s]; None where they come with the frames, or not at all."""
        clocks = [one.wrench_time for one in self.recordings if one.wrench_time is not None and one.wrench is not None]
        steps = np.concatenate([np.diff(clock) for clock in clocks]) if clocks else np.zeros(0)
        return float(np.median(steps)) if len(steps) else None

    @cached_property
    def noise(self) -> Noise:
        """Noise of the poses."""
        return noise_of(self.recordings, self.scene.time_step)

    def describe_noise(self) -> str:
        """Say how noisy the poses are."""
        size = f"{1000 * self.noise.position:.2g} mm and {np.rad2deg(self.noise.rotation):.2g} deg"
        unseen = self.noise.position == UNSEEN.position
        return f"{size} {'assumed, too little to tell' if unseen else 'beyond any smooth motion'}"

    @property
    def weight(self) -> Array:
        """Acceleration of gravity [m/s^2], shape (3,)."""
        return np.array(self.scene.gravity)

    @cached_property
    def masses(self) -> Array:
        """Mass of the body of each window [kg], shape (n,)."""
        return np.array([body.mass for body in self.scene.bodies])[self.kinematics.body]

    @property
    def guesses_masses(self) -> bool:
        """Whether the mass of a body is unknown, and what the scene says of it a first guess."""
        return any(f"{body.name}.mass" in self.scene.unknown for body in self.scene.bodies)

    @cached_property
    def smooth(self) -> NDArray[np.bool_]:
        """Windows that a parabola fits: no impact lies in them."""
        # Relative to the motion itself, too: what is in millimetres has a thousand times the residual.
        way = np.linalg.norm(self.kinematics.velocity, axis=1) * self.scene.time_step
        return np.asarray(
            self.kinematics.residual < np.maximum(SMOOTH * self.noise.position, LEAST_SMOOTH) + 0.01 * way
        )

    @cached_property
    def unforced(self) -> NDArray[np.bool_]:
        """Windows in which no force acts to speak of."""
        force = np.linalg.norm(self.kinematics.force, axis=1)
        return np.asarray(force <= FREE * self.masses * np.linalg.norm(self.weight))

    @property
    def slowest(self) -> float:
        """Speed that noise alone may give a window [m/s]."""
        return 2 * self.noise.position / self.scene.time_step / 5

    @cached_property
    def still(self) -> NDArray[np.bool_]:
        """Windows in which a body lies still."""
        speed = np.linalg.norm(self.kinematics.velocity, axis=1)
        return np.asarray(
            (speed < max(STILL, self.slowest)) & (self.kinematics.turning < max(TURNED, 4 * self.noise.rotation))
        )

    @cached_property
    def near(self) -> float:
        """How far the lowest corner of a body may seem from the ground that it touches [m]."""
        radius, edge = float(np.linalg.norm(self.scene.sizes, axis=1).max()) / 2, float(self.scene.sizes.min())
        return max(TOUCHES, FLOAT * edge) + 3 * (self.noise.position + radius * self.noise.rotation)

    @cached_property
    def touching(self) -> NDArray[np.bool_]:
        """Windows in which a body touches the ground."""
        return np.asarray(np.abs(self.kinematics.height) < self.near)

    def tracks(self) -> Iterator[tuple[int, int, NDArray[np.int64], Array]]:
        """Yield the trajectory's number, the body, the frames that show it and its poses there (n, 7), of each body."""
        for index, one in zip(self.indices, self.recordings, strict=True):
            if one.pose is not None:
                for body in range(one.pose.shape[1]):
                    frame = np.flatnonzero(one.seen[:, body])
                    yield index, body, frame, one.pose[frame, body]

    def place(self, window: int) -> str:
        """Name trajectory and frame of a window."""
        found = self.kinematics
        return f"trajectory {self.indices[int(found.trajectory[window])]}, frame {int(found.frame[window])}"
