"""Reads and writes files, and serves the measured datasets.

`read_recording` reads a recording of any format, `SessionWriter` and `read_session` write and read a session as MCAP,
`write_columns` writes results, `fetch` gives the path of a measured file.
"""

from foretouch.recordings.datasets import DATA_DIR, DATASETS, Dataset, Origin, fetch, fetch_all, list_datasets
from foretouch.recordings.output import atomic_path, write_columns
from foretouch.recordings.reading import SUFFIXES, read_recording
from foretouch.recordings.session_reader import read_session
from foretouch.recordings.session_writer import SessionWriter
from foretouch.recordings.tue_mat import FORCE_CHANNELS, read_leader_motion
from foretouch.recordings.units import FORCE_UNITS, POSITION_UNITS

__all__ = [
    "DATASETS",
    "DATA_DIR",
    "FORCE_CHANNELS",
    "FORCE_UNITS",
    "POSITION_UNITS",
    "SUFFIXES",
    "Dataset",
    "Origin",
    "SessionWriter",
    "atomic_path",
    "fetch",
    "fetch_all",
    "list_datasets",
    "read_leader_motion",
    "read_recording",
    "read_session",
    "write_columns",
]
