"""What a recording holds, without reading all of it: columns or topics, and the map that can be guessed."""

from __future__ import annotations

import contextlib
from dataclasses import astuple, dataclass, replace
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError, plural
from foretouch.files import within_budget
from foretouch.quantities import Brief, Recording
from foretouch.recordings.formats.published import (
    AURORA_CONTACT_FLOOR,
    LEVER,
    TORQUE_PER_VOLT,
    TUE_CONTACT_FLOOR,
    is_tue,
    read_aurora,
    read_excerpt,
    recording_of,
)
from foretouch.recordings.formats.topics import TOPICS
from foretouch.recordings.meaning.guess import Guess, guess_mapping
from foretouch.recordings.meaning.mapped import clocks_of
from foretouch.recordings.meaning.mapping import TIMES, Mapping, Signal, TimeSource
from foretouch.recordings.meaning.names import name_says
from foretouch.recordings.reading import is_session, open_source, require_readable
from foretouch.recordings.source import Bag, Column, Table, Topic

FIRST_LOOK = 2**18  # bytes of a topic's first messages, which tell which clock stamps them
LONG_LOOK = 2**28  # bytes of messages that are looked through of a topic that was asked for
COLUMN_KEYS = ("column", "type", "count", "unit", "example", "smallest", "largest")  # of a `Column` in JSON


@dataclass(frozen=True)
class Contents(Brief):
    """Contents of a file.

    Attributes:
        path: Path of the file.
        format: Name of the format, for people.
        columns: Columns of a table; of a bag those of one topic, where it was asked for.
        topics: Topics of a bag; those that the guess takes come first, then by count.
        begin_ns: Log time of a bag's first message [ns], None where there is none.
        duration_s: Time from first to last [s]; None where only reading gives it, or nothing has a time.
        rate: Samples of a table a second [1/s], None likewise.
        stated: Why no map is needed, or empty.
        guess: The map as far as it can be guessed, None where none is needed.
        notes: Sentences on what is special.
    """

    path: str
    format: str
    columns: tuple[Column, ...] = ()
    topics: tuple[Topic, ...] = ()
    begin_ns: int | None = None
    duration_s: float | None = None
    rate: float | None = None
    stated: str = ""
    guess: Guess | None = None
    notes: tuple[str, ...] = ()

    def rate_of(self, topic: Topic) -> float | None:
        """Messages of a topic a second, over the whole bag [1/s]."""
        return (topic.count - 1) / self.duration_s if topic.count > 1 and self.duration_s else None

    def as_json(self) -> dict[str, Any]:
        """All of it as plain values."""
        guess = self.guess
        return {
            "path": self.path,
            "format": self.format,
            "begin_ns": self.begin_ns,
            "duration_s": self.duration_s,
            "rate_per_s": self.rate,
            "topics": [
                {"topic": topic.name, "type": topic.type_name, "count": topic.count, "rate_per_s": self.rate_of(topic)}
                for topic in self.topics
            ],
            "columns": [dict(zip(COLUMN_KEYS, astuple(one), strict=True)) for one in self.columns],
            "stated": self.stated,
            "map": None if guess is None else guess.text(),
            "open": None if guess is None else list(guess.open),
            "notes": list(self.notes),
        }


def inspect_recording(path: str | PathLike[str], topic: str | None = None, *, budget: float | None = None) -> Contents:
    """Look into a recording.

    Args:
        path: As `read_recording` takes it.
        topic: Topic of a bag whose fields are wanted too.
        budget: As `read_recording` takes it.

    Raises:
        RecordingError: It cannot be opened, or there is no such topic.
        MissingExtraError: The format needs a package of the extra ``recordings``.
    """
    return within_budget(path, budget, _inspect, path, require_readable(path), topic)


def _inspect(path: str | PathLike[str], suffix: str, topic: str | None) -> Contents:
    if suffix == ".ddf":
        return _of_aurora(path)
    if suffix == ".npz":
        return _of_excerpt(path)
    source = open_source(path)
    return _of_table(source, suffix) if isinstance(source, Table) else _of_bag(source, topic)


def _of_aurora(path: str | PathLike[str]) -> Contents:
    recording = read_aurora(path)
    columns = (Column("AI0", "length", len(recording), "mm"), Column("AI1", "force", len(recording), "mN"))
    stated = f"an Aurora file states columns and units itself; contact floor {AURORA_CONTACT_FLOOR:g} N"
    return Contents(str(path), "Aurora .ddf", columns, stated=stated, **_span(recording))


def _of_excerpt(path: str | PathLike[str]) -> Contents:
    about, columns = read_excerpt(path)
    units = {"time": "s", "force": "N", "logged_force": "N"}
    shown = (Column(name, "count", values.size, units.get(name, "m")) for name, values in columns.items())
    stated = f"an excerpt of {about.name}, which needs no map; contact floor {about.contact_floor:g} N"
    notes = (f"made from {about.original}, SHA-256 {about.sha256}", f"licence: {about.licence}")
    return Contents(str(path), "excerpt", tuple(shown), stated=stated, notes=notes, **_span(recording_of(path)))


def _of_table(table: Table, suffix: str) -> Contents:
    tue = suffix == ".mat" and is_tue(table.path)
    guess, stated = _tue_guess(table) if tue else guess_mapping(table), tue * "a TU/e recording, which needs no map"
    columns = tuple(replace(one, unit=name_says(one.name, one.unit).unit) for one in table.columns)
    duration = rate = None
    time = guess.time if guess.stated is None else guess.stated.time
    values, notes = _taken(table, guess, time.column)
    notes = [*table.notes, *notes, *_missing(table, values)]
    if time.column in values:
        notes += _backwards(table, time.column, values[time.column])
        seconds = values[time.column] / TIMES[time.unit]
        columns = tuple(replace(one, count=seconds.size) if one.count is None else one for one in columns)
        if seconds.size > 1 and np.isfinite(seconds).all():
            duration = float(seconds[-1] - seconds[0])
            step = float(np.median(np.diff(seconds)))
            rate = 1.0 / step if step > 0.0 else None
    if rate is not None and not 1.0 <= rate <= 1e5 and not stated:
        notes.append(f"{rate:.4g} samples a second: is the unit of time {time.unit}?")
    return Contents(
        str(table.path), table.format, columns, duration_s=duration, rate=rate, stated=stated, guess=guess,
        notes=tuple(notes),
    )  # fmt: skip


def _taken(table: Table, guess: Guess, time: str) -> tuple[dict[str, NDArray[np.float64]], list[str]]:
    """The columns that the guess takes, as far as they can be read, and why others cannot."""
    signals = (guess.position, guess.force, guess.velocity)
    there = {column.name for column in table.columns}
    wanted = dict.fromkeys([time, *(signal.column for signal in signals if signal is not None)])
    names = [name for name in wanted if name in there]
    with contextlib.suppress(RecordingError):
        return (table.read(names) if names else {}), []
    values: dict[str, NDArray[np.float64]] = {}
    notes = []
    for name in names:
        try:
            values |= table.read([name])
        except RecordingError as error:
            notes.append(str(error))
    return values, notes


def _missing(table: Table, columns: dict[str, NDArray[np.float64]]) -> list[str]:
    notes = []
    for name, values in columns.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            row = table.row_of(int(bad[0]))
            count = f"{bad.size:,} of {plural(values.size, 'value')} {'is' if bad.size == 1 else 'are'}"
            notes.append(f"{table.path}, row {row}: {name} is {values[bad[0]]:g}; {count} no finite number")
    return notes


def _backwards(table: Table, name: str, time: NDArray[np.float64]) -> list[str]:
    late = np.flatnonzero(np.diff(time) <= 0.0) + 1
    if not late.size:
        return []
    row, before, now = table.row_of(int(late[0])), time[late[0] - 1], time[late[0]]
    text = f"stands still at {now:.9g}" if now == before else f"goes back from {before:.9g} to {now:.9g}"
    more = f", the first of {late.size:,} rows in which it does not increase" if late.size > 1 else ""
    return [f"{table.path}, row {row}: {name} {text}{more}"]


def _tue_guess(table: Table) -> Guess:
    """What `read_tue` does with the raw force bridge, as a map."""
    mapping = Mapping(
        Signal(column="scope.signals[0].values[1]", unit="rad", scale=LEVER),
        Signal(column="env_est3.signals[2].values", unit="raw", scale=TORQUE_PER_VOLT / LEVER),
        TimeSource(column="scope.time"),
        contact_floor=TUE_CONTACT_FLOOR,
    )
    return Guess(table.path, mapping.time, mapping.position, mapping.force, stated=mapping)


def _of_bag(bag: Bag, topic: str | None) -> Contents:
    session = is_session(bag.path) and any(one.name in {own.name for own in TOPICS.values()} for one in bag.topics)
    guess = None if session else guess_mapping(bag)
    chosen = [signal.topic for signal in (guess.position, guess.force) if signal is not None] if guess else []
    notes = [] if bag.whole else ["was not ended by its recorder: read as far as it goes"]
    notes += [*_clock_note(bag, list(dict.fromkeys(chosen))), *(guess.notes if guess else ())]
    columns: tuple[Column, ...] = ()
    if topic is not None:
        columns, looked_at = _looked_through(bag, topic, bag.fields(topic))
        if 0 < looked_at < bag.topic(topic).count:
            notes.append(f"{topic}: smallest and largest are those of the first {looked_at} messages")
    held = any(one.count for one in bag.topics)
    notes += [] if held else ["holds no messages"]
    topics = tuple(sorted(bag.topics, key=lambda one: (one.name not in chosen, -one.count, one.name)))
    begin, duration = (bag.begin_ns, bag.duration) if held else (None, None)
    stated = session * "a session of foretouch, which needs no map"
    return Contents(
        str(bag.path), bag.format, columns, topics, begin, duration, stated=stated, guess=guess, notes=tuple(notes)
    )


def _looked_through(bag: Bag, topic: str, columns: tuple[Column, ...]) -> tuple[tuple[Column, ...], int]:
    """The fields of a topic with the range of their values, and of how many messages that is."""
    try:
        series = bag.read(topic, [column.name for column in columns], within=LONG_LOOK)
    except RecordingError:
        return columns, 0  # their reader reports why
    finite = {name: values[np.isfinite(values)] for name, values in series.values.items()}
    ranges: dict[str, dict[str, Any]] = {
        name: {"smallest": float(some.min()), "largest": float(some.max())}
        for name, some in finite.items()
        if some.size
    }
    return tuple(replace(one, **ranges.get(one.name, {})) for one in columns), series.log_ns.size + series.left_out


def _clock_note(bag: Bag, topics: list[str]) -> list[str]:
    with contextlib.suppress(RecordingError):  # the reader of the whole reports why
        clocks = clocks_of([bag.read(topic, [], within=FIRST_LOOK) for topic in topics]) if len(topics) > 1 else None
        if clocks is not None and clocks.differ:
            return [f"header stamps begin {clocks.apart:.6g} s apart: two clocks? ({clocks.text})"]
    return []


def _span(recording: Recording) -> dict[str, Any]:
    time = recording.time
    return {"duration_s": float(time[-1] - time[0]), "rate": float(1.0 / np.median(np.diff(time)))}
