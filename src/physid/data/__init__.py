"""Recordings: on disk, made by a simulator or imported, and in batches."""

from physid.data.format import DESCRIPTION, RecordingSet, trajectory_path, write_scene, write_sums
from physid.data.recording import SPLITS, UNIT_TOLERANCE, Recording
from physid.data.trajectory import read_trajectory, write_trajectory

__all__ = [
    "DESCRIPTION",
    "SPLITS",
    "UNIT_TOLERANCE",
    "Recording",
    "RecordingSet",
    "read_trajectory",
    "trajectory_path",
    "write_scene",
    "write_sums",
    "write_trajectory",
]
