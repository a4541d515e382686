"""Followers of this user on this machine: each keeps a file with the state of its robot."""

from __future__ import annotations

import contextlib
import fcntl
import os
import stat
from pathlib import Path


class WaitingNote:
    """The file of one follower: its name is the process's number, it holds the follower's last report.

    It is locked as long as the process lives, so that the file of one that was killed is known as such. Where there is
    no folder for it, nothing is kept, and only the signal is left.
    """

    def __init__(self) -> None:
        self._file = None
        self._path = _folder() / str(os.getpid())
        with contextlib.suppress(OSError):
            self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            if _is_private(self._path.parent):
                self._file = self._path.open("w")
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def say(self, sentence: str) -> None:
        """Keep this sentence instead of the one before."""
        if self._file is not None:
            with contextlib.suppress(OSError):
                self._file.seek(0)
                self._file.write(sentence)
                self._file.truncate()
                self._file.flush()

    def close(self) -> None:
        """Remove the entry."""
        if self._file is not None:
            self._path.unlink(missing_ok=True)
            self._file.close()
            self._file = None


def followers() -> dict[int, str]:
    """Numbers of the processes of this user's followers on this machine, and the last report of each."""
    folder, reports = _folder(), {}
    if not (folder.is_dir() and _is_private(folder)):
        return {}
    for path in sorted(folder.iterdir()):
        with contextlib.suppress(OSError, ValueError), path.open() as file:
            number = int(path.name)
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                reports[number] = file.read()
            else:
                path.unlink(missing_ok=True)  # its process was killed
    return reports


def _folder() -> Path:
    """Folder of this user and machine; the system empties it where it has such a folder."""
    base = os.environ.get("XDG_RUNTIME_DIR") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base, "foretouch", "followers")


def _is_private(folder: Path) -> bool:
    """Whether only this user can have written its contents: a number in it is sent a signal."""
    state = folder.stat()
    return state.st_uid == os.geteuid() and not state.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
