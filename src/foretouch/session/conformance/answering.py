"""A check whose calls do not come back: it is left alone, and told of."""

from __future__ import annotations

import queue
import sys
import threading
import time
from collections.abc import Callable
from types import FrameType

from foretouch.session.conformance.finding import Finding
from foretouch.session.hanging import where

__all__ = ["LONGEST_ANSWER", "watched"]

LONGEST_ANSWER = 5.0
"""A call of a device or robot that has not come back for so long [s] hangs ..."""
LONGEST_MAKING = 30.0
"""... and one that makes it, which may have to find its way home, for so long [s]."""
LONGEST_CHECK = 60.0
"""One check of those that have nothing of Python to be seen in lasts at most so long [s]."""
LOOK_PERIOD = 0.1
"""Between two looks at it [s]."""
ROOM = __name__.rpartition(".")[0]


def watched(
    check: Callable[[Callable[[Finding], None]], object],
    tell: Callable[[Finding], None],
    *,
    longest: float = LONGEST_ANSWER,
    making: float = LONGEST_MAKING,
) -> None:
    """Run a check on a thread of its own, which is left where it is when a call of what is checked does not come back.

    All of it is on one thread, for there are drivers that want to be called by the one that made them.

    Args:
        check: Given whom it tells its findings.
        tell: Told each finding on the calling thread as soon as it is known; the last is of the call that hangs.
        longest: That a call may take [s].
        making: That the first one may take, before there is any finding [s].

    Raises:
        Exception: Whatever the check raises.
    """
    found: queue.SimpleQueue[Finding | BaseException | None] = queue.SimpleQueue()

    def work() -> None:
        try:
            check(found.put)
        except BaseException as error:  # it is raised where it was asked for
            found.put(error)
        else:
            found.put(None)

    thread = threading.Thread(target=work, name="check", daemon=True)
    thread.start()
    calls, limit = _Calls(thread), making
    while True:
        try:
            said = found.get(timeout=LOOK_PERIOD)
        except queue.Empty:
            if hung := calls.hung(limit):
                tell(Finding("answers", False, hung, "every call comes back; a driver that waits has a timeout"))
                return
            continue
        if said is None:
            return
        if isinstance(said, BaseException):
            raise said
        limit = longest
        calls.begin()
        tell(said)


class _Calls:
    """Looks at how long a thread has been in one call of what is checked.

    Args:
        thread: That checks.
    """

    def __init__(self, thread: threading.Thread) -> None:
        self._thread = thread
        self._call: FrameType | None = None  # held, so that no other call can be taken for it
        self._since = time.monotonic()

    def begin(self) -> None:
        """Count from now on."""
        self._call, self._since = None, time.monotonic()

    def hung(self, longest: float) -> str:
        """What is to be said where a call has lasted for longer than this [s]; empty where none has."""
        frame = sys._current_frames().get(self._thread.ident or 0)
        call = _call(frame)
        if call is not self._call:
            self._call, self._since = call, time.monotonic()
        if call is None:  # in the check itself, or in a call that is not of Python: which of them, nobody can tell
            longest = max(longest, LONGEST_CHECK)
        if frame is None or time.monotonic() - self._since < longest:
            return ""
        return f"a call has not come back for {longest:g} s, {where(frame)}"


def _call(frame: FrameType | None) -> FrameType | None:
    """The call that a check makes, None where it makes none: the outermost frame within the innermost of a check."""
    inner = None
    while frame is not None and not str(frame.f_globals.get("__name__", "")).startswith(ROOM):
        inner, frame = frame, frame.f_back
    return inner
