"""Processes whose loops are timed, and how late their ticks woke and why, from what they said of themselves.

`python -m foretouch.bench.side NOTES foretouch leader ...` is that command, and writes into NOTES when the collector
ran; `python -m foretouch.bench.side NOTES bare SECONDS` sleeps and spins as the sides do, and writes how late it woke.
"""

from __future__ import annotations

import gc
import runpy
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from foretouch.quantities import Rows

LATE_NS = 500_000
"""A tick is late that woke so long after its deadline [ns]: half a period."""

PERIOD_NS = 1_000_000

CAUSES = ("scheduler", "garbage collection", "us")
"""Why a tick is late: woken late by the kernel; the collector ran; the tick before computed beyond its budget."""

Integers = NDArray[np.int64]


class Ticks(NamedTuple):
    """Ticks of one loop, each array of shape (n,).

    Attributes:
        deadline_ns: When each was to begin [ns, monotonic clock]; of a tick that passed over deadlines, the first that
            it missed.
        late_ns: How much later it did.
        compute_ns: What the tick before it computed, by the wall clock: where the kernel took the core away meanwhile,
            that is in it.
    """

    deadline_ns: Integers
    late_ns: Integers
    compute_ns: Integers


def ticks_of(rows: Rows) -> Ticks:
    """Ticks from the rows of a session's log, of either side.

    A row has its deadline and the time since the tick before began. So the beginnings follow by summing, up to one
    constant; the earliest tick of an unbroken run of rows is on time, for the loop spins before its deadline.

    Args:
        rows: Of `SessionLog.leader` or `.follower`: `sequence`, `time_ns`, `period_ns`, `compute_ns`.
    """
    parts: list[tuple[Integers, Integers, Integers]] = []
    breaks = np.flatnonzero(np.diff(rows["sequence"].astype(np.int64)) != 1) + 1
    for run in np.split(rows, breaks):
        if run.size < 2:
            continue
        began = np.cumsum(run["period_ns"].astype(np.int64))
        times = run["time_ns"].astype(np.int64)
        late = began - times
        missed = np.maximum(np.diff(times, prepend=times[0] - PERIOD_NS) - PERIOD_NS, 0)
        # A row's compute_ns is of the tick before it, as the loop knew it then.
        parts.append((times - missed, late - late.min() + missed, run["compute_ns"].astype(np.int64)))
    empty = np.zeros(0, dtype=np.int64)
    return Ticks(*(np.concatenate([part[i] for part in parts]) if parts else empty for i in range(3)))


def causes(ticks: Ticks, collections: Sequence[tuple[int, int]]) -> dict[str, int]:
    """How many late ticks each of `CAUSES` has made.

    Args:
        ticks: Of the loop.
        collections: Begin and end of each run of the collector in its process [ns].
    """
    found = dict.fromkeys(CAUSES, 0)
    for place in np.flatnonzero(ticks.late_ns > LATE_NS).tolist():
        deadline = int(ticks.deadline_ns[place])
        begin, end = deadline - PERIOD_NS, deadline + int(ticks.late_ns[place])
        before = int(ticks.late_ns[place - 1]) if place else 0
        if any(first < end and last > begin for first, last in collections):
            found["garbage collection"] += 1
        elif int(ticks.compute_ns[place]) > PERIOD_NS - min(before, LATE_NS):
            found["us"] += 1
        else:
            found["scheduler"] += 1
    return found


class Notes(msgspec.Struct):
    """What a process noted; times by the monotonic clock [ns].

    Attributes:
        collections: Begin and end of each run of the collector.
        late_ns: How late each tick of a bare loop woke.
    """

    collections: list[tuple[int, int]] = []
    late_ns: list[int] = []


def read_notes(path: Path) -> Notes:
    """What a process wrote."""
    return msgspec.json.decode(path.read_bytes(), type=Notes)


@contextmanager
def _noting(path: Path) -> Iterator[Notes]:
    """Note every run of the collector until the end."""
    notes, begun = Notes(), [0]

    def note(phase: str, info: dict[str, int]) -> None:
        if phase == "start":
            begun[0] = time.monotonic_ns()
        else:
            notes.collections.append((begun[0], time.monotonic_ns()))

    gc.callbacks.append(note)
    try:
        yield notes
    finally:
        gc.callbacks.remove(note)
        path.write_bytes(msgspec.json.encode(notes))


def _bare(seconds: float) -> list[int]:
    """A loop at 1 kHz with nothing to do: how late each tick woke [ns]."""
    from foretouch.session.runners.loop_timer import LoopTimer, be_prompt, steady

    be_prompt()
    ticks = round(seconds * 1e9 / PERIOD_NS)
    late, timer = [0] * ticks, LoopTimer(PERIOD_NS * 1e-9)
    with steady():
        for tick in range(ticks):
            deadline, periods = timer.wait()
            late[tick] = timer.woke_ns - deadline + max(0, periods - 1) * PERIOD_NS  # from the first that was missed
    return late


def main(notes: str, what: str, *arguments: str) -> None:
    """Run, and write the notes at the end.

    Args:
        notes: The file for them.
        what: ``foretouch``, or ``bare``.
        *arguments: Of the command; or seconds.
    """
    with _noting(Path(notes)) as noted:
        if what == "bare":
            noted.late_ns = _bare(float(arguments[0]))
        else:
            sys.argv = ["foretouch", *arguments]
            runpy.run_module("foretouch", run_name="__main__")  # as `python -m foretouch` does


if __name__ == "__main__":
    main(*sys.argv[1:])
