"""Reads a session back from MCAP, as columns, also from a file whose writer was killed."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np

from foretouch.errors import RecordingError
from foretouch.errors.checks import require_path
from foretouch.files import within_budget
from foretouch.messages import (
    FOLLOWER_DTYPE,
    FOLLOWER_SPACE_DTYPE,
    LEADER_DTYPE,
    LEADER_SPACE_DTYPE,
    CameraImage,
    EmergencyStop,
    FieldUpdate,
    FixtureBelief,
    FollowerSpace,
    Hello,
    Hellos,
    LeaderSpace,
    LeaderState,
    Message,
    ModelUpdate,
    SessionLog,
    Telemetry,
    as_printed,
)
from foretouch.messages.session_log import in_order
from foretouch.quantities import Rows
from foretouch.recordings.formats import mcap
from foretouch.recordings.formats.cdr import Layout
from foretouch.recordings.formats.topics import COUNTS, TOPICS, TRUNCATED
from foretouch.recordings.output import optional
from foretouch.recordings.source import one_line, reading

_channel_id = struct.Struct("<H")  # begins a message

NOTHING: Final = "was cut off before anything was flushed"

_COLUMNS: Final[dict[type[Message], np.dtype[np.void]]] = {
    LeaderState: LEADER_DTYPE,
    Telemetry: FOLLOWER_DTYPE,
    LeaderSpace: LEADER_SPACE_DTYPE,
    FollowerSpace: FOLLOWER_SPACE_DTYPE,
}
_KEPT: Final[tuple[type[Message], ...]] = (
    ModelUpdate,
    EmergencyStop,
    FieldUpdate,
    FixtureBelief,
    CameraImage,
)


def _narrowed(whole: np.dtype[np.void], *names: str) -> np.dtype[np.void]:
    return np.dtype([(name, whole[name]) for name in names])


_SAMPLES: Final[dict[type[Message], np.dtype[np.void]]] = {
    LeaderState: _narrowed(LEADER_DTYPE, "epoch", "run", "time_ns"),
    Telemetry: _narrowed(FOLLOWER_DTYPE, "epoch", "run", "time_ns", "validity", "position", "sensor_force"),
}
"""Columns that the follower's samples are found by; of leader's rows, the first and the last of each process in a block
are enough."""

_PAGE: Final = mmap.ALLOCATIONGRANULARITY


def read_session(path: str | PathLike[str], *, budget: float | None = None) -> SessionLog:
    """The session that an MCAP file of `SessionWriter` holds; every number bit by bit as it was written.

    Settings, counters and news are those of the hello messages of both sides. A file that ends before its index,
    because its writer was killed or still writes, gives all that was flushed, and ``counts["truncated"] = 1``. Fields
    that messages did not have when the file was written have their defaults, and fields that they have no more are
    passed over.

    Args:
        path: The file.
        budget: How many times the usual memory and time its reading may take (`foretouch.files.budget_for`).

    Raises:
        RecordingError: No such file, no MCAP, no foretouch session in it, another version's, damaged, or over the
            budget.
        ArgumentTypeError: A path that is none.
        MissingExtraError: The package ``mcap`` is not installed.
    """
    require_path("path", path)
    return within_budget(path, budget, _read_all, path)


def _read_all(path: str | PathLike[str]) -> SessionLog:
    return _read(path, _COLUMNS, (*_KEPT, Hello))


def read_samples(path: str | PathLike[str]) -> SessionLog:
    """The same log with those rows and columns only that `follower_samples` looks at: a tenth of the memory."""
    return _read(path, _SAMPLES, ())


def _read(
    path: str | PathLike[str], columns: Mapping[type[Message], np.dtype[np.void]], kept: tuple[type[Message], ...]
) -> SessionLog:
    optional("mcap.records")
    with reading(path), Path(path).open("rb") as handle:
        begins = handle.read(len(mcap.MAGIC))
        if begins != mcap.MAGIC:
            short = mcap.MAGIC.startswith(begins)
            raise RecordingError(path, NOTHING if short else "is not an MCAP file: it does not begin as one does")
        with mmap.mmap(handle.fileno(), 0, access=mmap.ACCESS_READ) as data:
            scan = _Scan(path, columns, kept)
            if not scan.records_of(data, len(mcap.MAGIC)):
                scan.counts |= TRUNCATED
    return scan.log()


class _Scan:
    """Goes through the records of one file once; `mcap` reads the records, the framing is done here.

    The library's own readers need the index at the end or stop with an error where a file is cut, and hand out one
    object a message, which takes ten times as long.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        columns: Mapping[type[Message], np.dtype[np.void]],
        kept: tuple[type[Message], ...],
    ) -> None:
        self._path, self._columns = path, columns
        self._wanted = {TOPICS[kind].name: kind for kind in (*columns, *kept)}
        self._schemas: dict[int, Any] = {}
        self._kinds: dict[int, type[Message]] = {}  # by channel
        self._layouts: dict[type[Message], Layout] = {}
        self._topics: set[str] = set()
        self._parts: dict[type[Message], list[Rows]] = {kind: [] for kind in columns}
        self._kept: dict[type[Message], list[Any]] = {kind: [] for kind in _KEPT}
        self._hellos = Hellos()
        self.counts: dict[str, int] = {}  # those of the end

    def log(self) -> SessionLog:
        """What was read."""
        if not self._kinds:
            if self.counts.get("truncated"):
                raise RecordingError(self._path, NOTHING)
            there = ", ".join(sorted(self._topics)) or "none"
            raise RecordingError(self._path, f"holds no foretouch session; its topics: {there}")
        columns = {kind: np.empty(0, whole) for kind, whole in _COLUMNS.items()}
        for kind, wanted in self._columns.items():
            columns[kind] = np.concatenate([np.empty(0, wanted), *self._parts.pop(kind)])
        return SessionLog(
            columns[LeaderState],
            columns[Telemetry],
            in_order(self._kept[ModelUpdate]),
            self._hellos.settings,
            self._hellos.counts | self.counts,
            tuple(self._kept[EmergencyStop]),
            self._hellos.news,
            leader_space=columns[LeaderSpace],
            follower_space=columns[FollowerSpace],
            fields=tuple(self._kept[FieldUpdate]),
            images=tuple(self._kept[CameraImage]),
            beliefs=tuple(self._kept[FixtureBelief]),
            reports=self._hellos.reports,
        )

    def records_of(self, data: bytes | mmap.mmap, position: int) -> bool:
        """Read records from a buffer; whether it ends with the file's footer."""
        spans: dict[type[Message], list[tuple[int, int]]] = {}
        ended = False
        for code, start, end in mcap.records_in(data, position):
            if code == mcap.MESSAGE:
                kind = self._kinds.get(_channel_id.unpack_from(data, start)[0])
                if kind is not None:
                    spans.setdefault(kind, []).append((start + mcap.MESSAGE_HEAD.size, end))
            elif code in (mcap.SCHEMA, mcap.CHANNEL, mcap.CHUNK, mcap.METADATA):
                self._structure(code, data[start:end], start)
                if isinstance(data, mmap.mmap) and end > _PAGE:  # what has been read takes no memory any more
                    data.madvise(mmap.MADV_DONTNEED, 0, end // _PAGE * _PAGE)
            elif code == mcap.FOOTER:
                ended = data[end : end + len(mcap.MAGIC)] == mcap.MAGIC
                break
        for kind, positions in spans.items():
            self._take(kind, data, positions)
        return ended

    def _structure(self, code: int, content: bytes, start: int) -> None:
        try:
            self._read(code, content)
        except RecordingError:
            raise
        except Exception as error:  # mcap, struct and each compression library raise different errors
            problem = f"the block at byte {start} is damaged: {one_line(error)}"
            raise RecordingError(self._path, f"{problem}; `foretouch recordings repair` keeps the others") from None

    def _read(self, code: int, content: bytes) -> None:
        record = mcap.parsed(code, content)
        if code == mcap.SCHEMA:
            self._schemas[record.id] = record
        elif code == mcap.CHANNEL:
            self._channel(record)
        elif code == mcap.CHUNK:
            self.records_of(mcap.chunk_content(record), 0)
        elif record.name == COUNTS:
            self.counts |= {name: int(count) for name, count in record.metadata.items()}

    def _channel(self, channel: Any) -> None:
        self._topics.add(channel.topic)
        kind = self._wanted.get(channel.topic)
        schema = self._schemas.get(channel.schema_id)
        if kind is None or schema is None:
            return
        layout = TOPICS[kind].layout.of_schema(bytes(schema.data).decode())
        if schema.name not in (TOPICS[kind].type_name, TOPICS[kind].former) or layout is None:
            problem = f"{channel.topic} has other fields than this version of foretouch writes: read it with the one"
            raise RecordingError(self._path, f"{problem} that recorded it")
        self._kinds[channel.id], self._layouts[kind] = kind, layout

    def _take(self, kind: type[Message], data: bytes | mmap.mmap, spans: list[tuple[int, int]]) -> None:
        layout = self._layouts[kind]
        try:
            if kind in self._columns and layout.dtype is not None:
                rows = _columns(data, spans, layout, self._columns[kind])
                narrow = kind is LeaderState and self._columns is _SAMPLES
                self._parts[kind].append(_ends(rows) if narrow else rows)
                return
            for start, end in spans:
                message = as_printed(layout.unpack(data[start:end]))
                if isinstance(message, Hello):
                    self._hellos.take(message)
                else:
                    self._kept[kind].append(message)
        except ValueError as error:
            raise RecordingError(self._path, f"{TOPICS[kind].name}: {one_line(error)}") from None


def _columns(data: bytes | mmap.mmap, spans: list[tuple[int, int]], layout: Layout, wanted: np.dtype[np.void]) -> Rows:
    """Messages of one fixed size, all at once."""
    stored, edges = layout.dtype, np.array(spans)
    assert stored is not None
    if (edges[:, 1] - edges[:, 0] != stored.itemsize).any():
        raise ValueError(f"a message is not {stored.itemsize} bytes long")
    content, table = np.frombuffer(data, np.uint8), np.empty(len(edges), wanted)
    fields = dict(stored.fields or {})
    for name in wanted.names or ():
        if name not in fields:
            table[name] = layout.missing[name]
            continue
        kind, offset = fields[name][:2]
        indices = edges[:, :1] + (offset + np.arange(kind.itemsize))
        table[name] = content[indices].view(kind)[:, 0]
    return table


def _ends(rows: Rows) -> Rows:
    """The first and the last of those rows that follow one another and are of the same processes."""
    new = np.ones(rows.size, dtype=np.bool_)
    new[1:] = (np.diff(rows["epoch"]) != 0) | (np.diff(rows["run"]) != 0)
    return rows[new | np.roll(new, -1)]
