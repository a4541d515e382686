"""A file that grows block by block, so that it ends with a whole block whatever happens to its disk."""

from __future__ import annotations

import errno
import fcntl
import os
from contextlib import suppress
from os import PathLike
from pathlib import Path

__all__ = ["BlockFile", "being_written"]


class BlockFile:
    """A new file that is written to in blocks, and read at any place before the newest.

    What `write` takes waits in memory for `flush`, which hands it to the operating system as one block. A block that
    does not fit on the disk is taken back whole. While it is open the file is locked: `being_written` says so.

    Args:
        path: The file; one that is there is replaced, unless somebody else writes it.

    Attributes:
        path: Where the file is; `keep` may have moved it.

    Raises:
        OSError: Also by every method.
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
        """Forget everything behind a place."""
        self._pending.clear()
        os.ftruncate(self._descriptor, position)
        self._end = position

    @property
    def removed(self) -> bool:
        """Whether the file has no name any more: what is written is lost when it is closed."""
        return os.fstat(self._descriptor).st_nlink == 0

    def keep(self) -> None:
        """Give the contents of a removed file a name again, in the nearest folder that is still there, and go on."""
        place = next(folder for folder in self._absolute.parents if folder.is_dir())
        names = (f"{self.path.stem}-kept{number or ''}{self.path.suffix}" for number in range(1000))
        path = next(place / name for name in names if not (place / name).exists())
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
