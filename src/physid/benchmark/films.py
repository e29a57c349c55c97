"""Sets of films: some sets of a bank have no poses, a diagnosis must read them first."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from physid.data import RecordingSet, write_sums, write_trajectory
from physid.data.generation.settings import GenerateConfig, Noise

EVERY, FIRST = 15, 7  # of each role every fifteenth set, from the eighth on
SCENES = ("push",)  # where bodies lie on the ground: there no initial pose is needed to find them
FEWEST, SHORTEST = 6, 60  # half as many films as trajectories elsewhere, half as long, but not less than this
NOISE = Noise(position=1e-3, rotation=8e-3)  # what read poses are off by, without a constant of each trajectory
READ = "read"  # folder of the poses, in that of the verdict


def is_film(turn: int) -> bool:
    """Return whether the `turn`-th set of a role is one of films."""
    return turn % EVERY == FIRST


def filmed(config: GenerateConfig) -> GenerateConfig:
    """Return the configuration of a set of films; its noise is what a reader errs, the films have none."""
    count = max(config.trajectories // 2, min(config.trajectories, FEWEST))
    steps = max(config.steps // 2, min(config.steps, SHORTEST))
    return dataclasses.replace(config, video=True, trajectories=count, steps=steps, noise=NOISE)


def leave_out_poses(folder: Path) -> None:
    """Write the trajectories of a set again without poses and velocities."""
    recordings = RecordingSet(folder)
    for index, path in enumerate(recordings.paths):
        if recordings.has_poses(index):
            whole = recordings.read(index, video=True)
            write_trajectory(path, dataclasses.replace(whole, pose=None, twist=None))
    write_sums(folder)


def with_poses(recordings: Path, verdict: Path) -> Path:
    """Return a set that has poses: the recordings, or what is read from their films into the folder of the verdict."""
    if RecordingSet(recordings).has_poses(0):
        return recordings
    from physid.training.tracking.track import track

    track(recordings, verdict / READ)
    return verdict / READ


def seen_poses(recordings: Path, verdict: Path) -> Path:
    """Return the set whose poses a diagnosis has seen."""
    read = verdict / READ
    return read if read.is_dir() else recordings
