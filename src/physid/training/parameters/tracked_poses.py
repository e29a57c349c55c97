"""How far trajectories are off that were read from films."""

from __future__ import annotations

from pathlib import Path

from physid.data.reading import read_reading
from physid.estimation.measurement.tracking_error import TrackingError
from physid.scenes.scene import Scene
from physid.training.parameters.trajectories import Trajectories


def tracking_error_of(scene: Scene, folder: Path, cut: Trajectories) -> TrackingError | None:
    """Return the error of trajectories that were read from films, None for poses of a sensor.

    Args:
        scene: Its camera tells where the view is fixed.
        folder: Of the recording set, which says how well the scale of the poses is known.
        cut: What was read, and read again.
    """
    reading, camera = read_reading(folder), scene.camera
    if reading is None or camera is None or cut.again is None:
        return None
    return TrackingError.between(cut.pose, cut.again, cut.pose.new_tensor(camera.target), reading.stretch_deviation)
