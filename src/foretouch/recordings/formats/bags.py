"""Bags of ROS 2: rosbag2 folders and database files (sqlite3 or MCAP storage, compressed or not), read by `rosbags`.

The decoding that all bags share is here. Definitions of message types are those in the file, else those of ROS 2.
"""

from __future__ import annotations

import contextlib
import weakref
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from itertools import islice
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.recordings.formats.cdr import STAMP, Definitions, Places, extract
from foretouch.recordings.output import optional
from foretouch.recordings.source import Bag, Column, Series, Topic, foreign, gathered, listed, one_line

_SEPARATOR = "=" * 80 + "\n"


@lru_cache(maxsize=64)
def definitions_of(type_name: str, text: str, encoding: str) -> Definitions:
    """Definitions of a type and of those within it."""
    typesys = optional("rosbags.typesys")
    if text:
        try:
            parsed = _parsed(typesys, type_name, text, encoding)
        except Exception as error:  # the parser raises many kinds on a text that is none
            raise ValueError(f"the definition of {type_name} cannot be parsed: {one_line(error)[:200]}") from None
        if type_name in parsed:
            return parsed
    known: Definitions = typesys.get_typestore(typesys.Stores.LATEST).fielddefs
    if type_name not in known:
        raise ValueError(f"the file holds no definition of {type_name}, which is no type of ROS 2's own packages")
    return known


def _parsed(typesys: Any, type_name: str, text: str, encoding: str) -> Definitions:
    if encoding == "ros2msg":
        return dict(typesys.get_types_from_msg(text, type_name))
    types: dict[str, Any] = {}
    parts = [part.split("\n", 1)[1] for part in text.split(_SEPARATOR) if part.startswith("IDL: ")]
    for part in parts or [text]:
        types.update(typesys.get_types_from_idl(part))
    return types


class RosBag(Bag):
    """A bag of ROS 2 messages in CDR."""

    @abstractmethod
    def messages(self, topic: Topic, most: int | None = None) -> tuple[list[bytes], NDArray[np.int64]]:
        """Bytes and log times [ns] of a topic's messages, perhaps the first few only."""

    @abstractmethod
    def definition(self, topic: Topic) -> tuple[str, str]:
        """Text of the definition of a topic's type, and its encoding; empty where the file has none."""

    def fields(self, topic: str) -> tuple[Column, ...]:
        """As `Bag.fields`."""
        result = self.topic(topic)
        try:
            raws, _ = self.messages(result, 1)
            if not raws:
                return ()
            positions = Places(raws[0], self._definitions(result), result.type_name)
        except (ValueError, RecordingError):
            return ()
        return tuple(
            Column(name, np.dtype(code).name, result.count, example=float(np.frombuffer(raws[0], code, 1, offset)[0]))
            for name, code, offset in positions.fields()
        )

    def first_rate(self, topic: str, most: int) -> float:
        """As `Bag.first_rate`."""
        _, log_ns = self.messages(self.topic(topic), most)
        seconds = float(np.ptp(log_ns)) / 1e9 if log_ns.size else 0.0
        return (log_ns.size - 1) / seconds if seconds > 0.0 else 0.0

    def read(self, topic: str, fields: Sequence[str], within: int | None = None) -> Series:
        """As `Bag.read`."""
        result = self.topic(topic)
        raws, log_ns = self.messages(result, None if within is None else self._fitting(result, within))
        if not raws:
            raise RecordingError(self.path, f"{topic} has no messages")
        try:
            definitions = self._definitions(result)
            stamped = "header" in dict(definitions[result.type_name][1])
            values, present = extract(raws, definitions, result.type_name, [*fields, *(STAMP if stamped else ())])
        except ValueError as error:
            raise RecordingError(self.path, f"{topic}: {error}") from None
        if not present.any():
            self._refuse(result, raws[0], fields)
        kept = {name: values[name][present] for name in fields}
        stamps = np.zeros(0, np.int64)
        if stamped:
            seconds, nanoseconds = (values[name][present].astype(np.int64) for name in STAMP)
            stamps = seconds * 1_000_000_000 + nanoseconds
        return Series(topic, log_ns[present], stamps if stamps.any() else None, kept, int((~present).sum()))

    def _fitting(self, topic: Topic, size: int) -> int:
        """How many messages of a topic make up a size [bytes], by its first one; at least one."""
        raws, _ = self.messages(topic, 1)
        return max(1, size // max(1, len(raws[0]))) if raws else 1

    def _definitions(self, topic: Topic) -> Definitions:
        return definitions_of(topic.type_name, *self.definition(topic))

    def _refuse(self, topic: Topic, raw: bytes, fields: Sequence[str]) -> None:
        positions = Places(raw, self._definitions(topic), topic.type_name)
        missing = ", ".join(field for field in fields if positions.find(field) is None)
        there = listed(name for name, _, _ in positions.fields(8)) + bool(positions.problem) * f" ({positions.problem})"
        raise RecordingError(self.path, f"{topic.name} ({topic.type_name}) has no number {missing}; it has {there}")


_PARSE_QOS_USERS: Final = ("reader", "storage_sqlite3", "storage_mcap")
"""Modules of `rosbags.rosbag2` that parse QoS profiles."""


class Rosbag2(RosBag):
    """An opened rosbag2.

    It stays open as long as it is referenced: opening parses the metadata of all topics, seconds for thousands.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        super().__init__(path)
        self._rosbag2 = optional("rosbags.rosbag2")
        if Path(path).is_dir() and not (Path(path) / "metadata.yaml").is_file():
            problem = "is a folder without metadata.yaml, so no whole rosbag2: `ros2 bag reindex` makes one"
            raise RecordingError(path, problem)
        with foreign(self.path, "is no rosbag2 that can be read"):
            self._reader = reader = self._rosbag2.Reader(Path(path))
            with _equal_profiles_parsed_once(self._rosbag2):
                reader.open()
            weakref.finalize(self, reader.close)
            self._definitions_by_type = {
                result.msgtype: (result.msgdef.data, "ros2idl" if result.msgdef.format.name == "IDL" else "ros2msg")
                for result in reader.connections
            }
            self.topics = gathered(
                Topic(result.topic, result.msgtype, result.msgcount) for result in reader.connections
            )
            self.begin_ns = reader.start_time if reader.message_count else 0
            self.end_ns = reader.end_time - 1 if reader.message_count else 0
            file = Path(path).is_file()
            kinds = set() if file else {type(one).__name__ for one in reader.storage.storages}
        self.format = f"rosbag2 ({'one file' if file else 'MCAP' if kinds == {'McapReader'} else 'sqlite3'})"

    def definition(self, topic: Topic) -> tuple[str, str]:
        """As `RosBag.definition`."""
        return self._definitions_by_type[topic.type_name]

    def messages(self, topic: Topic, most: int | None = None) -> tuple[list[bytes], NDArray[np.int64]]:
        """As `RosBag.messages`."""
        with foreign(self.path, "is no rosbag2 that can be read"):
            wanted = [result for result in self._reader.connections if result.topic == topic.name]
            result = contextlib.closing(self._reader.messages(wanted)) if wanted else contextlib.nullcontext(())
            with result as messages:
                pairs = [(bytes(raw), at) for _, at, raw in islice(messages, most)]
        raws, times = zip(*pairs, strict=True) if pairs else ((), ())
        return list(raws), np.array(times, dtype=np.int64)


@contextlib.contextmanager
def _equal_profiles_parsed_once(rosbag2: Any) -> Iterator[None]:
    """Let `rosbags` parse each text of QoS profiles once.

    It parses that of every topic twice, as YAML: 7 of 10 s for 2,000 topics, whose texts are mostly the same. Nothing
    here asks for the profiles. Without the function of that name, nothing is changed.
    """
    modules: list[Any] = [getattr(rosbag2, name, None) for name in _PARSE_QOS_USERS]
    parsers = {module: module.parse_qos for module in modules if hasattr(module, "parse_qos")}
    for module, parser in parsers.items():
        module.parse_qos = _remembering(parser)
    try:
        yield
    finally:
        for module, parser in parsers.items():
            module.parse_qos = parser


def _remembering(parser: Callable[[Any], Any]) -> Callable[[Any], Any]:
    known = lru_cache(maxsize=None)(parser)
    return lambda profiles: known(profiles) if isinstance(profiles, str) else parser(profiles)
