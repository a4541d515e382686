"""What an opened recording shows of itself before it is read: a table with columns, or a bag with topics."""

from __future__ import annotations

import difflib
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from os import PathLike
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.quantities import ByValue

MAP_NAME: Final = "foretouch_map"  # under this name files of `convert_recording` carry the map that reads them

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Column:
    """One column of a table, or one number in the messages of a topic; None where only reading tells."""

    name: str
    kind: str
    count: int | None = None
    unit: str = ""
    example: float | None = None
    smallest: float | None = None
    largest: float | None = None


@dataclass(frozen=True)
class Topic:
    """One topic of a bag."""

    name: str
    type_name: str
    count: int


@dataclass(frozen=True)
class Series(ByValue):
    """Numbers out of the messages of one topic in the file's order; times in ns, stamps None where none are set."""

    topic: str
    log_ns: NDArray[np.int64]
    stamp_ns: NDArray[np.int64] | None
    values: dict[str, Array]
    left_out: int = 0


class Table(ABC):
    """An opened table.

    Attributes:
        path: Path of the file.
        format: Name of the format, for people.
        columns: All that hold numbers, or may.
        first_row: Row of the first sample, as messages count.
        stated_map: Text of the map that the file carries, or empty.
        notes: Sentences on what was passed over.
    """

    path: str | PathLike[str]
    format: str
    columns: tuple[Column, ...]
    first_row: int = 1
    stated_map: str = ""
    notes: tuple[str, ...] = ()

    @abstractmethod
    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Columns by name, all of one length.

        Raises:
            RecordingError: A column is missing or holds no numbers, or their lengths differ.
        """

    def row_of(self, sample: int) -> int:
        """Row of a sample in the file."""
        return self.first_row + sample


@dataclass(eq=False)
class Bag(ABC):
    """An opened bag."""

    path: str | PathLike[str]  # path of the file or folder
    format: str = ""  # name of the format, for people
    topics: tuple[Topic, ...] = ()  # all of them
    begin_ns: int = 0  # log time of the first message [ns]
    end_ns: int = 0  # log time of the last message [ns]
    whole: bool = True  # whether it was ended by its recorder
    stated_map: str = field(default="", repr=False)  # text of the map that the file carries, or empty

    @property
    def duration(self) -> float:
        """From the first to the last message [s]."""
        return (self.end_ns - self.begin_ns) / 1e9

    @abstractmethod
    def fields(self, topic: str) -> tuple[Column, ...]:
        """The numbers in the first message of a topic; empty where there is none, or its type is not known."""

    @abstractmethod
    def read(self, topic: str, fields: Sequence[str], within: int | None = None) -> Series:
        """Fields of all messages of a topic.

        Args:
            topic: Its name.
            fields: None for the times alone.
            within: About the number of bytes of messages, the first ones, that are read; all without it.
        """

    @abstractmethod
    def first_rate(self, topic: str, most: int) -> float:
        """How often the first `most` messages of a topic come [1/s]; 0 where there are not two, or at one time."""

    def topic(self, name: str) -> Topic:
        """A topic by its name."""
        results = [topic for topic in self.topics if topic.name == name]
        if not results:
            raise RecordingError(self.path, f"no topic {name}; {_nearest(name, self.topics)}")
        if len({topic.type_name for topic in results}) > 1:
            types = ", ".join(topic.type_name for topic in results)
            raise RecordingError(self.path, f"{name} has messages of several types: {types}: keep one of them")
        return results[0]


def gathered(topics: Iterable[Topic]) -> tuple[Topic, ...]:
    """The topics, those that several publishers had (channels of one name and type) as one."""
    counts: Counter[tuple[str, str]] = Counter()
    for topic in topics:
        counts[topic.name, topic.type_name] += topic.count
    return tuple(Topic(*key, count) for key, count in counts.items())


def require_names(
    source: object, there: Sequence[str], names: Iterable[str], *, row: int | None = None, hint: str = ""
) -> None:
    """Refuse a table in which a column is missing, or there twice."""
    missing = [name for name in names if name not in there]
    if missing:
        problem = f"column {', '.join(missing)} missing; the columns are {listed(there)}{hint}"
        raise RecordingError(source, problem, row=row)
    for name in names:
        if there.count(name) > 1:
            raise RecordingError(source, f"column {name} is there {there.count(name)} times", row=row)


def listed(names: Iterable[str], longest: int = 200) -> str:
    """Names for a message, cut where they become long."""
    text = ", ".join(repr(name)[1:-1] for name in names) or "none"
    return text if len(text) <= longest else text[:longest] + " ..."


def one_line(error: Exception) -> str:
    """The text of an error of another library."""
    return " ".join(str(error).split()) or type(error).__name__


@contextmanager
def reading(path: object) -> Iterator[None]:
    """What the operating system refuses, as a `RecordingError`."""
    try:
        yield
    except OSError as error:
        raise RecordingError(path, f"cannot be read: {error.strerror or error}") from None


@contextmanager
def foreign(path: object, problem: str, remedy: str = "") -> Iterator[None]:
    """What a library raises on a damaged or foreign file, of many kinds, as a `RecordingError` of one line."""
    try:
        yield
    except RecordingError:
        raise
    except Exception as error:
        raise RecordingError(path, f"{problem}: {one_line(error)}{remedy}") from None


def _nearest(name: str, topics: Sequence[Topic]) -> str:
    names = [topic.name for topic in topics]
    if len(names) <= 10:
        return f"there are {listed(names)}"
    near = difflib.get_close_matches(name, names, n=5, cutoff=0.3)
    return f"of {len(names)} the nearest are {listed(near)}; `foretouch recordings inspect` lists them"
