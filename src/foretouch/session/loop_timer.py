"""One pacing rule for every real-time loop: absolute deadlines, sleep, then a short spin."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from foretouch.errors.checks import require
from foretouch.session.scheduling import wakes_late_ns

__all__ = ["LONGEST_CATCH_UP", "LoopTimer", "let_pass", "steady"]

LONGEST_CATCH_UP = 50
"""A simulated robot that was held up lets at most so many sample periods pass at once."""

LONGEST_EXCHANGE_NS = 500_000
"""And no further one once each has taken so long [ns] at the mean: half a tick, for a slow simulation would fall behind
the more the more it catches up."""


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


def let_pass(exchange: Callable[[], None], periods: int, *, simulated: bool) -> None:
    """Let the sample periods pass that have gone by: with a real robot, whose time passes by itself, one exchange.

    A driver may wait in it for the next cycle of its bus: to make up for missed periods it would wait for as many more
    cycles, and miss more. Only a simulated robot, whose time stands still otherwise, is given them.

    Args:
        exchange: With the robot.
        periods: Since the tick before (`LoopTimer.wait`).
        simulated: Whether the robot is.
    """
    if periods < 1:  # the first tick
        return
    most, begun = min(periods, LONGEST_CATCH_UP) if simulated else 1, time.monotonic_ns()
    for made in range(1, most + 1):
        exchange()
        if time.monotonic_ns() - begun > made * LONGEST_EXCHANGE_NS:
            return


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
