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
    LEADER_DTYPE,
    Hello,
    LeaderState,
    Message,
    ModelUpdate,
    SessionLog,
    Telemetry,
    split_texts,
)
from foretouch.quantities import Recording
from foretouch.recordings._extra import optional
from foretouch.recordings.topics import COUNTS, TOPICS

__all__ = ["read_follower", "read_session"]

MAGIC: Final = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _METADATA = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0C
_record = struct.Struct("<BQ")  # operation code, length of what follows
_channel_id = struct.Struct("<H")
_MESSAGE_HEADER = 22  # channel 2, sequence 4, log time 8, publish time 8 bytes

_COLUMNS: dict[type[Message], np.dtype[np.void]] = {LeaderState: LEADER_DTYPE, Telemetry: FOLLOWER_DTYPE}
_KINDS: dict[str, type[Message]] = {TOPICS[kind].name: kind for kind in (LeaderState, Telemetry, ModelUpdate, Hello)}


def read_session(path: str | PathLike[str]) -> SessionLog:
    """The session that an MCAP file of `SessionWriter` holds; every number bit by bit as it was written.

    Settings are those of the hello messages of both sides. A file that ends before its index, because its writer was
    killed, gives all that was flushed, and ``counts["truncated"] = 1``.

    Raises:
        RecordingError: No such file, no MCAP, no foretouch session in it, another version's, or damaged.
        MissingExtraError: The package ``mcap`` is not installed.
    """
    records, stream = optional("mcap.records"), optional("mcap.stream_reader")
    file = Path(path)
    try:
        with file.open("rb") as handle:
            if handle.read(len(MAGIC)) != MAGIC:
                raise RecordingError(path, "is no MCAP file: it does not begin like one")
            with mmap.mmap(handle.fileno(), 0, access=mmap.ACCESS_READ) as data:
                scan = _Scan(path, records, stream)
                scan.file(data)
    except OSError as error:
        raise RecordingError(path, f"cannot be read: {error.strerror}") from None
    return scan.log()


def read_follower(path: str | PathLike[str], *, flip: bool = False) -> Recording:
    """The follower's own measurement in a session: positions and the sensor force with its offset.

    Raises:
        RecordingError: As `read_session`, or the follower said nothing.
    """
    follower = read_session(path).follower
    if follower.size < 2:
        raise RecordingError(path, f"{follower.size} samples of the follower: at least 2 are needed")
    time = (follower["time_ns"] - follower["time_ns"][0]) / 1e9
    position = -follower["position"] if flip else follower["position"]
    return Recording(time, position, follower["sensor_force"], name=str(path))


class _Scan:
    """Goes through the records of one file once; `mcap` reads the records, the framing is done here.

    The library's own readers need the index at the end or stop with an error where a file is cut, and hand out one
    object a message, which takes ten times as long.
    """

    def __init__(self, path: str | PathLike[str], records: Any, stream: Any) -> None:
        self._path, self._records, self._stream = path, records, stream
        self._schemas: dict[int, Any] = {}
        self._kinds: dict[int, type[Message]] = {}  # by channel
        self._topics: set[str] = set()
        self._parts: dict[type[Message], list[NDArray[np.void]]] = {kind: [] for kind in _COLUMNS}
        self._models: list[ModelUpdate] = []
        self._settings: dict[str, str] = {}
        self._counts: dict[str, int] = {}

    def file(self, data: mmap.mmap) -> None:
        """Read the whole file, or what there is of it."""
        if not self._records_of(data, len(MAGIC)):
            self._counts["truncated"] = 1

    def log(self) -> SessionLog:
        """What was read."""
        if not self._kinds:
            if self._counts.get("truncated"):
                raise RecordingError(self._path, "was cut off before anything was flushed")
            there = ", ".join(sorted(self._topics)) or "none"
            raise RecordingError(self._path, f"holds no foretouch session; its topics: {there}")
        columns = {kind: np.concatenate([np.empty(0, _COLUMNS[kind]), *parts]) for kind, parts in self._parts.items()}
        models = tuple(sorted(self._models, key=lambda model: model.sequence))
        return SessionLog(columns[LeaderState], columns[Telemetry], models, self._settings, self._counts)

    def _records_of(self, data: bytes | mmap.mmap, position: int) -> bool:
        """Read records from a buffer; whether it ends with the file's footer."""
        messages: dict[type[Message], list[tuple[int, int]]] = {}
        ended = False
        while position + _record.size <= len(data):
            code, length = _record.unpack_from(data, position)
            start = position + _record.size
            position = start + length
            if code == 0 or position > len(data):  # a block that was never written, or only in part
                break
            if code == _MESSAGE:
                kind = self._kinds.get(_channel_id.unpack_from(data, start)[0])
                if kind is not None:
                    messages.setdefault(kind, []).append((start + _MESSAGE_HEADER, position))
            elif code in (_SCHEMA, _CHANNEL, _CHUNK, _METADATA):
                self._structure(code, data[start:position], start)
            elif code == _FOOTER:
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
            raise RecordingError(self._path, f"the block at byte {start} is damaged: {_one_line(error)}") from None

    def _read(self, code: int, content: bytes) -> None:
        kinds = {_SCHEMA: "Schema", _CHANNEL: "Channel", _CHUNK: "Chunk", _METADATA: "Metadata"}
        record = getattr(self._records, kinds[code]).read(self._stream.ReadDataStream(BytesIO(content)))
        if code == _SCHEMA:
            self._schemas[record.id] = record
        elif code == _CHANNEL:
            self._channel(record)
        elif code == _CHUNK:
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
        ours = TOPICS[kind]
        if (schema.name, bytes(schema.data)) != (ours.type_name, ours.layout.schema.encode()):
            problem = f"{channel.topic} has other fields than this version of foretouch writes: read it with the one"
            raise RecordingError(self._path, f"{problem} that recorded it")
        self._kinds[channel.id] = kind

    def _take(self, kind: type[Message], data: bytes | mmap.mmap, spans: list[tuple[int, int]]) -> None:
        """Decode the messages of one kind in a buffer."""
        layout = TOPICS[kind].layout
        try:
            if layout.dtype is not None:
                self._parts[kind].append(_columns(data, spans, layout.dtype, _COLUMNS[kind]))
                return
            for start, end in spans:
                message = layout.unpack(data[start:end])
                if isinstance(message, ModelUpdate):
                    self._models.append(message)
                elif isinstance(message, Hello):
                    settings, counts = split_texts(dict(zip(message.names, message.values, strict=False)))
                    self._settings |= settings
                    self._counts |= counts
        except ValueError as error:
            raise RecordingError(self._path, f"{TOPICS[kind].name}: {_one_line(error)}") from None


def _columns(
    data: bytes | mmap.mmap, spans: list[tuple[int, int]], stored: np.dtype[np.void], wanted: np.dtype[np.void]
) -> NDArray[np.void]:
    """Messages of one fixed size, all at once."""
    edges = np.array(spans)
    if (edges[:, 1] - edges[:, 0] != stored.itemsize).any():
        raise ValueError(f"a message is not {stored.itemsize} bytes long")
    places = edges[:, :1] + np.arange(stored.itemsize)
    rows = np.frombuffer(data, np.uint8)[places].view(stored)[:, 0]
    table = np.empty(rows.size, wanted)
    for name in wanted.names or ():
        table[name] = rows[name]
    return table


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
