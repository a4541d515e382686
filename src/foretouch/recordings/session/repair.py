"""Repairs a recording whose writer was killed, whose disk was full, or that was damaged."""

from __future__ import annotations

import os
import zlib
from collections import defaultdict, deque
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

from foretouch.errors import RecordingError
from foretouch.files import within_budget
from foretouch.recordings.formats import mcap
from foretouch.recordings.formats.mcap_index import BlockFile, Found, append_index, being_written, counts_record
from foretouch.recordings.formats.topics import TRUNCATED
from foretouch.recordings.output import atomic_path, optional
from foretouch.recordings.source import reading


@dataclass(frozen=True)
class Repair:
    """Contents of a repaired recording, and what was cut.

    Attributes:
        path: Where the whole recording is now.
        was_whole: Whether nothing had to be done.
        messages: Number of messages by topic.
        duration: From the first to the last message, by the recorder's clock [s].
        bytes_kept: Bytes of the file's data that were kept.
        bytes_cut: Bytes behind the last whole block.
        damaged_blocks: Blocks before it that could not be read and were left out.
    """

    path: Path
    was_whole: bool
    messages: dict[str, int]
    duration: float
    bytes_kept: int
    bytes_cut: int
    damaged_blocks: int


def is_whole(path: str | PathLike[str]) -> bool:
    """Whether a recording was ended by its writer; not whether each of its blocks can be read.

    Raises:
        RecordingError: No such file.
    """
    with reading(path), Path(path).open("rb") as file:
        file.seek(max(file.seek(0, 2) - mcap.TAIL, 0))
        return mcap.footer_of(file.read(mcap.TAIL)) is not None


def repair_session(
    path: str | PathLike[str], output: str | PathLike[str] | None = None, *, budget: float | None = None
) -> Repair:
    """Make a recording whole: keep every block that can be read, byte by byte, and write the index anew.

    What ends before its index gets the counter ``truncated``. A recording that is whole stays as it is.

    Args:
        path: MCAP file, of any writer.
        output: Where the whole recording goes; without it, it replaces the file. Neither is ever incomplete.
        budget: How many times the usual memory and time this may take (`foretouch.files.budget_for`).

    Returns:
        What there is in it.

    Raises:
        RecordingError: No such file, no MCAP, still being written, nothing in it, or the output cannot be written.
        MissingExtraError: The package ``mcap`` is not installed.
    """
    return within_budget(path, budget, _repair, path, output)


def _repair(path: str | PathLike[str], output: str | PathLike[str] | None) -> Repair:
    with reading(path):
        if being_written(path):
            raise RecordingError(path, "is still being written: end its recorder first")
        with Path(path).open("rb") as file:
            if file.read(len(mcap.MAGIC)) != mcap.MAGIC:
                problem = "is not an MCAP file, or was cut before anything was flushed: nothing to keep"
                raise RecordingError(path, problem)
            data = _Data(file.fileno())
            ended = is_whole(path) and _index_stands(data)
            if ended and output is None:
                scan = _Scan(data)
                deque(scan.blocks(), maxlen=0)
                if scan.ended and scan.indexed and not scan.damaged:
                    return scan.result(Path(path), was_whole=True)
            return _write(data, Path(path), Path(path if output is None else output), ended)


class _Data:
    """The bytes of a file, read as they are asked for: mapped, a large file would count as memory of ours."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor, self.size = descriptor, os.fstat(descriptor).st_size

    def read_at(self, position: int, size: int) -> bytes:
        return os.pread(self._descriptor, size, position)


def _index_stands(data: _Data) -> bool:
    """Whether the index of a file that has one is as it was written."""
    end = data.size - len(mcap.MAGIC)
    start, _, crc = mcap.FOOTER_CONTENT.unpack(data.read_at(end - mcap.FOOTER_CONTENT.size, mcap.FOOTER_CONTENT.size))
    result, end = 0, end - 4  # the checksum does not cover itself
    for position in range(start, end, 2**20):
        result = zlib.crc32(data.read_at(position, min(2**20, end - position)), result)
    return crc in (0, result)


def _write(data: _Data, path: Path, target: Path, ended: bool) -> Repair:
    scan = _Scan(data)
    with atomic_path(target) as part, closing(BlockFile(part)) as file:
        file.write(mcap.MAGIC)
        for block in scan.blocks():
            file.write(block)
            file.flush()
        if not scan.found.messages:
            raise RecordingError(path, "holds no message that can be read: nothing to keep")
        was_whole = ended and scan.ended and scan.indexed and not scan.damaged
        if not scan.ended:
            file.write(counts_record(TRUNCATED))
            file.flush()
        append_index(file, list(scan.schemas.values()), list(scan.channels.values()))
    return scan.result(target, was_whole=was_whole)


class _Scan:
    """Goes through the data of a file once and gives what of it can be kept."""

    def __init__(self, data: _Data) -> None:
        optional("mcap.records")  # without it every block would seem to be damaged
        self._data = data
        self.schemas: dict[int, Any] = {}
        self.channels: dict[int, Any] = {}
        self.found = Found()
        self.damaged = 0
        self.ended = False
        self.indexed = True
        self._kept = 0
        self._end = len(mcap.MAGIC)

    def blocks(self) -> Iterator[bytes]:
        """Records of the data section, each chunk with its message indexes."""
        chunk: _Chunk | None = None
        for code, start, end in mcap.records_read(self._data.read_at, len(mcap.MAGIC), self._data.size):
            record = self._data.read_at(start - mcap.RECORD.size, end - start + mcap.RECORD.size)
            if code == mcap.MESSAGE_INDEX:
                if chunk is not None:
                    chunk.indexes.append(record)
                    self._kept += len(record)
            else:
                if chunk is not None:
                    yield self._whole(chunk)
                chunk = None
                if code == mcap.DATA_END:
                    self.ended = True
                    return
                try:
                    if code == mcap.CHUNK:
                        chunk = self._chunk(record)
                    else:
                        self._look(code, record[mcap.RECORD.size :])
                        yield record
                    self._kept += len(record)
                except Exception:  # mcap, struct and each compression library raise different errors
                    self.damaged += 1
            self._end = end
        if chunk is not None:
            yield self._whole(chunk)

    def result(self, path: Path, *, was_whole: bool) -> Repair:
        """The report of the repair."""
        counts, times = sorted(self.found.messages.items()), self.found.times
        return Repair(
            path=path,
            was_whole=was_whole,
            messages={self.channels[channel].topic: count for channel, count in counts},
            duration=(times[-1] - times[0]) * 1e-9 if times else 0.0,
            bytes_kept=self._kept,
            bytes_cut=0 if self.ended else self._data.size - self._end,
            damaged_blocks=self.damaged,
        )

    def _whole(self, chunk: _Chunk) -> bytes:
        index = chunk.index()
        self.indexed &= index == b"".join(chunk.indexes)
        return chunk.record + index

    def _chunk(self, record: bytes) -> _Chunk:
        """A chunk whose messages can all be read; its own header is kept."""
        head = mcap.parsed(mcap.CHUNK, record[mcap.RECORD.size :])
        content = mcap.chunk_content(head)
        chunk, reached = _Chunk(), 0
        results: list[tuple[int, bytes]] = []
        for code, start, reached in mcap.records_in(content):
            if code == mcap.MESSAGE:
                channel, _, time_ns, _ = mcap.MESSAGE_HEAD.unpack_from(content, start)
                chunk.entries[channel].append((time_ns, start - mcap.RECORD.size))
            else:
                results.append((code, content[start:reached]))
        if reached != len(content):
            raise ValueError("a record goes beyond its chunk")
        for code, part in results:
            self._look(code, part)
        if not chunk.entries.keys() <= self.channels.keys():
            raise ValueError("nobody says what its messages are")
        self.found.messages.update({channel: len(entries) for channel, entries in chunk.entries.items()})
        if chunk.entries:
            times = [time_ns for entries in chunk.entries.values() for time_ns, _ in entries]
            head.message_start_time, head.message_end_time = min(times), max(times)
            self.found.span(head.message_start_time, head.message_end_time)
        chunk.record = mcap.record_bytes(head)  # its header is correct from here on
        self.indexed &= chunk.record == record
        return chunk

    def _look(self, code: int, content: bytes) -> None:
        """Read a record that is no chunk, to see that it can be read, and to know schemas and channels."""
        if code == mcap.MESSAGE:
            number, _, time_ns, _ = mcap.MESSAGE_HEAD.unpack_from(content)
            self.found.messages[self.channels[number].id] += 1
            self.found.span(time_ns, time_ns)
        elif code in (mcap.SCHEMA, mcap.CHANNEL, mcap.METADATA, mcap.ATTACHMENT):
            record = mcap.parsed(code, content)
            if code in (mcap.SCHEMA, mcap.CHANNEL):
                (self.schemas if code == mcap.SCHEMA else self.channels)[record.id] = record


@dataclass
class _Chunk:
    record: bytes = b""
    indexes: list[bytes] = field(default_factory=list)
    entries: dict[int, list[tuple[int, int]]] = field(default_factory=lambda: defaultdict(list))

    def index(self) -> bytes:
        """Message indexes, made from the messages."""
        return b"".join(
            mcap.record_bytes(optional("mcap.records").MessageIndex(channel, entries))
            for channel, entries in self.entries.items()
        )
