"""What was recorded, as arrays, with the part that each trajectory plays in the diagnosis."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from physid.data import RecordingSet
from physid.data.observations.step_grid import StepGrid
from physid.data.observations.trajectories import Trajectories, load_trajectories
from physid.data.reading import ECHO, echo_of, read_reading, stretch_of
from physid.diagnosis.settings.inputs import RoleSettings
from physid.estimation.measurement import TrackingError
from physid.estimation.prediction import Timeline
from physid.scenes import Scene

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
UNSPLIT = (FIT, SELECT, SAME)  # trajectories without a split play these parts in turn
DEFAULT_ROLES = RoleSettings()


@dataclass(frozen=True)
class Observations:
    """R trajectories of T frames.

    Attributes:
        scene: The scene as far as it is known.
        pose: Observed poses, shape (R, T, N, 7).
        present: 1 where a body was seen (trajectories may differ in length, and miss frames), shape (R, T, N).
        timeline: When poses were recorded, and the commanded wrenches in between.
        roles: fit, select, probe, same or transfer, one for each trajectory; the last two are only reported on.
        indices: Number of each trajectory in the recording set.
        sources: The set of each trajectory, and its number there; none for observations that were made up.
        error: How far poses that were read from films can be trusted; None for a sensor of poses.
    """

    scene: Scene
    pose: Tensor
    present: Tensor
    timeline: Timeline
    roles: tuple[str, ...]
    indices: tuple[int, ...]
    sources: tuple[tuple[RecordingSet, int], ...] = ()
    error: TrackingError | None = None

    @property
    def folder(self) -> Path:
        """Folder of the first set."""
        return self.sources[0][0].folder

    @property
    def title(self) -> str:
        """Name of the first set, or of the films that its poses were read from."""
        reading = read_reading(self.folder)
        return Path(reading.films).name if reading else self.folder.name

    @property
    def fitted(self) -> Tensor:
        """Trajectories that determine parameters, shape (R,)."""
        return self.having(FIT) | self.having(SELECT) | self.having(PROBE)

    @property
    def reported(self) -> tuple[Tensor, Tensor]:
        """Trajectories that report on the same protocol (held-out ones, else `select`), and on the transfer, (R,)."""
        same = self.having(SAME)
        return same if bool(same.any()) else self.having(SELECT), self.having(TRANSFER)

    def having(self, role: str) -> Tensor:
        """Return which trajectories play a part, shape (R,)."""
        return torch.tensor([each == role for each in self.roles])


def load_observations(
    recordings: RecordingSet,
    transfer: RecordingSet | None = None,
    limit: int | None = None,
    roles: RoleSettings = DEFAULT_ROLES,
) -> Observations:
    """Read a recording set.

    Args:
        recordings: The set.
        transfer: Recordings of the same bodies under another protocol; all of them are for the transfer.
        limit: At most so many trajectories of each set, the first ones.
        roles: Which trajectories select, and probe.

    Raises:
        ValueError: If a trajectory has no poses, or the second set holds other bodies; see also `require_usable`.
    """
    sets = [recordings] if transfer is None else [recordings, transfer]
    for other in sets[1:]:
        require_same_scene(recordings, other)
    read = [load_trajectories(each, _first(each, limit)) for each in sets]
    for number, more in enumerate(read[1:], 1):
        read[number] = replace(more, splits=("report_transfer",) * len(more))
    observations = _observed(recordings.scene, read, roles)
    sources = tuple((each, index) for each in sets for index in _first(each, limit))
    return replace(observations, sources=sources, error=_tracking_error(observations, sets, limit, roles))


def _first(recordings: RecordingSet, limit: int | None) -> range:
    """Return the numbers of the first trajectories."""
    return range(len(recordings))[:limit]


def _observed(scene: Scene, sets: Sequence[Trajectories], roles: RoleSettings) -> Observations:
    """Put trajectories of several sets one after the other; shorter ones are filled up with frames nobody saw."""
    frames = max(each.pose.shape[1] for each in sets)
    steps = max(each.grid.steps.shape[1] for each in sets)

    def longer(value: Tensor, length: int) -> Tensor:
        last = value[:, -1:].expand(-1, length - value.shape[1], *value.shape[2:])
        return torch.cat([value, last], 1)

    grid = StepGrid(
        torch.cat([longer(each.grid.steps, steps) for each in sets]),
        torch.cat([longer(each.grid.wrench, steps) for each in sets]),
        torch.cat([longer(each.grid.frame_step, frames) for each in sets]),
        torch.cat([each.grid.count for each in sets]),
    )
    unseen = [
        torch.cat([each.seen, each.seen.new_zeros(len(each), frames - each.seen.shape[1], each.seen.shape[2])], 1)
        for each in sets
    ]
    splits = [split for each in sets for split in each.splits]
    protocols = [protocol for each in sets for protocol in each.protocols]
    return Observations(
        scene,
        torch.cat([longer(each.pose, frames) for each in sets]),
        torch.cat(unseen).double(),
        Timeline(torch.cat([longer(each.time, frames) for each in sets]), grid),
        _roles(splits, protocols, roles),
        tuple(range(len(splits))),
    )


def _tracking_error(
    observations: Observations, sets: Sequence[RecordingSet], limit: int | None, roles: RoleSettings
) -> TrackingError | None:
    """Compare poses that were read from films with what drawing and reading them again gives.

    Raises:
        ValueError: If only one of two sets was read from films.
    """
    readings, echoes = [read_reading(each.folder) for each in sets], [echo_of(each) for each in sets]
    if all(each is None for each in readings):
        return None
    for each, reading, echo in zip(sets, readings, echoes, strict=True):
        if reading is None or echo is None:
            raise ValueError(
                f"{each.folder}: expected poses that were read from films, as in the other set, and the set {ECHO} "
                "beside them, found none; use physid track on both sets"
            )
    loaded = [load_trajectories(each, _first(each, limit)) for each in echoes if each]
    again = _observed(observations.scene, loaded, roles)
    camera = observations.scene.camera
    assert camera is not None
    deviation = max(each.stretch_deviation for each in readings if each)
    return TrackingError.between(observations.pose, again.pose, stretch_of(observations.pose, camera.target), deviation)


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


def _roles(splits: Sequence[str | None], protocols: Sequence[str | None], settings: RoleSettings) -> tuple[str, ...]:
    """Give each trajectory its part; one of another protocol than most of those fitted is for the transfer."""
    turns = iter(UNSPLIT * len(splits))
    roles = [ROLES[split] if split else next(turns) for split in splits]
    if SELECT not in roles:
        fitted = [row for row, role in enumerate(roles) if role == FIT]
        for row in fitted[settings.select_every - 1 :: settings.select_every]:
            roles[row] = SELECT
    if TRANSFER not in roles:
        used = Counter(one for one, role in zip(protocols, roles, strict=True) if role in (FIT, SELECT))
        usual = used.most_common(1)[0][0] if used else None
        roles = [
            TRANSFER if role == SAME and one != usual else role for one, role in zip(protocols, roles, strict=True)
        ]
    return _with_probes(roles, settings.probes_from)


def _with_probes(roles: list[str], enough: int) -> tuple[str, ...]:
    """Let every second trajectory of the other protocol join the fit, where there are enough.

    What one protocol cannot show, say a dead zone that friction absorbs, has to be looked for on another; the cause is
    then certified on those trajectories of the other protocol that were not looked at.
    """
    other = [row for row, role in enumerate(roles) if role == TRANSFER]
    if len(other) >= enough:
        for row in other[::2]:
            roles[row] = PROBE
    return tuple(roles)
