"""A session in real time with console and recorder, by turns with a loop that has nothing to do: how late do they wake?

The bare loop sleeps and spins exactly as the sides do, alone. What it is late is the machine's; what a side is later is
that four processes share the cores, and ours.

A side runs as `python -m foretouch.bench.benchmarks.loops NOTES foretouch leader ...`, which is that command and writes
into NOTES when the collector ran; with `NOTES bare SECONDS` the bare loop runs and writes how late it woke.
"""

from __future__ import annotations

import contextlib
import gc
import itertools
import runpy
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from foretouch.bench.timing import Row, Scope, spread
from foretouch.errors import ForetouchError
from foretouch.files.children import children, last_line, measure_process
from foretouch.link import free_endpoint
from foretouch.quantities import Rows

LATE_NS = 500_000  # A tick that woke later than this after its deadline [ns] counts as late: half a period

PERIOD_NS = 1_000_000

CAUSES = ("scheduler", "garbage collection", "us")
"""Why a tick is late: woken late by the kernel; the collector ran; the tick before computed beyond its budget."""

Integers = NDArray[np.int64]


class Ticks(NamedTuple):
    """Ticks of one loop, each array of shape (n,) [ns]."""

    deadline_ns: Integers
    """When each was to begin (monotonic clock); of a tick that passed over deadlines, the first that it missed."""
    late_ns: Integers  # Time by which it began later
    compute_ns: Integers
    """What the tick before it computed, by the wall clock: where the kernel took the core away, that is in it."""


def ticks_of(rows: Rows) -> Ticks:
    """Ticks from the rows of either side in a session's log.

    A row has its deadline and the time since the tick before began. So the beginnings follow by summing, up to one
    constant; the earliest tick of an unbroken run of rows is on time, for the loop spins before its deadline.
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
    """Late ticks by each of `CAUSES`; `collections` are begin and end of each run of the collector [ns]."""
    result = dict.fromkeys(CAUSES, 0)
    for index in np.flatnonzero(ticks.late_ns > LATE_NS).tolist():
        deadline = int(ticks.deadline_ns[index])
        begin, end = deadline - PERIOD_NS, deadline + int(ticks.late_ns[index])
        before = int(ticks.late_ns[index - 1]) if index else 0
        if any(first < end and last > begin for first, last in collections):
            result["garbage collection"] += 1
        elif int(ticks.compute_ns[index]) > PERIOD_NS - min(before, LATE_NS):
            result["us"] += 1
        else:
            result["scheduler"] += 1
    return result


class Notes(msgspec.Struct):
    """Begin and end of each run of the collector, by the monotonic clock [ns]; lateness of a bare loop's ticks [ns]."""

    collections: list[tuple[int, int]] = []
    late_ns: list[int] = []


def read_notes(path: Path) -> Notes:
    """What a process wrote."""
    return msgspec.json.decode(path.read_bytes(), type=Notes)


@contextmanager
def _noting(path: Path) -> Iterator[Notes]:
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


def side(notes: str, what: str, *arguments: str) -> None:
    """Run the command or, for `seconds`, a loop at 1 kHz with nothing to do, and write the notes at the end."""
    with _noting(Path(notes)) as noted:
        if what == "bare":
            from foretouch.session.runners.loop_timer import be_prompt, measure_loop

            be_prompt()
            noted.late_ns = measure_loop(PERIOD_NS * 1e-9, round(float(arguments[0]) * 1e9 / PERIOD_NS)).late_ns
        else:
            sys.argv = ["foretouch", *arguments]
            runpy.run_module("foretouch", run_name="__main__")  # as `python -m foretouch` does


SIDES = ("leader", "follower")

SECONDS, ROUNDS = 6.0, 3
FULL_SECONDS, FULL_ROUNDS = 60.0, 5

SETTLING_NS = 1_500_000_000  # Time after the start during which a session is not counted [ns]: its processes still load
ENDING = 20.0  # Time that the other processes have to end after the leader has [s]

REACH_MS = 0.1

NAMES = ("leader", "recorder", "console", "follower")
"""Processes of a session, in the order in which they are waited for."""

Round = dict[str, tuple[Ticks, dict[str, int]]]
"""Ticks of each side, and why some are late."""


def bare_round(folder: Path, seconds: float) -> np.ndarray:
    """Lateness of each tick of a bare loop [ns], which runs for a time [s] in a process of its own."""
    notes = folder / "bare.json"
    measure_process(["-m", "foretouch.bench.benchmarks.loops", str(notes), "bare", str(seconds)])
    return np.array(read_notes(notes).late_ns, dtype=np.int64)


def session_round(folder: Path, seconds: float) -> Round:
    """What a session [s] did, from its recording and its sides' notes; an error names a process that ended badly."""
    from foretouch.recordings import read_session

    recording = folder / "session.mcap"
    notes = {side: folder / f"{side}.json" for side in SIDES}
    with _processes(folder, recording, notes, seconds) as running:
        try:
            codes = [process.wait(seconds + 60.0 if not index else ENDING) for index, process in enumerate(running)]
        except subprocess.TimeoutExpired as error:
            raise ForetouchError(f"a process of the session did not end: {error}") from None
    failed = [
        f"{name} ended with exit code {code}: {last_line((folder / f'{name}.txt').read_text(errors='replace'))}"
        for name, code in zip(NAMES, codes, strict=True)
        if code
    ]
    if failed:
        raise ForetouchError(f"a session failed: {'; '.join(failed)}")
    log = read_session(recording)
    results: Round = {}
    for side, rows in (("leader", log.leader), ("follower", log.follower)):
        ticks = ticks_of(rows)
        counted = ticks.deadline_ns > int(log.leader["time_ns"][0]) + SETTLING_NS
        ticks = Ticks(*(values[counted] for values in ticks))
        results[side] = ticks, causes(ticks, read_notes(notes[side]).collections)
    return results


@contextlib.contextmanager
def _processes(
    folder: Path, recording: Path, notes: dict[str, Path], seconds: float
) -> Iterator[Sequence[subprocess.Popen[bytes]]]:
    """Leader, follower, recorder and console, as `foretouch teleop` starts them; the leader is the first."""
    follower, leader = free_endpoint(), free_endpoint()
    port = free_endpoint().rpartition(":")[2]
    watching = ["--connect", follower, "--connect", leader]
    module = ["-m", "foretouch"]

    def side(name: str) -> list[str]:
        return ["-m", "foretouch.bench.benchmarks.loops", str(notes[name]), "foretouch", name]

    leading = ["--listen", leader, "--connect", follower, "--wait-for-recorder", "--duration", str(seconds)]
    commands = {
        "follower": [*side("follower"), "--listen", follower],
        "console": [*module, "console", "--port", port, *watching],
        "recorder": [*module, "record", str(recording), *watching],
        "leader": [*side("leader"), *leading],
    }
    running = {}
    with children() as started:
        for name, command in commands.items():
            with (folder / f"{name}.txt").open("wb") as text:
                full = [sys.executable, *command]
                running[name] = started.start(full, cwd=folder, stdout=subprocess.DEVNULL, stderr=text)
        yield [running[name] for name in NAMES]


def measure_loops(scope: Scope) -> list[Row]:
    """Lateness of both sides and of the bare loop, and causes."""
    seconds, rounds = (FULL_SECONDS, FULL_ROUNDS) if scope.full else (SECONDS, ROUNDS)
    bare: list[float] = []
    late: dict[str, list[float]] = {side: [] for side in SIDES}
    reasons: dict[str, list[dict[str, float]]] = {side: [] for side in SIDES}
    with tempfile.TemporaryDirectory() as name:
        for _ in range(rounds):
            bare.append(_p99(bare_round(Path(name), seconds)))
            for side, (ticks, why) in session_round(Path(name), seconds).items():
                late[side].append(_p99(ticks.late_ns))
                reasons[side].append({cause: 1e3 * count / ticks.late_ns.size for cause, count in why.items()})
    what = "a session with console and recorder"
    rows = [
        Row.of(f"{what}: {side} later than a bare loop, 99 %", spread(np.subtract(late[side], bare)), "ms", REACH_MS)
        for side in SIDES
    ]
    rows += [Row.of(f"{what}: {side} late, 99 %", spread(late[side]), "ms") for side in SIDES]
    rows.append(Row.of("a bare loop late, 99 %", spread(bare), "ms"))
    late_by = f"of 1,000 ticks over {LATE_NS * 1e-6:g} ms late by"
    for side, cause in itertools.product(SIDES, CAUSES):
        counts = spread([why[cause] for why in reasons[side]])
        rows.append(Row.of(f"{side}, {late_by}: {cause}", counts, "ticks"))
    return rows


def _p99(late_ns: np.ndarray) -> float:
    return float(np.percentile(late_ns, 99)) * 1e-6


if __name__ == "__main__":
    side(*sys.argv[1:])
