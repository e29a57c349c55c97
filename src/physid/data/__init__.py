"""Recordings: on disk, made by a simulator or imported, and in batches."""

from physid.data.format import DESCRIPTION as DESCRIPTION
from physid.data.format import RecordingSet as RecordingSet
from physid.data.format import trajectory_path as trajectory_path
from physid.data.format import write_scene as write_scene
from physid.data.format import write_sums as write_sums
from physid.data.recording import SPLITS as SPLITS
from physid.data.recording import UNIT_TOLERANCE as UNIT_TOLERANCE
from physid.data.recording import Recording as Recording
from physid.data.splits import assign_splits as assign_splits
from physid.data.trajectory import read_trajectory as read_trajectory
from physid.data.trajectory import write_trajectory as write_trajectory
