"""A loop that hangs: a call of a driver that does not come back, as another thread of the same process sees it."""

from __future__ import annotations

import sys
import sysconfig
import threading
import traceback
from pathlib import Path
from types import FrameType

__all__ = ["HANGS_AFTER", "LoopWatch", "where"]

HANGS_AFTER = 3.0
"""A loop without a tick for so long [s] hangs: a driver's own timeout of a second or two is waited for."""


class LoopWatch:
    """Tells whether a loop goes on.

    Looks are counted and not seconds: a process that was stopped by a signal, or put aside by the machine, has missed
    one look when it goes on, and not as many as there were meanwhile.

    Args:
        look_period: Between two looks [s].

    Attributes:
        ticked: Written by the loop in every tick, always another number; 0 before the first.
    """

    __slots__ = ("_idle", "_looks", "_period", "_seen", "_thread", "ticked")

    def __init__(self, look_period: float) -> None:
        self.ticked = 0
        self._thread = threading.get_ident()  # the loop's, which makes this
        self._period = look_period
        self._looks = round(HANGS_AFTER / look_period)
        self._seen = self._idle = 0

    def look(self) -> bool:
        """Look once; whether the loop has ticked since the last look."""
        moved = self.ticked != self._seen
        self._seen, self._idle = self.ticked, 0 if moved or not self.ticked else self._idle + 1
        return moved

    @property
    def stuck(self) -> str:
        """Where the loop has hung for too long, in words; empty while it goes on, and before its first tick."""
        if self._idle < self._looks:
            return ""
        return f"no tick for {self._looks * self._period:g} s, {where(sys._current_frames().get(self._thread))}"


def where(frame: FrameType | None) -> str:
    """Where a thread is, in words: the innermost function in Python that is not Python's own, its file and line."""
    if frame is None:
        return "in a place that is not known"
    called = traceback.extract_stack(frame)
    at = next((one for one in reversed(called) if not _of_python(one.filename)), called[-1])
    return f"in {at.name} ({Path(at.filename).name}, line {at.lineno})"


def _of_python(file: str) -> bool:
    installed = "site-packages" in file or "dist-packages" in file
    return file.startswith("<frozen") or (file.startswith(sysconfig.get_path("stdlib")) and not installed)
