"""Opens a recording by the ending of its name; which format that is, and nothing of its meaning."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Final

from foretouch.errors import RecordingError
from foretouch.recordings.csv_table import CsvTable
from foretouch.recordings.hdf5_table import Hdf5Table
from foretouch.recordings.mat_table import open_mat
from foretouch.recordings.mcap_file import McapFile
from foretouch.recordings.parquet_table import ParquetTable
from foretouch.recordings.rosbag import Rosbag2
from foretouch.recordings.source import Bag, Table

__all__ = ["OPENERS", "SUFFIXES", "open_source", "require_readable"]

OPENERS: Final[dict[str, Callable[[str | PathLike[str]], Table | Bag]]] = {
    ".csv": CsvTable,
    ".parquet": ParquetTable,
    ".mat": open_mat,
    ".h5": Hdf5Table,
    ".hdf5": Hdf5Table,
    ".mcap": McapFile,
    ".db3": Rosbag2,
}
"""By ending; a folder is a rosbag2."""

SUFFIXES: Final = (".csv", ".parquet", ".mat", ".ddf", ".npz", ".mcap", ".h5", ".hdf5", ".db3")
"""Endings of the files that can be read; a folder is read as a rosbag2."""


def require_readable(path: str | PathLike[str]) -> str:
    """The ending of a recording that is there, empty for a folder.

    Raises:
        RecordingError: No such file, or an ending that is not known.
    """
    file, suffix = Path(path), Path(path).suffix.lower()
    if file.is_dir() and (suffix not in SUFFIXES or (file / "metadata.yaml").is_file()):
        return ""
    if suffix not in SUFFIXES:
        problem = f"cannot be read: its name must end with one of {', '.join(SUFFIXES)}"
        raise RecordingError(path, f"{problem}, or be a rosbag2 folder")
    if not file.is_file():
        raise RecordingError(path, "is no file" if file.exists() else "no such file")
    return suffix


def open_source(path: str | PathLike[str]) -> Table | Bag:
    """An opened table or bag.

    Raises:
        RecordingError: It cannot be read, or is no format with columns or topics.
        MissingExtraError: The format needs a package of the extra ``recordings``.
    """
    suffix = require_readable(path)
    if suffix in (".ddf", ".npz"):
        what = "an Aurora .ddf file" if suffix == ".ddf" else "an excerpt of a measured recording"
        raise RecordingError(path, f"{what} has no columns to map: leave --map out")
    try:
        return OPENERS[suffix](path) if suffix else Rosbag2(path)
    except OSError as error:
        raise RecordingError(path, f"cannot be read: {error.strerror or error}") from None
