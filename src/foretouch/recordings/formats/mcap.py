"""MCAP: the framing of its records, and a file of ROS 2 messages by any writer, with or without its index."""

from __future__ import annotations

import mmap
import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from io import BytesIO
from itertools import islice
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.recordings.formats.bags import RosBag
from foretouch.recordings.output import optional
from foretouch.recordings.source import MAP_NAME, Topic, foreign, gathered

MAGIC: Final = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 0x02, 0x03, 0x04, 0x05, 0x06, 0x07
CHUNK_INDEX, ATTACHMENT, ATTACHMENT_INDEX, STATISTICS = 0x08, 0x09, 0x0A, 0x0B
METADATA, METADATA_INDEX, DATA_END = 0x0C, 0x0D, 0x0F
RECORD: Final = struct.Struct("<BQ")  # in front of each record: what it is, length of what follows
MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
"""Begins the content of a message: channel, sequence, log time, publish time; the rest is its bytes."""
FOOTER_CONTENT: Final = struct.Struct("<QQI")
"""Where the index begins, where the table of its groups does, and the check sum of both; 0 where there is none."""
TAIL: Final = RECORD.size + FOOTER_CONTENT.size + len(MAGIC)  # bytes at the end of a file that its writer has ended
LONGEST_STRUCTURE: Final = 2**28
"""Largest record that is read into memory [byte]: no writer makes a longer one, so it is damage."""


def records(
    head_at: Callable[[int], tuple[Any, ...]], position: int, end: int, longest: int = sys.maxsize
) -> Iterator[tuple[int, int, int]]:
    """Code, begin and end of the content of each record, up to the first incomplete or longer one, which is damage."""
    while position + RECORD.size <= end:
        code, length = head_at(position)
        start = position + RECORD.size
        position = start + length
        if code == 0 or position > end or length > longest:
            return
        yield code, start, position


def records_in(data: bytes | mmap.mmap, position: int = 0) -> Iterator[tuple[int, int, int]]:
    """The same of a buffer."""
    return records(partial(RECORD.unpack_from, data), position, len(data))


def records_read(read_at: Callable[[int, int], bytes], position: int, end: int) -> Iterator[tuple[int, int, int]]:
    """The same of a file that is read piece by piece; `read_at` takes position and size."""
    return records(lambda at: RECORD.unpack(read_at(at, RECORD.size)), position, end, LONGEST_STRUCTURE)


def footer_of(tail: bytes) -> tuple[Any, ...] | None:
    """`FOOTER_CONTENT` out of the last `TAIL` bytes of a file; None where its writer has not ended it."""
    if not (tail.startswith(RECORD.pack(FOOTER, FOOTER_CONTENT.size)) and tail.endswith(MAGIC) and len(tail) == TAIL):
        return None
    return FOOTER_CONTENT.unpack_from(tail, RECORD.size)


def parsed(code: int, content: bytes) -> Any:
    """A record of the library from its content; the library and `struct` raise different errors on a damaged one."""
    name = optional("mcap.opcode").Opcode(code).name.title().replace("_", "")
    stream = optional("mcap.stream_reader").ReadDataStream(BytesIO(content))
    return getattr(optional("mcap.records"), name).read(stream)


def record_bytes(record: Any) -> bytes:
    """Bytes of one record of the library."""
    builder = optional("mcap.data_stream").RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data


def chunk_content(chunk: Any) -> bytes:
    """The records within a chunk record; never more is unpacked than its stated size, nor than belongs in one."""
    size, packed = chunk.uncompressed_size, chunk.data
    if size > LONGEST_STRUCTURE:
        raise ValueError(f"it says that it holds {size} bytes, more than the {LONGEST_STRUCTURE} that one may")
    if chunk.compression == "zstd":
        zstandard = optional("zstandard")
        stated = zstandard.frame_content_size(packed)
        if stated > size:
            raise ValueError(f"it says that it holds {size} bytes, and what is packed in it {stated}")
        content: bytes = zstandard.decompress(packed, size)
    elif chunk.compression == "lz4":
        content = optional("lz4.frame").LZ4FrameDecompressor().decompress(packed, max_length=size + 1)
    elif chunk.compression:
        raise ValueError(f"compression {chunk.compression!r} is not known: zstd and lz4 are")
    else:
        content = packed
    if chunk.compression and len(content) != size:
        raise ValueError(f"it says that it holds {size} bytes, and holds {'more' if len(content) > size else 'fewer'}")
    if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
        raise ValueError("its check sum is wrong")
    return content


class McapFile(RosBag):
    """An opened MCAP file.

    A file that ends before its index, because its writer was killed or still writes, is read as far as it goes.
    """

    def __init__(self, path: str | PathLike[str], *, peek: bool = False) -> None:
        super().__init__(path, "MCAP")
        optional("mcap.records")
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._counts: dict[int, int] = {}
        self._chunks: list[tuple[int, frozenset[int] | None]] = []  # where each begins, channels of its messages
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
        channel = next(result for result in self._channels.values() if result.topic == topic.name)
        if channel.message_encoding != "cdr":
            text = channel.message_encoding or "in no stated encoding"
            raise RecordingError(self.path, f"messages of {topic.name} are {text}: only CDR of ROS 2 is read")
        schema = self._schemas.get(channel.schema_id)
        return (bytes(schema.data).decode(errors="replace"), schema.encoding) if schema else ("", "")

    def messages(self, topic: Topic, most: int | None = None) -> tuple[list[bytes], NDArray[np.int64]]:
        """As `RosBag.messages`."""
        wanted = {number for number, channel in self._channels.items() if channel.topic == topic.name}
        with Path(self.path).open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            results = list(islice(self._messages_of(data, wanted), most))
        return [raw for _, raw in results], np.array([time for time, _ in results], dtype=np.int64)

    def _messages_of(self, data: mmap.mmap, wanted: set[int]) -> Iterator[tuple[int, bytes]]:
        """Log time and bytes of each message of some channels."""
        for block in self._blocks(data, wanted):
            for code, start, stop in records_in(block, len(MAGIC) if block is data else 0):
                if code == MESSAGE:
                    channel, _, log_time, _ = MESSAGE_HEAD.unpack_from(block, start)
                    if channel in wanted:
                        yield log_time, block[start + MESSAGE_HEAD.size : stop]

    def _blocks(self, data: mmap.mmap, wanted: set[int]) -> Iterator[bytes | mmap.mmap]:
        for begin, whose in self._chunks:
            if whose is None or whose & wanted:
                _, length = RECORD.unpack_from(data, begin)
                yield self._chunk(data[begin + RECORD.size : begin + RECORD.size + length], begin)
        if not self._chunks:
            yield data

    # --- the file's statements about itself ---------------------------------------------------------------------------

    def _read_summary(self, data: mmap.mmap) -> bool:
        """Take the index at the end; whether there is one that serves."""
        footer = footer_of(data[-TAIL:])
        summary = 0 if footer is None else footer[0]
        if not len(MAGIC) < summary < len(data):
            return False
        statistics = None
        for code, start, stop in records_in(data, summary):
            if code not in (SCHEMA, CHANNEL, CHUNK_INDEX, STATISTICS, METADATA_INDEX):
                continue
            record = self._record(code, data[start:stop], start)
            if code == CHUNK_INDEX:
                self._chunks.append((record.chunk_start_offset, frozenset(record.message_index_offsets) or None))
            elif code == STATISTICS:
                statistics = record
            elif code == METADATA_INDEX and record.name == MAP_NAME:
                self._record(METADATA, data[record.offset + RECORD.size : record.offset + record.length], record.offset)
        if statistics is None or (statistics.message_count and not self._channels):
            self._chunks.clear()
            return False
        self._counts = dict(statistics.channel_message_counts)
        self.begin_ns, self.end_ns = statistics.message_start_time, statistics.message_end_time
        return True

    def _read_all(self, data: mmap.mmap, peek: bool) -> None:
        self.whole = data[-len(MAGIC) :] == MAGIC and len(data) > len(MAGIC)
        first: int | None = None
        for code, start, stop in records_in(data, len(MAGIC)):
            block: bytes | mmap.mmap = data
            inside = iter([(code, start, stop)])
            if code == CHUNK:
                self._chunks.append((start - RECORD.size, None))
                block = self._chunk(data[start:stop], start)
                inside = records_in(block)
            for inner, begin, end in inside:
                if inner in (SCHEMA, CHANNEL, METADATA):
                    self._record(inner, block[begin:end], begin)
                elif inner == MESSAGE:
                    channel, _, log_time, _ = MESSAGE_HEAD.unpack_from(block, begin)
                    self._counts[channel] = self._counts.get(channel, 0) + 1
                    first = log_time if first is None else min(first, log_time)
                    self.end_ns = max(self.end_ns, log_time)
            if code == FOOTER or (peek and code == CHUNK and self._channels):
                break
        self.begin_ns = first or 0

    def _record(self, code: int, content: bytes, start: int) -> Any:
        """A record; what it says of schemas, channels and the map is kept."""
        with foreign(self.path, f"the record at byte {start} is damaged"):
            record = parsed(code, content)
        if code in (SCHEMA, CHANNEL):
            (self._schemas if code == SCHEMA else self._channels)[record.id] = record
        elif code == METADATA and record.name == MAP_NAME:
            self.stated_map = record.metadata.get("toml", "")
        return record

    def _chunk(self, content: bytes, start: int) -> bytes:
        record = self._record(CHUNK, content, start)
        with foreign(self.path, f"the block at byte {start} is damaged"):
            return chunk_content(record)
