"""Pace of every real-time loop (absolute deadlines, sleep, then a short spin), and the scheduling of processes."""

from __future__ import annotations

import ctypes
import gc
import os
import platform
import struct
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from foretouch.errors.checks import require

WATCHERS_NICE = 5
"""Nice value of a watching process: a loop beside it gets three times its time on a processor that both want."""

SLACK_NS = 1_000
"""Allowed delay of the end of a sleep [ns]. The kernel's own 50 us would have to be spun in every tick."""

SLICE_NS = 100_000
"""Scheduling slice requested by a loop's process [ns]. A process with a short slice runs before one with the kernel's
usual milliseconds, at an unchanged processor time. Linux supports this since 6.12, and ignored it before."""

PROMPT_NS, USUAL_NS = 80_000, 200_000
"""Usual largest delay of a sleep [ns]: with `SLACK_NS`, and with the kernel's default."""

SET_TIMER_SLACK, GET_TIMER_SLACK = 29, 30
"""Options of `prctl`."""
SET_ATTRIBUTES = {"x86_64": 314, "aarch64": 274}
"""Number of the system call `sched_setattr`, for which the C library has no function."""
ATTRIBUTES = struct.Struct("<IIQiIQQQ")
"""Its argument: size, policy, flags, nice, priority, then runtime, deadline and period [ns]."""


def be_prompt() -> None:
    """Let a process whose loop must be punctual wake on time, without any privilege; on Linux only.

    All its threads, for one that is put aside while it holds the interpreter keeps the loop waiting: so this is to be
    called before threads start.
    """
    if sys.platform != "linux":
        return
    library = ctypes.CDLL(None)
    library.prctl(SET_TIMER_SLACK, ctypes.c_ulong(SLACK_NS), 0, 0, 0)
    call = SET_ATTRIBUTES.get(platform.machine())
    if call is not None:
        nice = os.getpriority(os.PRIO_PROCESS, 0)
        wanted = ATTRIBUTES.pack(ATTRIBUTES.size, os.SCHED_OTHER, 0, nice, 0, SLICE_NS, 0, 0)
        library.syscall(call, 0, ctypes.create_string_buffer(wanted, len(wanted)), 0)


def give_way() -> None:
    """Give a watching process less of a busy processor than the loops, and let it preempt no running one.

    To be called before it starts threads, which take its priority over.
    """
    if sys.platform == "linux":
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    os.nice(WATCHERS_NICE)


def wakes_late_ns() -> int:
    """Time by which a sleep of this thread should end early [ns]: what is left can be spun."""
    if sys.platform != "linux":
        return USUAL_NS
    slack = ctypes.CDLL(None).prctl(GET_TIMER_SLACK, 0, 0, 0, 0)
    return PROMPT_NS if 0 < slack <= SLACK_NS else USUAL_NS


LONGEST_CATCH_UP = 50  # Largest number of sample periods that a simulated robot makes up at once after a delay

LONGEST_EXCHANGE_NS = 500_000
"""Mean duration of an exchange above which no further period is made up [ns]: half a tick, for a slow simulation would
fall further behind the more it catches up."""


class LoopTimer:
    """Wakes at multiples of a period after the first tick.

    A tick that took too long does not shift the ones after it: deadlines that have passed are skipped and counted.
    Sleeping ends somewhat before a deadline, for it is late by more or less (`wakes_late_ns`); the rest is spun.

    Args:
        period: Period [s], positive.

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
    """Let the elapsed sample periods pass (`LoopTimer.wait`): with a real robot one exchange.

    A driver may wait in it for the next cycle of its bus: to make up for missed periods it would wait for as many more
    cycles, and miss more. Only a simulated robot, whose time stands still otherwise, is given them.
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


class Punctuality(NamedTuple):
    """How late the ticks of a loop woke and how long they computed [ns], and how many deadlines were missed."""

    late_ns: list[int]
    compute_ns: list[int]
    missed: int


def measure_loop(period: float, ticks: int, work: Callable[[float], None] = lambda time: None) -> Punctuality:
    """Run a loop of this period [s] for some deadlines, paced as a side of a session, and measure it.

    A deadline that was passed over is late until the one that was not. `work` gets the time since the first deadline
    [s].
    """
    late, computed, timer = [0] * ticks, [], LoopTimer(period)
    period_ns, tick = round(period * 1e9), -1
    with steady():
        while tick < ticks - 1:
            deadline, periods = timer.wait()
            periods = max(1, periods)
            tick += periods
            for back in range(periods):
                if tick - back < ticks:
                    late[tick - back] = timer.woke_ns - deadline + back * period_ns
            work(tick * period)
            computed.append(time.monotonic_ns() - timer.woke_ns)
    return Punctuality(late, computed, timer.missed)
