"""Reads a session back from MCAP, as columns, also from a file whose writer was killed.

The measurements of its follower, as needed to learn from a recording, are kept beside a long one.
"""

from __future__ import annotations

import contextlib
import json
import mmap
import struct
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError, plural
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
    Hello,
    Hellos,
    LeaderState,
    Message,
    ModelUpdate,
    SessionLog,
    Telemetry,
    as_printed,
)
from foretouch.messages.session_log import believable, in_order, side_seconds
from foretouch.messages.states import FollowerRow, LeaderRow
from foretouch.quantities import ByValue, Recording, Rows
from foretouch.recordings.formats import mcap
from foretouch.recordings.formats.cdr import Layout
from foretouch.recordings.formats.topics import COUNTS, TOPICS, TRUNCATED
from foretouch.recordings.output import atomic_path, optional
from foretouch.recordings.source import foreign, one_line, reading

_channel_id = struct.Struct("<H")  # begins a message

NOTHING: Final = "was cut off before anything was flushed"

Wanted: TypeAlias = dict[type[Message], np.dtype[np.void]]  # columns by kind of message

_COLUMNS: Final[Wanted] = {
    LeaderState: LEADER_DTYPE,
    Telemetry: FOLLOWER_DTYPE,
    LeaderRow: LEADER_SPACE_DTYPE,
    FollowerRow: FOLLOWER_SPACE_DTYPE,
}
_KEPT: Final[tuple[type[Message], ...]] = (ModelUpdate, EmergencyStop, FieldUpdate, FixtureBelief, CameraImage)


def _narrowed(whole: np.dtype[np.void], *names: str) -> np.dtype[np.void]:
    return np.dtype([(name, whole[name]) for name in names])


_SAMPLES: Final[Wanted] = {
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
    return within_budget(path, budget, _read, path, _COLUMNS, (*_KEPT, Hello))


def read_samples(path: str | PathLike[str]) -> SessionLog:
    """The same log with those rows and columns only that `follower_samples` looks at: a tenth of the memory."""
    return _read(path, _SAMPLES, ())


def _read(path: str | PathLike[str], columns: Wanted, kept: tuple[type[Message], ...]) -> SessionLog:
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

    def __init__(self, path: str | PathLike[str], columns: Wanted, kept: tuple[type[Message], ...]) -> None:
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
        columns = {
            kind: np.concatenate([np.empty(0, self._columns.get(kind, whole)), *self._parts.pop(kind, ())])
            for kind, whole in _COLUMNS.items()
        }
        return SessionLog(
            columns[LeaderState],
            columns[Telemetry],
            in_order(self._kept[ModelUpdate]),
            self._hellos.settings,
            self._hellos.counts | self.counts,
            tuple(self._kept[EmergencyStop]),
            self._hellos.news,
            leader_space=columns[LeaderRow],
            follower_space=columns[FollowerRow],
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
                remedy = "; `foretouch recordings repair` keeps the others"
                with foreign(self._path, f"the block at byte {start} is damaged", remedy):
                    self._structure(code, data[start:end])
                if isinstance(data, mmap.mmap) and end > _PAGE:  # what has been read takes no memory any more
                    data.madvise(mmap.MADV_DONTNEED, 0, end // _PAGE * _PAGE)
            elif code == mcap.FOOTER:
                ended = data[end : end + len(mcap.MAGIC)] == mcap.MAGIC
                break
        for kind, positions in spans.items():
            self._take(kind, data, positions)
        return ended

    def _structure(self, code: int, content: bytes) -> None:
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
                rows = _rows(data, spans, layout, self._columns[kind])
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


def _rows(data: bytes | mmap.mmap, spans: list[tuple[int, int]], layout: Layout, wanted: np.dtype[np.void]) -> Rows:
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


LARGE = 50_000_000  # size [bytes], some minutes, from which on the samples of a recording are kept in a file beside it

VERSION = 2
"""Version of the form of that file."""


Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FollowerSamples(ByValue):
    """The samples of the follower's process of the longest segment (`SessionLog.longest`), and what is not among them.

    Attributes:
        time: Time since the first of them [s], shape (n,).
        position: Position of the probe [m], shape (n,).
        force: Sensor force, offset included [N], shape (n,).
        faults: Kinds of samples that were left out because the sensors were not to be trusted, `validity` of
            `Telemetry`, shape (k,).
        fault_counts: Number of each, shape (k,).
        segments: Number of segments of the session.
        leader_starts: Number of processes of the leader that were received from.
        follower_starts: Number of processes of the follower.
        seconds: Duration of the longest segment [s].
    """

    time: Array
    position: Array
    force: Array
    faults: NDArray[np.int64]
    fault_counts: NDArray[np.int64]
    segments: int
    leader_starts: int
    follower_starts: int
    seconds: float


def follower_samples(log: SessionLog) -> FollowerSamples:
    """The samples of a session.

    Args:
        log: Of `read_session`, or of `read_samples`.
    """
    follower, segment = log.follower, log.longest()
    if segment.follower.size:
        follower = follower[follower["run"] == segment.follower["run"][0]]
    believed = follower[believable(follower)]
    kinds, counts = np.unique(segment.follower["validity"], return_counts=True)
    begin = believed["time_ns"][0] if believed.size else 0
    return FollowerSamples(
        (believed["time_ns"] - begin) / 1e9,
        believed["position"].astype(np.float64),
        believed["sensor_force"].astype(np.float64),
        kinds[kinds > 0],
        counts[kinds > 0],
        len(log.segments()),
        int(np.unique(log.leader["epoch"]).size),
        int(np.unique(log.follower["run"]).size),
        max(side_seconds(segment.leader), side_seconds(segment.follower)),
    )


def read_follower_samples(path: str | PathLike[str]) -> FollowerSamples:
    """The samples of a session's MCAP file.

    Those of a file of 50 MB or more are kept in a file beside it, `NAME.mcap.samples`, where that can be written, and
    taken from there as long as the recording stays as it is: same length, same time of change.

    Raises:
        RecordingError: As `read_session`.
        MissingExtraError: As `read_session`.
    """
    return within_budget(path, None, _samples_of, path)


def _samples_of(path: str | PathLike[str]) -> FollowerSamples:
    kept = Path(f"{path}.samples")
    label = _label(path)
    if label and kept.is_file():
        with contextlib.suppress(Exception):  # whatever is wrong with what was kept, the recording is still there
            return _load(kept, label)
    samples = follower_samples(read_samples(path))
    if label:
        with contextlib.suppress(RecordingError, OSError):  # a folder that is not ours: then it is read again
            _save(kept, label, samples)
    return samples


def read_follower(path: str | PathLike[str]) -> Recording:
    """The follower's own measurement in a session: positions and the sensor force with its offset.

    Samples whose sensors were not to be trusted are left out, as the session itself learnt nothing from them. Of
    several processes of the follower it is that of the longest segment (`SessionLog.longest`).
    """
    samples = read_follower_samples(path)
    if samples.time.size < 2:
        without = " with sensors that could be believed" if samples.faults.size else ""
        there = plural(samples.time.size, "sample")
        raise RecordingError(path, f"{there} of the follower{without}: at least 2 are needed")
    return Recording(samples.time, samples.position, samples.force, name=str(path))


def _label(path: str | PathLike[str]) -> str:
    """Identity of the recording that a kept file belongs to; empty where none is kept."""
    try:
        about = Path(path).stat()
    except OSError:
        return ""
    return json.dumps([VERSION, about.st_size, about.st_mtime_ns]) if about.st_size >= LARGE else ""


def _load(kept: Path, label: str) -> FollowerSamples:
    """Raises `ValueError` where it is of another recording."""
    with kept.open("rb") as handle, np.load(handle, allow_pickle=False) as file:
        if str(file["label"]) != label:
            raise ValueError("of another recording")
        columns: dict[str, Any] = {one.name: file[one.name] for one in fields(FollowerSamples)}
        return FollowerSamples(**{name: kept if kept.ndim else kept.item() for name, kept in columns.items()})


def _save(kept: Path, label: str, samples: FollowerSamples) -> None:
    columns: dict[str, Any] = {one.name: getattr(samples, one.name) for one in fields(samples)}
    with atomic_path(kept) as beside, beside.open("wb") as file:
        np.savez(file, label=np.array(label), **columns)
