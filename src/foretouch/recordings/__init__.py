"""Reads and writes files, and serves the measured datasets.

`read_recording` reads a recording of any format, `SessionWriter` and `read_session` write and read a session as MCAP,
`repair_session` repairs one whose writer was killed, `write_columns` writes results, `write_lerobot` a dataset to train
policies on, `excerpt` gives the path of a measured recording, `fetch_dataset` that of its original.
"""

from foretouch.files.origins import DATA_DIR, Origin
from foretouch.recordings.convert import OUTPUTS, write_recording
from foretouch.recordings.datasets import DATASETS, Dataset, excerpt, fetch_all, fetch_dataset, list_datasets
from foretouch.recordings.formats.published import read_leader_motion
from foretouch.recordings.inspection import Contents, inspect_recording
from foretouch.recordings.lerobot.dataset import Dataset as LerobotDataset
from foretouch.recordings.lerobot.dataset import write_lerobot
from foretouch.recordings.lerobot.episodes import Episode, read_episode
from foretouch.recordings.material_memory import memory_path, read_memory, write_memory
from foretouch.recordings.meaning.mapped import falls_with_depth
from foretouch.recordings.meaning.mapping import Mapping, Signal, TimeSource, Velocity, read_mapping, write_mapping
from foretouch.recordings.meaning.names import FORCE_CHANNELS, FORCE_UNITS, POSITION_UNITS, RecordingOptions
from foretouch.recordings.output import atomic_path, read_calibration, write_calibration, write_columns
from foretouch.recordings.pose_table import POSE_COLUMNS, StaticPoses, read_poses
from foretouch.recordings.reading import SUFFIXES, Read, is_session, open_source, read_recording, read_with_notes
from foretouch.recordings.session.reader import FollowerSamples, follower_samples, read_follower_samples, read_session
from foretouch.recordings.session.repair import Repair, is_whole, repair_session
from foretouch.recordings.session.writer import SessionWriter

__all__ = [
    "DATASETS",
    "DATA_DIR",
    "FORCE_CHANNELS",
    "FORCE_UNITS",
    "OUTPUTS",
    "POSE_COLUMNS",
    "POSITION_UNITS",
    "SUFFIXES",
    "Contents",
    "Dataset",
    "Episode",
    "FollowerSamples",
    "LerobotDataset",
    "Mapping",
    "Origin",
    "Read",
    "RecordingOptions",
    "Repair",
    "SessionWriter",
    "Signal",
    "StaticPoses",
    "TimeSource",
    "Velocity",
    "atomic_path",
    "excerpt",
    "falls_with_depth",
    "fetch_all",
    "fetch_dataset",
    "follower_samples",
    "inspect_recording",
    "is_session",
    "is_whole",
    "list_datasets",
    "memory_path",
    "open_source",
    "read_calibration",
    "read_episode",
    "read_follower_samples",
    "read_leader_motion",
    "read_mapping",
    "read_memory",
    "read_poses",
    "read_recording",
    "read_session",
    "read_with_notes",
    "repair_session",
    "write_calibration",
    "write_columns",
    "write_lerobot",
    "write_mapping",
    "write_memory",
    "write_recording",
]
