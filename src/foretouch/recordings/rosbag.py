"""Reads rosbag2 folders and database files (sqlite3 or MCAP storage, compressed or not) by `rosbags`."""

from __future__ import annotations

import contextlib
import weakref
from collections.abc import Iterator
from itertools import islice
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.recordings._extra import optional
from foretouch.recordings.bag_series import RosBag
from foretouch.recordings.source import Topic, gathered, one_line

__all__ = ["Rosbag2"]


class Rosbag2(RosBag):
    """An opened rosbag2.

    It stays open until nobody has it any more: opening parses the metadata of all topics, seconds for thousands.

    Args:
        path: Its folder, with ``metadata.yaml``, or one ``.db3`` file.

    Raises:
        RecordingError: It is none, is damaged, or was not ended by its recorder.
        MissingExtraError: The package ``rosbags`` is not installed.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        super().__init__(path)
        self._rosbag2 = optional("rosbags.rosbag2")
        if Path(path).is_dir() and not (Path(path) / "metadata.yaml").is_file():
            problem = "is a folder without metadata.yaml, so no whole rosbag2: `ros2 bag reindex` makes one"
            raise RecordingError(path, problem)
        with self._plain_errors():
            self._reader = reader = self._opened()
            self._definitions_by_type = {
                found.msgtype: (found.msgdef.data, "ros2idl" if found.msgdef.format.name == "IDL" else "ros2msg")
                for found in reader.connections
            }
            self.topics = gathered(Topic(found.topic, found.msgtype, found.msgcount) for found in reader.connections)
            self.begin_ns = reader.start_time if reader.message_count else 0
            self.end_ns = reader.end_time - 1 if reader.message_count else 0
            storage = "one file" if Path(path).is_file() else _storage(reader)
        self.format = f"rosbag2 ({storage})"

    def definition(self, topic: Topic) -> tuple[str, str]:
        """As `RosBag.definition`."""
        return self._definitions_by_type[topic.type_name]

    def messages(self, topic: Topic, most: int | None = None) -> tuple[list[bytes], NDArray[np.int64]]:
        """As `RosBag.messages`."""
        with self._plain_errors():
            wanted = [found for found in self._reader.connections if found.topic == topic.name]
            found = contextlib.closing(self._reader.messages(wanted)) if wanted else contextlib.nullcontext(())
            with found as messages:
                pairs = [(bytes(raw), at) for _, at, raw in islice(messages, most)]
        raws, times = zip(*pairs, strict=True) if pairs else ((), ())
        return list(raws), np.array(times, dtype=np.int64)

    def _opened(self) -> Any:
        reader = self._rosbag2.Reader(Path(self.path))
        reader.open()
        weakref.finalize(self, reader.close)
        return reader

    @contextlib.contextmanager
    def _plain_errors(self) -> Iterator[None]:
        try:
            yield
        except RecordingError:
            raise
        except Exception as error:  # YAML, sqlite, zstd and rosbags have their own errors
            raise RecordingError(self.path, f"is no rosbag2 that can be read: {one_line(error)}") from None


def _storage(reader: Any) -> str:
    kinds = {type(storage).__name__ for storage in reader.storage.storages}
    return "MCAP" if kinds == {"McapReader"} else "sqlite3"
