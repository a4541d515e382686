"""What of a file is taken: which paths may be read, and how much memory and time the reading may take."""

from __future__ import annotations

import math
import os
import stat
from os import PathLike
from pathlib import Path
from typing import Final, NamedTuple

from foretouch.errors import RecordingError, SettingError


def require_data(path: str | PathLike[str]) -> None:
    """Refuse a pipe, a socket or a device: opening or reading one may wait for ever for a writer.

    A file and a folder pass, and what is not there: its reader says that, in its own terms.
    """
    try:
        mode = Path(path).stat().st_mode
    except (OSError, ValueError):
        return
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise RecordingError(path, "is no file: a pipe, a socket or a device holds nothing that stays")


VARIABLE: Final = "FORETOUCH_FILE_BUDGET"
"""Variable of the environment that says how many times the usual budget a file gets; ``inf`` for no limit."""

LEAST_MEMORY: Final = 900_000_000
"""Memory that any file may take [bytes]. With the code of the libraries, which the system does not count, the process
stays within a gigabyte; 20 million samples of three columns fit."""

MEMORY_PER_BYTE: Final = 3.0
"""Bytes of memory for a byte of a large file, beside the file itself, which may be mapped: a session takes 1, a CSV
with short rows 2 to 3."""

MOST_PACKED: Final = 4
"""A file counts for at most this many times what it takes on its disk, and for no more than its size: a hole of 100 GB,
which takes nothing there, is no claim to 300 GB of memory. A file system that packs files may make an honest one
smaller, to a quarter at best before its budget is; on one that reports no blocks a file has the least budget, which
holds a session of 900 MB. What that is too little for names `VARIABLE` in its line."""

LEAST_SECONDS: Final = 15.0
"""Processor time that any file may take [s]; the slowest of the honest small ones, bags of thousands of topics, take
a few seconds."""

SECONDS_PER_MEGABYTE: Final = 0.4
"""Time for a megabyte of a large file [s]: the slowest reader, of CSV with something out of order, takes a tenth of
it."""


class Budget(NamedTuple):
    """What the reading of one file may take.

    Attributes:
        memory: Memory of its process, beside code and what is mapped from files [bytes].
        seconds: Processor time [s].
        factor: Ratio to the usual budget.
        size: Size of the file, without holes [bytes].
    """

    memory: int
    seconds: int
    factor: float
    size: int

    @property
    def raised(self) -> str:
        """What to do where it is not enough."""
        return (
            f"if you trust the file, {VARIABLE}={4.0 * self.factor:g} in the environment gives four times as much "
            "memory and time"
        )

    @property
    def shown_memory(self) -> str:
        """The memory in words."""
        return f"{self.memory / 1e9:.2g} GB" if self.memory >= 1e9 else f"{self.memory / 1e6:.0f} MB"

    @property
    def shown_size(self) -> str:
        """The file's size in words."""
        return f"{self.size / 1e6:.3g} MB" if self.size >= 1e6 else f"{self.size / 1e3:.3g} kB"


def budget_for(path: str | PathLike[str], factor: float | None = None) -> Budget | None:
    r"""The budget of a file or folder of :math:`S` bytes, with the factor :math:`c`.

    .. math::

        \text{memory} = c \max(0.9\,\text{GB},\ 3 S), \qquad
        \text{time} = c \max(15\,\text{s},\ 0.4\,\text{s/MB}\ S)

    Args:
        path: The file; one that is not there has the budget of an empty one.
        factor: Above 0; without it that of the environment, `VARIABLE`, or 1.

    Returns:
        None where the factor is infinite: no limit.

    Raises:
        SettingError: A factor that is no number above 0.
    """
    name, given = ("budget", factor) if factor is not None else (VARIABLE, os.environ.get(VARIABLE, "") or 1.0)
    try:
        times = float(given)
    except (TypeError, ValueError):
        times = math.nan
    if not times > 0.0:
        raise SettingError(name, given, "must be a number above 0: how many times the usual budget files get")
    if math.isinf(times):
        return None
    size = _size(Path(path))
    memory = int(times * max(LEAST_MEMORY, MEMORY_PER_BYTE * size))
    seconds = math.ceil(times * max(LEAST_SECONDS, SECONDS_PER_MEGABYTE * size / 1e6))
    return Budget(memory, seconds, times, size)


def _size(path: Path) -> int:
    """The size of a file, or of those in a folder, that counts [bytes]."""
    try:
        states = [file.stat() for file in (filter(Path.is_file, path.iterdir()) if path.is_dir() else [path])]
    except (OSError, ValueError):
        return 0
    return sum(min(state.st_size, MOST_PACKED * 512 * state.st_blocks) for state in states)  # blocks are of 512 bytes
