"""Processes whose loops are timed: a side of a session that notes its garbage collections, and an idle loop.

`python -m foretouch.bench.side NOTES foretouch leader ...` is that command, and writes into NOTES when the collector
ran; `python -m foretouch.bench.side NOTES bare SECONDS` sleeps and spins as the sides do, and writes how late it woke.
"""

from __future__ import annotations

import gc
import runpy
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

__all__ = ["Notes", "main", "read_notes"]

PERIOD_NS = 1_000_000


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
    from foretouch.session.loop_timer import LoopTimer, steady
    from foretouch.session.scheduling import be_prompt

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
