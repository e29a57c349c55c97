"""What was recorded, as arrays, with the part that each trajectory plays in the diagnosis."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
import torch
from torch import Tensor

from physid.data.format import Recording, RecordingSet
from physid.data.reading import ECHO, echo_of, read_reading
from physid.estimation.measurement.tracking_error import TrackingError
from physid.scenes.scene import Scene

FIT, SELECT, SAME, PROBE, TRANSFER = "fit", "select", "same", "probe", "transfer"
ROLES = {
    "fit": FIT,
    "select": SELECT,
    "report_same": SAME,
    "report_transfer": TRANSFER,
    "train": FIT,
    "val": SELECT,
    "test": SAME,
}
ENOUGH = 4  # from so many trajectories of another protocol on, every second one joins the fit as a probe
JITTER = 0.02  # share of the time step by which time stamps may be off
UNSPLIT = (FIT, SELECT, SAME)  # trajectories without a split play these parts in turn


@dataclass(frozen=True)
class Observations:
    """R trajectories of T frames.

    Attributes:
        scene: The scene as far as it is known.
        pose: Observed poses, shape (R, T, N, 7).
        wrench: Commanded wrenches, shape (R, T, N, 6).
        present: 1 for frames that exist (trajectories may differ in length), shape (R, T, N).
        roles: fit, select, probe, same or transfer, one for each trajectory; the last two are only reported on.
        indices: Number of each trajectory in the recording set.
        error: How far poses that were read from films can be trusted; None for a sensor of poses.
    """

    scene: Scene
    pose: Tensor
    wrench: Tensor
    present: Tensor
    roles: tuple[str, ...]
    indices: tuple[int, ...]
    error: TrackingError | None = None

    @property
    def fitted(self) -> Tensor:
        """Trajectories that determine parameters, shape (R,)."""
        return self.having(FIT) | self.having(SELECT) | self.having(PROBE)

    def having(self, role: str) -> Tensor:
        """Return which trajectories play a part, shape (R,)."""
        return torch.tensor([each == role for each in self.roles])


def load_observations(
    recordings: RecordingSet, transfer: RecordingSet | None = None, limit: int | None = None
) -> Observations:
    """Read a recording set.

    Args:
        recordings: The set.
        transfer: Recordings of the same bodies under another protocol; all of them are for the transfer.
        limit: At most so many trajectories of each set, the first ones.

    Raises:
        ValueError: If a trajectory has no poses, or the second set holds other bodies; see also `require_sound`.
    """
    read = list(islice(recordings, limit))
    if transfer is not None:
        require_same_scene(recordings, transfer)
        read += [replace(one, split="report_transfer") for one in islice(transfer, limit)]
    require_even_time(read, recordings.scene.time_step)
    observations = from_recordings(recordings.scene, read)
    return replace(observations, error=_reader_error(observations, recordings, transfer, limit))


def _reader_error(
    observations: Observations, recordings: RecordingSet, transfer: RecordingSet | None, limit: int | None
) -> TrackingError | None:
    """Compare poses that were read from films with what drawing and reading them again gives.

    Raises:
        ValueError: If only one of two sets was read from films.
    """
    sets = [recordings] if transfer is None else [recordings, transfer]
    readings, echoes = [read_reading(each.folder) for each in sets], [echo_of(each) for each in sets]
    if all(each is None for each in readings):
        return None
    for each, reading, echo in zip(sets, readings, echoes, strict=True):
        if reading is None or echo is None:
            raise ValueError(
                f"{each.folder}: expected poses that were read from films, as in the other set, and the set {ECHO} "
                "beside them, found none; use physid track on both sets"
            )
    again = from_recordings(observations.scene, [one for each in echoes if each for one in islice(each, limit)])
    camera = recordings.scene.camera
    assert camera is not None
    deviation = max(each.stretch_deviation for each in readings if each)
    middle = torch.tensor(camera.target, dtype=torch.float64)
    return TrackingError.between(observations.pose, again.pose, middle, deviation)


def require_even_time(recordings: list[Recording], time_step: float) -> None:
    """Refuse time stamps that are not one time step apart.

    Raises:
        ValueError: Names trajectory and frame, what was expected and what was found.
    """
    for index, one in enumerate(recordings):
        if one.time is None:
            continue
        steps = np.diff(one.time)
        off = np.abs(steps - time_step) > JITTER * time_step
        if off.any():
            frame = int(off.argmax())
            raise ValueError(
                f"trajectory {index}: expected frames {time_step:.6g} s apart (time_step), found {steps[frame]:.6g} s "
                f"between frames {frame} and {frame + 1}; resample the trajectory, or cut it there"
            )


def require_same_scene(recordings: RecordingSet, transfer: RecordingSet) -> None:
    """Refuse a transfer set of other bodies, another ground or another frame rate."""
    one, other = recordings.scene, transfer.scene
    facts = {
        "bodies": ([(body.name, body.size) for body in scene.bodies] for scene in (one, other)),
        "ground": (scene.ground for scene in (one, other)),
        "gravity": (scene.gravity for scene in (one, other)),
        "time_step": (scene.time_step for scene in (one, other)),
    }
    for name, (first, second) in facts.items():
        if first != second:
            raise ValueError(
                f"{transfer.folder}: expected the {name} of {recordings.folder}, {first}, found {second}; "
                "a transfer set holds the same things, moved in another way"
            )


def from_recordings(scene: Scene, recordings: list[Recording]) -> Observations:
    """Stack recordings; shorter ones are filled up with their last frame."""
    blind = [index for index, one in enumerate(recordings) if one.pose is None]
    if blind:
        raise ValueError(
            f"trajectory {blind[0]} has video but no poses: expected `pose` in every trajectory; read poses from the "
            "films: physid track"
        )
    frames, bodies = max(one.length for one in recordings), len(scene.bodies)
    pose = np.empty((len(recordings), frames, bodies, 7))
    wrench = np.zeros((len(recordings), frames, bodies, 6))
    present = np.zeros((len(recordings), frames, bodies))
    for row, one in enumerate(recordings):
        assert one.pose is not None
        pose[row] = one.pose[np.minimum(np.arange(frames), one.length - 1)]
        present[row, : one.length] = 1
        if one.wrench is not None:
            wrench[row, : one.length] = one.wrench
    return Observations(
        scene,
        torch.from_numpy(pose),
        torch.from_numpy(wrench),
        torch.from_numpy(present),
        _roles(recordings),
        tuple(range(len(recordings))),
    )


def _roles(recordings: list[Recording]) -> tuple[str, ...]:
    """Give each trajectory its part; one of another protocol than most of those fitted is for the transfer."""
    turns = iter(UNSPLIT * len(recordings))
    roles = [ROLES[one.split] if one.split else next(turns) for one in recordings]
    if SELECT not in roles:
        fitted = [row for row, role in enumerate(roles) if role == FIT]
        for row in fitted[2::3]:
            roles[row] = SELECT
    if TRANSFER not in roles:
        used = Counter(one.protocol for one, role in zip(recordings, roles, strict=True) if role in (FIT, SELECT))
        usual = used.most_common(1)[0][0] if used else None
        roles = [
            TRANSFER if role == SAME and one.protocol != usual else role
            for one, role in zip(recordings, roles, strict=True)
        ]
    return _with_probes(roles)


def _with_probes(roles: list[str]) -> tuple[str, ...]:
    """Let every second trajectory of the other protocol join the fit, where there are enough.

    What one protocol cannot show, say a dead zone that friction absorbs, has to be looked for on another; the cause is
    then certified on those trajectories of the other protocol that were not looked at.
    """
    other = [row for row, role in enumerate(roles) if role == TRANSFER]
    if len(other) >= ENOUGH:
        for row in other[::2]:
            roles[row] = PROBE
    return tuple(roles)
