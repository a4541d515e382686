"""Reads an MCAP file of ROS 2 messages, whoever wrote it, with or without its index."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.recordings.formats.bags import RosBag
from foretouch.recordings.formats.mcap_index import (
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    FOOTER,
    MAGIC,
    MESSAGE,
    METADATA,
    METADATA_INDEX,
    RECORD,
    SCHEMA,
    STATISTICS,
    chunk_content,
    message_head,
)
from foretouch.recordings.output import optional
from foretouch.recordings.source import MAP_NAME, Topic, gathered, one_line

_MESSAGE_HEADER: Final = 22  # channel 2, sequence 4, log time 8, publish time 8 bytes
_footer = struct.Struct("<QQI")
_TAIL: Final = RECORD.size + _footer.size + len(MAGIC)
_NAMES: Final = {
    SCHEMA: "Schema",
    CHANNEL: "Channel",
    CHUNK: "Chunk",
    CHUNK_INDEX: "ChunkIndex",
    STATISTICS: "Statistics",
    METADATA: "Metadata",
    METADATA_INDEX: "MetadataIndex",
}


class McapFile(RosBag):
    """An opened MCAP file.

    A file that ends before its index, because its writer was killed or still writes, is read as far as it goes.

    Args:
        path: Of the file.
        peek: Look no further than the first block of a file without index: its topics, as far as that has them.

    Raises:
        RecordingError: It is no MCAP, or damaged.
        MissingExtraError: The packages ``mcap`` or ``rosbags`` are not installed.
        OSError: It cannot be read.
    """

    def __init__(self, path: str | PathLike[str], *, peek: bool = False) -> None:
        super().__init__(path, "MCAP")
        self._records, self._stream = optional("mcap.records"), optional("mcap.stream_reader")
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._counts: dict[int, int] = {}
        self._chunks: list[tuple[int, frozenset[int] | None]] = []  # where each begins, and whose messages it has
        with Path(path).open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise RecordingError(path, "is not an MCAP file: it does not begin as one does")
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                if not self._read_summary(data):
                    self._read_all(data, peek)
        self.topics = gathered(
            Topic(channel.topic, schema.name if schema else "", self._counts.get(number, 0))
            for number, channel in self._channels.items()
            for schema in [self._schemas.get(channel.schema_id)]
        )

    def definition(self, topic: Topic) -> tuple[str, str]:
        """As `RosBag.definition`."""
        channel = next(found for found in self._channels.values() if found.topic == topic.name)
        if channel.message_encoding != "cdr":
            said = channel.message_encoding or "in no stated encoding"
            raise RecordingError(self.path, f"messages of {topic.name} are {said}: only CDR of ROS 2 is read")
        schema = self._schemas.get(channel.schema_id)
        return (bytes(schema.data).decode(errors="replace"), schema.encoding) if schema else ("", "")

    def messages(self, topic: Topic, most: int | None = None) -> tuple[list[bytes], NDArray[np.int64]]:
        """As `RosBag.messages`."""
        wanted = {number for number, channel in self._channels.items() if channel.topic == topic.name}
        raws: list[bytes] = []
        times: list[int] = []
        with Path(self.path).open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            for block in self._blocks(data, wanted):
                for code, start, stop in records(block):
                    if code != MESSAGE:
                        continue
                    channel, _, log_time = message_head.unpack_from(block, start)
                    if channel in wanted:
                        raws.append(block[start + _MESSAGE_HEADER : stop])
                        times.append(log_time)
                        if len(raws) == most:
                            return raws, np.array(times, dtype=np.int64)
        return raws, np.array(times, dtype=np.int64)

    def _blocks(self, data: mmap.mmap, wanted: set[int]) -> Iterator[bytes | mmap.mmap]:
        """The parts of the file that hold messages of some channels."""
        loose = not self._chunks
        for begin, whose in self._chunks:
            if whose is None or whose & wanted:
                _, length = RECORD.unpack_from(data, begin)
                yield self._chunk(data[begin + RECORD.size : begin + RECORD.size + length], begin)
        if loose:
            yield data

    # --- what the file says of itself ---------------------------------------------------------------------------------

    def _read_summary(self, data: mmap.mmap) -> bool:
        """Take the index at the end; whether there is one that serves."""
        if len(data) < len(MAGIC) + _TAIL or data[-len(MAGIC) :] != MAGIC:
            return False
        code, length = RECORD.unpack_from(data, len(data) - _TAIL)
        summary, _, _ = _footer.unpack_from(data, len(data) - _TAIL + RECORD.size)
        if code != FOOTER or length != _footer.size or not len(MAGIC) < summary < len(data):
            return False
        statistics = None
        for code, start, stop in records(data, summary):
            if code in (SCHEMA, CHANNEL):
                self._structure(code, data[start:stop], start)
            elif code == CHUNK_INDEX:
                index = self._parsed(code, data[start:stop], start)
                self._chunks.append((index.chunk_start_offset, frozenset(index.message_index_offsets) or None))
            elif code == STATISTICS:
                statistics = self._parsed(code, data[start:stop], start)
            elif code == METADATA_INDEX:
                self._stated(data, self._parsed(code, data[start:stop], start))
        if statistics is None or (statistics.message_count and not self._channels):
            self._chunks.clear()
            return False
        self._counts = dict(statistics.channel_message_counts)
        self.begin_ns, self.end_ns = statistics.message_start_time, statistics.message_end_time
        return True

    def _stated(self, data: mmap.mmap, index: Any) -> None:
        if index.name == MAP_NAME:
            begin = index.offset + RECORD.size
            record = self._parsed(METADATA, data[begin : index.offset + index.length], index.offset)
            self.stated_map = record.metadata.get("toml", "")

    def _read_all(self, data: mmap.mmap, peek: bool) -> None:
        """Go through the whole file where it has no index."""
        self.whole = data[-len(MAGIC) :] == MAGIC and len(data) > len(MAGIC)
        first: int | None = None
        for code, start, stop in records(data, len(MAGIC)):
            if code == CHUNK:
                self._chunks.append((start - RECORD.size, None))
            block: bytes | mmap.mmap = data
            inside = iter([(code, start, stop)])
            if code == CHUNK:
                block = self._chunk(data[start:stop], start)
                inside = records(block)
            for inner, begin, end in inside:
                if inner in (SCHEMA, CHANNEL):
                    self._structure(inner, block[begin:end], begin)
                elif inner == METADATA:
                    record = self._parsed(inner, block[begin:end], begin)
                    self.stated_map = record.metadata.get("toml", "") if record.name == MAP_NAME else self.stated_map
                elif inner == MESSAGE:
                    channel, _, log_time = message_head.unpack_from(block, begin)
                    self._counts[channel] = self._counts.get(channel, 0) + 1
                    first = log_time if first is None else min(first, log_time)
                    self.end_ns = max(self.end_ns, log_time)
            if code == FOOTER or (peek and code == CHUNK and self._channels):
                break
        self.begin_ns = first or 0

    def _structure(self, code: int, content: bytes, start: int) -> None:
        record = self._parsed(code, content, start)
        if code == SCHEMA:
            self._schemas[record.id] = record
        else:
            self._channels[record.id] = record

    def _parsed(self, code: int, content: bytes, start: int) -> Any:
        try:
            return getattr(self._records, _NAMES[code]).read(self._stream.ReadDataStream(BytesIO(content)))
        except Exception as error:  # mcap and struct have their own errors
            raise RecordingError(self.path, f"the record at byte {start} is damaged: {one_line(error)}") from None

    def _chunk(self, content: bytes, start: int) -> bytes:
        record = self._parsed(CHUNK, content, start)
        try:
            return chunk_content(record)
        except Exception as error:  # each compression library has its own errors
            raise RecordingError(self.path, f"the block at byte {start} is damaged: {one_line(error)}") from None


def records(data: bytes | mmap.mmap, position: int = 0) -> Iterator[tuple[int, int, int]]:
    """What each record is, where its content begins and ends; up to the first that is not there whole."""
    end = len(data)
    position = position or (len(MAGIC) if data[: len(MAGIC)] == MAGIC else 0)
    while position + RECORD.size <= end:
        code, length = RECORD.unpack_from(data, position)
        start = position + RECORD.size
        position = start + length
        if code == 0 or position > end:
            return
        yield code, start, position
