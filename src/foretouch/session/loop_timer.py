"""One pacing rule for every real-time loop: absolute deadlines, sleep, then a short spin."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from foretouch.models.checks import require
from foretouch.session.scheduling import wakes_late_ns

__all__ = ["LoopTimer", "steady"]


class LoopTimer:
    """Wakes at multiples of a period after the first tick.

    A tick that took too long does not shift the ones after it: deadlines that have passed are skipped and counted.
    Sleeping ends somewhat before a deadline, for it is late by more or less (`wakes_late_ns`); the rest is spun.

    Args:
        period: [s], positive.

    Attributes:
        missed: Deadlines skipped so far.
        woke_ns: When the newest tick really began [ns, monotonic clock].
    """

    __slots__ = ("_deadline_ns", "_period_ns", "_spin_ns", "missed", "woke_ns")

    def __init__(self, period: float) -> None:
        require("period", period, above=0.0)
        self._period_ns = round(period * 1e9)
        self._spin_ns = wakes_late_ns()
        self._deadline_ns = 0
        self.missed = 0
        self.woke_ns = 0

    def wait(self) -> tuple[int, int]:
        """Sleep until the next deadline.

        Returns:
            The deadline [ns, monotonic clock], which is the time of the tick: it lies on an even grid, so that how
            late the machine woke does not enter velocities. And how many periods have passed since the tick before:
            1, and one more for each deadline that was skipped; 0 in the first tick.
        """
        now = time.monotonic_ns()
        if self._deadline_ns == 0:
            self._deadline_ns = self.woke_ns = now
            return now, 0
        self._deadline_ns += self._period_ns
        skipped = max(0, (now - self._deadline_ns) // self._period_ns)
        self._deadline_ns += skipped * self._period_ns
        self.missed += skipped
        left = self._deadline_ns - now
        if left > self._spin_ns:
            time.sleep((left - self._spin_ns) * 1e-9)
        while (now := time.monotonic_ns()) < self._deadline_ns:
            pass
        self.woke_ns = now
        return self._deadline_ns, 1 + skipped


@contextmanager
def steady() -> Iterator[None]:
    """Keep the garbage collector out of a loop whose messages and states make no cycles, and other threads short."""
    switch = sys.getswitchinterval()
    gc.collect()
    gc.freeze()
    gc.disable()
    sys.setswitchinterval(5e-4)
    try:
        yield
    finally:
        sys.setswitchinterval(switch)
        gc.enable()
        gc.unfreeze()
