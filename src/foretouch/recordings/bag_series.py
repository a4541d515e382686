"""What every bag does with the bytes of its messages, wherever it has them from."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.recordings.cdr_fields import STAMP, Definitions, Places, extract
from foretouch.recordings.ros_types import definitions_of
from foretouch.recordings.source import Bag, Column, Series, Topic, listed

__all__ = ["RosBag"]


class RosBag(Bag):
    """A bag of ROS 2 messages in CDR."""

    @abstractmethod
    def messages(self, topic: Topic, most: int | None = None) -> tuple[list[bytes], NDArray[np.int64]]:
        """Bytes and log times [ns] of a topic's messages, perhaps the first few only.

        Raises:
            RecordingError: The file is damaged.
        """

    @abstractmethod
    def definition(self, topic: Topic) -> tuple[str, str]:
        """Text of the definition of a topic's type, and its encoding; empty where the file has none.

        Raises:
            RecordingError: The topic's messages are no CDR.
        """

    def fields(self, topic: str) -> tuple[Column, ...]:
        """As `Bag.fields`."""
        found = self.topic(topic)
        try:
            raws, _ = self.messages(found, 1)
            if not raws:
                return ()
            places = Places(raws[0], self._definitions(found), found.type_name)
        except (ValueError, RecordingError):
            return ()
        shown = []
        for name, code, offset in places.fields():
            value = float(np.frombuffer(raws[0], code, 1, offset)[0])
            shown.append(Column(name, np.dtype(code).name, found.count, example=value))
        return tuple(shown)

    def joint_names(self, topic: str) -> tuple[str, ...]:
        """The names in the first JointState of a topic."""
        found = self.topic(topic)
        raws, _ = self.messages(found, 1)
        if not raws:
            return ()
        places = Places(raws[0], self._definitions(found), found.type_name)
        return tuple(text for _, text in places.texts.get("name", ()))

    def first_rate(self, topic: str, most: int) -> float:
        """As `Bag.first_rate`."""
        _, log_ns = self.messages(self.topic(topic), most)
        seconds = float(np.ptp(log_ns)) / 1e9 if log_ns.size else 0.0
        return (log_ns.size - 1) / seconds if seconds > 0.0 else 0.0

    def read(self, topic: str, fields: Sequence[str], within: int | None = None) -> Series:
        """As `Bag.read`."""
        found = self.topic(topic)
        raws, log_ns = self.messages(found, None if within is None else self._fitting(found, within))
        if not raws:
            raise RecordingError(self.path, f"{topic} has no messages")
        try:
            definitions = self._definitions(found)
            stamped = "header" in dict(definitions[found.type_name][1])
            values, present = extract(raws, definitions, found.type_name, [*fields, *(STAMP if stamped else ())])
        except ValueError as error:
            raise RecordingError(self.path, f"{topic}: {error}") from None
        if not present.any():
            self._refuse(found, raws[0], fields)
        kept = {name: values[name][present] for name in fields}
        stamps = None
        if stamped:
            seconds, nanoseconds = (values[name][present].astype(np.int64) for name in STAMP)
            stamps = seconds * 1_000_000_000 + nanoseconds
            stamps = stamps if stamps.any() else None
        return Series(topic, log_ns[present], stamps, kept, int((~present).sum()))

    def _fitting(self, topic: Topic, size: int) -> int:
        """How many messages of a topic are of so many bytes, by its first one; at least one."""
        raws, _ = self.messages(topic, 1)
        return max(1, size // max(1, len(raws[0]))) if raws else 1

    def _definitions(self, topic: Topic) -> Definitions:
        return _definitions(topic.type_name, *self.definition(topic))

    def _refuse(self, topic: Topic, raw: bytes, fields: Sequence[str]) -> None:
        """Say which field is missing, and what there is."""
        places = Places(raw, self._definitions(topic), topic.type_name)
        missing = [field for field in fields if places.find(field) is None]
        there = listed(name for name, _, _ in places.fields(8))
        why = f" ({places.problem})" if places.problem else ""
        problem = f"{topic.name} ({topic.type_name}) has no number {', '.join(missing)}; it has {there}{why}"
        raise RecordingError(self.path, problem)


@lru_cache(maxsize=64)
def _definitions(type_name: str, text: str, encoding: str) -> Definitions:
    return definitions_of(type_name, text, encoding)
