"""A session's MCAP file on disk: written block by block, and its index made from the file itself, cut or whole.

The library's own writer keeps an object for every block in memory until the end, a hundred megabytes in ten hours.
However a disk fails, the file ends with a whole block.
"""

from __future__ import annotations

import errno
import fcntl
import os
import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

from foretouch.recordings.formats import mcap
from foretouch.recordings.formats.topics import COUNTS
from foretouch.recordings.output import optional


class BlockFile:
    """A new file that is written to in blocks, and read at any position before the newest.

    What `write` takes waits in memory for `flush`, which hands it to the operating system as one block. A block that
    does not fit on the disk is taken back whole. While it is open the file is locked: `being_written` says so.

    Args:
        path: The file; an existing one is replaced, unless another process writes it.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self.path = Path(path)
        self._absolute = self.path.absolute()  # the working folder may be removed too
        self._descriptor = _create(self.path)
        self._pending = bytearray()
        self._end = 0

    def write(self, data: bytes) -> None:
        """Put bytes into the block in progress."""
        self._pending += data

    def tell(self) -> int:
        """Position behind all that was written."""
        return self._end + len(self._pending)

    def flush(self) -> None:
        """Hand the block in progress to the operating system; on an error the file is as it was before it."""
        block, position = memoryview(self._pending), self._end
        self._pending = bytearray()
        try:
            while block:
                written = os.pwrite(self._descriptor, block, position)
                block, position = block[written:], position + written
        except OSError:
            with suppress(OSError):  # a device has no length
                os.ftruncate(self._descriptor, self._end)
            raise
        self._end = position

    def read_at(self, position: int, size: int) -> bytes:
        """Bytes that were flushed."""
        return os.pread(self._descriptor, size, position)

    def truncate(self, position: int) -> None:
        """Forget everything behind a position."""
        self._pending.clear()
        os.ftruncate(self._descriptor, position)
        self._end = position

    @property
    def removed(self) -> bool:
        """Whether the file has no name any more: what is written is lost when it is closed."""
        return os.fstat(self._descriptor).st_nlink == 0

    def keep(self) -> None:
        """Give the contents of a removed file a name again, in the nearest folder that is still there, and go on."""
        point = next(folder for folder in self._absolute.parents if folder.is_dir())
        names = (f"{self.path.stem}-kept{number or ''}{self.path.suffix}" for number in range(1000))
        path = next(point / name for name in names if not (point / name).exists())
        descriptor = _create(path)
        try:
            position = 0
            while position < self._end:
                position += os.pwrite(descriptor, self.read_at(position, 2**20), position)
        except OSError:
            os.close(descriptor)
            path.unlink()
            raise
        os.close(self._descriptor)
        self.path, self._absolute, self._descriptor = path, path, descriptor

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._descriptor < 0

    def close(self) -> None:
        """Close the file as of the last `flush`."""
        if not self.closed:
            os.close(self._descriptor)
            self._descriptor = -1


def being_written(path: str | PathLike[str]) -> bool:
    """Whether some process has the file open as a `BlockFile`."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks
        return False
    finally:
        os.close(descriptor)
    return False


def _create(path: Path) -> int:
    """Descriptor of an empty, locked file."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise OSError(errno.EBUSY, "another process is writing it") from None
    except OSError:  # a file system without locks
        pass
    with suppress(OSError):  # a device has no length
        os.ftruncate(descriptor, 0)
    return descriptor


_chunk_head = struct.Struct("<QQQII")  # first and last log time, size, CRC, length of the compression's name
_index_head = struct.Struct("<HI")  # channel, bytes of entries
_ENTRY = 16  # bytes of an entry of a message index


def counts_record(counts: Mapping[str, int]) -> bytes:
    """Bytes of the metadata record that holds a session's counters."""
    texts = {name: str(int(count)) for name, count in counts.items()}
    return mcap.record_bytes(optional("mcap.records").Metadata(COUNTS, texts))


def append_index(file: BlockFile, schemas: list[Any], channels: list[Any]) -> None:
    """End a file that holds data only: go through it once and write what stands where behind it.

    The memory that this takes does not grow with the file. Where it cannot be written (an OSError) the file is as it
    was.
    """
    end, records, result = file.tell(), optional("mcap.records"), Found()
    try:
        file.write(mcap.record_bytes(records.DataEnd(0)))
        summary = _Summary(file)
        summary.group(mcap.SCHEMA, map(mcap.record_bytes, schemas))
        summary.group(mcap.CHANNEL, map(mcap.record_bytes, channels))
        summary.group(mcap.CHUNK_INDEX, _chunk_indexes(file, end, result))
        summary.group(mcap.METADATA_INDEX, map(mcap.record_bytes, result.metadata))
        summary.group(mcap.ATTACHMENT_INDEX, map(mcap.record_bytes, result.attachments))
        statistics = records.Statistics(
            attachment_count=len(result.attachments),
            channel_count=len(channels),
            channel_message_counts=dict(sorted(result.messages.items())),
            chunk_count=result.chunks,
            message_count=result.messages.total(),
            message_end_time=max(result.times, default=0),
            message_start_time=min(result.times, default=0),
            metadata_count=len(result.metadata),
            schema_count=len(schemas),
        )
        summary.group(mcap.STATISTICS, [mcap.record_bytes(statistics)])
        summary.end()
    except OSError:
        file.truncate(end)
        raise


@dataclass
class Found:
    """What the data of a file add up to."""

    chunks: int = 0
    messages: Counter[int] = field(default_factory=Counter)  # by channel
    times: list[int] = field(default_factory=list)  # of the first and the last message [ns]
    metadata: list[Any] = field(default_factory=list)
    attachments: list[Any] = field(default_factory=list)

    def span(self, first: int, last: int) -> None:
        """Log times of messages."""
        times = [*self.times, first, last]
        self.times = [min(times), max(times)]


def _chunk_indexes(file: BlockFile, end: int, result: Found) -> Iterator[bytes]:
    """Index record of each block; the rest of the file is added up on the way."""
    chunk: Any = None
    for code, start, stop in mcap.records_read(file.read_at, len(mcap.MAGIC), end):
        if code == mcap.MESSAGE_INDEX:
            channel, length = _index_head.unpack(file.read_at(start, _index_head.size))
            result.messages[channel] += length // _ENTRY
            chunk.message_index_offsets[channel] = start - mcap.RECORD.size
            chunk.message_index_length += stop - start + mcap.RECORD.size
            continue
        if chunk is not None:
            yield mcap.record_bytes(chunk)
            chunk = None
        if code == mcap.CHUNK:
            chunk = _chunk_index(file, start, stop)
            result.chunks += 1
            result.span(chunk.message_start_time, chunk.message_end_time)
        elif code == mcap.MESSAGE:
            channel, _, log_time, _ = mcap.MESSAGE_HEAD.unpack(file.read_at(start, mcap.MESSAGE_HEAD.size))
            result.messages[channel] += 1
            result.span(log_time, log_time)
        elif code in (mcap.METADATA, mcap.ATTACHMENT):
            _named(file, code, start, stop, result)
    if chunk is not None:
        yield mcap.record_bytes(chunk)


def _chunk_index(file: BlockFile, start: int, stop: int) -> Any:
    first, last, size, _, name_length = _chunk_head.unpack(file.read_at(start, _chunk_head.size))
    name = file.read_at(start + _chunk_head.size, name_length)
    return optional("mcap.records").ChunkIndex(
        chunk_length=stop - start + mcap.RECORD.size,
        chunk_start_offset=start - mcap.RECORD.size,
        compression=name.decode(),
        compressed_size=stop - start - _chunk_head.size - name_length - 8,
        message_end_time=last,
        message_index_length=0,
        message_index_offsets={},
        message_start_time=first,
        uncompressed_size=size,
    )


def _named(file: BlockFile, code: int, start: int, stop: int, result: Found) -> None:
    records, read = optional("mcap.records"), mcap.parsed(code, file.read_at(start, stop - start))
    position = {"offset": start - mcap.RECORD.size, "length": stop - start + mcap.RECORD.size}
    if code == mcap.METADATA:
        result.metadata.append(records.MetadataIndex(name=read.name, **position))
        return
    copied = {name: getattr(read, name) for name in ("create_time", "log_time", "name", "media_type")}
    result.attachments.append(records.AttachmentIndex(data_size=len(read.data), **copied, **position))


class _Summary:
    """Writes the summary section group by group, and its check sum on the way."""

    def __init__(self, file: BlockFile) -> None:
        self._file = file
        self._start = file.tell()
        self._crc = 0
        self._offsets: list[Any] = []

    def group(self, code: int, records: Any) -> None:
        """Records of one kind."""
        start = self._file.tell()
        for number, data in enumerate(records):
            self._put(data)
            if number % 1000 == 999:
                self._file.flush()
        length = self._file.tell() - start
        if length:
            self._offsets.append(optional("mcap.records").SummaryOffset(code, start, length))

    def end(self) -> None:
        """Where the groups are, and the end of the file."""
        offsets_start = self._file.tell()
        for offset in self._offsets:
            self._put(mcap.record_bytes(offset))
        content = mcap.FOOTER_CONTENT.pack(self._start, offsets_start, 0)
        footer = mcap.RECORD.pack(mcap.FOOTER, len(content)) + content
        self._put(footer[:-4])  # the check sum is of all that stands before it
        self._file.write(struct.pack("<I", self._crc) + mcap.MAGIC)
        self._file.flush()

    def _put(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._file.write(data)
