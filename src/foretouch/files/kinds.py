"""What a path may be, of which somebody reads."""

from __future__ import annotations

import stat
from os import PathLike
from pathlib import Path

from foretouch.errors import RecordingError


def require_data(path: str | PathLike[str]) -> None:
    """Refuse a pipe, a socket or a device: who opens or reads one may wait for ever for somebody to write.

    A file and a folder pass, and what is not there: its reader says that, in its own terms.

    Raises:
        RecordingError: It is there, and is neither.
    """
    try:
        mode = Path(path).stat().st_mode
    except (OSError, ValueError):
        return
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise RecordingError(path, "is no file: a pipe, a socket or a device holds nothing that stays")
