"""Whom the kernel runs first where several want a processor: the loops at once, the watchers when there is time."""

from __future__ import annotations

import ctypes
import os
import platform
import struct
import sys

__all__ = ["be_prompt", "give_way", "wakes_late_ns"]

WATCHERS_NICE = 5
"""Of a process that watches: a loop beside it has three times its share of a processor that both want."""

SLACK_NS = 1_000
"""A sleep may end so much later than asked for [ns]. The kernel's own 50 us would have to be spun in every tick."""

SLICE_NS = 100_000
"""Time that a loop's process asks for at a stretch [ns]. Who asks for little is run at once, before one that asks for
the kernel's usual milliseconds; its share stays as it is. Linux knows this since 6.12, and before passes it over."""

PROMPT_NS, USUAL_NS = 80_000, 200_000
"""How late a sleep ends at most, as a rule [ns]: with `SLACK_NS`, and as the kernel usually has it."""

SET_TIMER_SLACK, GET_TIMER_SLACK = 29, 30
"""Of `prctl`."""
SET_ATTRIBUTES = {"x86_64": 314, "aarch64": 274}
"""Number of the system call `sched_setattr`, for which the C library has no function."""
ATTRIBUTES = struct.Struct("<IIQiIQQQ")
"""Its argument: size, policy, flags, nice, priority, then runtime, deadline and period [ns]."""


def be_prompt() -> None:
    """Let a process whose loop must be punctual wake on time, without any privilege.

    All its threads, not the loop's alone: one that is put aside while it holds the interpreter keeps the loop waiting.
    So this is to be called before threads start; they take it over. Where the system is not Linux, nothing happens.
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
    """Let a process that watches have less of a busy processor than the loops have, and take it from nobody who runs.

    To be called before it starts threads: on Linux each has a priority of its own, and those that come after take over
    that of the thread that starts them.
    """
    if sys.platform == "linux":
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    os.nice(WATCHERS_NICE)


def wakes_late_ns() -> int:
    """How much earlier than needed a sleep of this thread should end [ns]: what is left can be spun."""
    if sys.platform != "linux":
        return USUAL_NS
    slack = ctypes.CDLL(None).prctl(GET_TIMER_SLACK, 0, 0, 0, 0)
    return PROMPT_NS if 0 < slack <= SLACK_NS else USUAL_NS
