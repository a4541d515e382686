"""Reads a session back from MCAP, as columns, also from a file whose writer was killed."""

from __future__ import annotations

import mmap
import struct
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
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
)
from foretouch.messages.session_log import believable, in_order
from foretouch.quantities import Recording
from foretouch.recordings._extra import optional
from foretouch.recordings.cdr import Layout
from foretouch.recordings.mcap_index import CHANNEL, CHUNK, FOOTER, MAGIC, MESSAGE, METADATA, RECORD, SCHEMA
from foretouch.recordings.topics import COUNTS, TOPICS, TRUNCATED

__all__ = ["read_follower", "read_session"]

_channel_id = struct.Struct("<H")
_MESSAGE_HEADER = 22  # channel 2, sequence 4, log time 8, publish time 8 bytes

NOTHING: Final = "was cut off before anything was flushed"

_COLUMNS: dict[type[Message], np.dtype[np.void]] = {
    LeaderState: LEADER_DTYPE,
    Telemetry: FOLLOWER_DTYPE,
    LeaderSpace: LEADER_SPACE_DTYPE,
    FollowerSpace: FOLLOWER_SPACE_DTYPE,
}
_KEPT: tuple[type[Message], ...] = (ModelUpdate, EmergencyStop, FieldUpdate, FixtureBelief, CameraImage)
_READ: tuple[type[Message], ...] = (*_COLUMNS, *_KEPT, Hello)
_KINDS: dict[str, type[Message]] = {TOPICS[kind].name: kind for kind in _READ}


def read_session(path: str | PathLike[str]) -> SessionLog:
    """The session that an MCAP file of `SessionWriter` holds; every number bit by bit as it was written.

    Settings, counters and news are those of the hello messages of both sides. A file that ends before its index,
    because its writer was killed or still writes, gives all that was flushed, and ``counts["truncated"] = 1``. Fields
    that messages did not have when the file was written have their defaults, and fields that they have no more are
    passed over.

    Raises:
        RecordingError: No such file, no MCAP, no foretouch session in it, another version's, or damaged.
        MissingExtraError: The package ``mcap`` is not installed.
    """
    records, stream = optional("mcap.records"), optional("mcap.stream_reader")
    file = Path(path)
    try:
        with file.open("rb") as handle:
            begins = handle.read(len(MAGIC))
            if begins != MAGIC:
                short = MAGIC.startswith(begins)
                raise RecordingError(path, NOTHING if short else "is no MCAP file: it does not begin like one")
            with mmap.mmap(handle.fileno(), 0, access=mmap.ACCESS_READ) as data:
                scan = _Scan(path, records, stream)
                scan.file(data)
    except OSError as error:
        raise RecordingError(path, f"cannot be read: {error.strerror}") from None
    return scan.log()


def read_follower(path: str | PathLike[str], *, flip: bool = False) -> Recording:
    """The follower's own measurement in a session: positions and the sensor force with its offset.

    Samples whose sensors were not to be trusted are left out, as the session itself learnt nothing from them. Of
    several processes of the follower it is that of the longest stretch (`SessionLog.longest`).

    Raises:
        RecordingError: As `read_session`, or the follower said nothing that could be believed.
    """
    log = read_session(path)
    follower, stretch = log.follower, log.longest().follower
    follower = follower[follower["run"] == stretch["run"][0]] if stretch.size else follower
    believed = follower[believable(follower)]
    if believed.size < 2:
        without = "" if believed.size == follower.size else " with sensors that could be believed"
        raise RecordingError(path, f"{believed.size} samples of the follower{without}: at least 2 are needed")
    time = (believed["time_ns"] - believed["time_ns"][0]) / 1e9
    position = -believed["position"] if flip else believed["position"]
    return Recording(time, position, believed["sensor_force"], name=str(path))


class _Scan:
    """Goes through the records of one file once; `mcap` reads the records, the framing is done here.

    The library's own readers need the index at the end or stop with an error where a file is cut, and hand out one
    object a message, which takes ten times as long.
    """

    def __init__(self, path: str | PathLike[str], records: Any, stream: Any) -> None:
        self._path, self._records, self._stream = path, records, stream
        self._schemas: dict[int, Any] = {}
        self._kinds: dict[int, type[Message]] = {}  # by channel
        self._layouts: dict[type[Message], Layout] = {}
        self._topics: set[str] = set()
        self._parts: dict[type[Message], list[NDArray[np.void]]] = {kind: [] for kind in _COLUMNS}
        self._kept: dict[type[Message], list[Any]] = {kind: [] for kind in _KEPT}
        self._hellos = Hellos()
        self._counts: dict[str, int] = {}  # those of the end

    def file(self, data: mmap.mmap) -> None:
        """Read the whole file, or what there is of it."""
        if not self._records_of(data, len(MAGIC)):
            self._counts |= TRUNCATED

    def log(self) -> SessionLog:
        """What was read."""
        if not self._kinds:
            if self._counts.get("truncated"):
                raise RecordingError(self._path, NOTHING)
            there = ", ".join(sorted(self._topics)) or "none"
            raise RecordingError(self._path, f"holds no foretouch session; its topics: {there}")
        columns = {kind: np.concatenate([np.empty(0, _COLUMNS[kind]), *parts]) for kind, parts in self._parts.items()}
        return SessionLog(
            columns[LeaderState],
            columns[Telemetry],
            in_order(self._kept[ModelUpdate]),
            self._hellos.settings,
            self._hellos.counts | self._counts,
            tuple(self._kept[EmergencyStop]),
            self._hellos.news,
            leader_space=columns[LeaderSpace],
            follower_space=columns[FollowerSpace],
            fields=tuple(self._kept[FieldUpdate]),
            images=tuple(self._kept[CameraImage]),
            beliefs=tuple(self._kept[FixtureBelief]),
        )

    def _records_of(self, data: bytes | mmap.mmap, position: int) -> bool:
        """Read records from a buffer; whether it ends with the file's footer."""
        messages: dict[type[Message], list[tuple[int, int]]] = {}
        ended = False
        while position + RECORD.size <= len(data):
            code, length = RECORD.unpack_from(data, position)
            start = position + RECORD.size
            position = start + length
            if code == 0 or position > len(data):  # a block that was never written, or only in part
                break
            if code == MESSAGE:
                kind = self._kinds.get(_channel_id.unpack_from(data, start)[0])
                if kind is not None:
                    messages.setdefault(kind, []).append((start + _MESSAGE_HEADER, position))
            elif code in (SCHEMA, CHANNEL, CHUNK, METADATA):
                self._structure(code, data[start:position], start)
            elif code == FOOTER:
                ended = data[position : position + len(MAGIC)] == MAGIC
                break
        for kind, spans in messages.items():
            self._take(kind, data, spans)
        return ended

    def _structure(self, code: int, content: bytes, start: int) -> None:
        """Read a record that is no message."""
        try:
            self._read(code, content)
        except RecordingError:
            raise
        except Exception as error:  # mcap, struct and each compression library have their own errors
            problem = f"the block at byte {start} is damaged: {_one_line(error)}"
            raise RecordingError(self._path, f"{problem}; `foretouch recordings repair` keeps the others") from None

    def _read(self, code: int, content: bytes) -> None:
        kinds = {SCHEMA: "Schema", CHANNEL: "Channel", CHUNK: "Chunk", METADATA: "Metadata"}
        record = getattr(self._records, kinds[code]).read(self._stream.ReadDataStream(BytesIO(content)))
        if code == SCHEMA:
            self._schemas[record.id] = record
        elif code == CHANNEL:
            self._channel(record)
        elif code == CHUNK:
            inside, length = self._stream.get_chunk_data_stream(record, validate_crc=True)
            self._records_of(bytes(inside.read(length)), 0)
        elif record.name == COUNTS:
            self._counts |= {name: int(count) for name, count in record.metadata.items()}

    def _channel(self, channel: Any) -> None:
        self._topics.add(channel.topic)
        kind = _KINDS.get(channel.topic)
        schema = self._schemas.get(channel.schema_id)
        if kind is None or schema is None:
            return
        layout = TOPICS[kind].layout.of_schema(bytes(schema.data).decode())
        if schema.name != TOPICS[kind].type_name or layout is None:
            problem = f"{channel.topic} has other fields than this version of foretouch writes: read it with the one"
            raise RecordingError(self._path, f"{problem} that recorded it")
        self._kinds[channel.id], self._layouts[kind] = kind, layout

    def _take(self, kind: type[Message], data: bytes | mmap.mmap, spans: list[tuple[int, int]]) -> None:
        """Decode the messages of one kind in a buffer."""
        layout = self._layouts[kind]
        try:
            if kind in _COLUMNS and layout.dtype is not None:
                self._parts[kind].append(_columns(data, spans, layout, _COLUMNS[kind]))
                return
            for start, end in spans:
                message = layout.unpack(data[start:end])
                if isinstance(message, Hello):
                    self._hellos.take(message)
                else:
                    self._kept[kind].append(message)
        except ValueError as error:
            raise RecordingError(self._path, f"{TOPICS[kind].name}: {_one_line(error)}") from None


def _columns(
    data: bytes | mmap.mmap, spans: list[tuple[int, int]], layout: Layout, wanted: np.dtype[np.void]
) -> NDArray[np.void]:
    """Messages of one fixed size, all at once."""
    stored, edges = layout.dtype, np.array(spans)
    assert stored is not None
    if (edges[:, 1] - edges[:, 0] != stored.itemsize).any():
        raise ValueError(f"a message is not {stored.itemsize} bytes long")
    places = edges[:, :1] + np.arange(stored.itemsize)
    rows = np.frombuffer(data, np.uint8)[places].view(stored)[:, 0]
    table = np.empty(rows.size, wanted)
    for name in wanted.names or ():
        table[name] = rows[name] if name in (stored.names or ()) else layout.missing[name]
    return table


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
