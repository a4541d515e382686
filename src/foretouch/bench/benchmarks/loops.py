"""A session in real time with console and recorder, by turns with a loop that has nothing to do: how late do they wake?

The bare loop sleeps and spins exactly as the sides do, alone. What it is late is the machine's; what a side is later is
that four processes share the cores, and ours.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from foretouch.bench.children import children, last_line, measure_process
from foretouch.bench.rows import Row, Scope
from foretouch.bench.side import CAUSES, LATE_NS, Ticks, causes, read_notes, ticks_of
from foretouch.bench.timing import spread
from foretouch.errors import ForetouchError
from foretouch.link import free_endpoint

SIDES = ("leader", "follower")

SECONDS, ROUNDS = 6.0, 3
FULL_SECONDS, FULL_ROUNDS = 60.0, 5

SETTLING_NS = 1_500_000_000
"""A session that starts is not counted for so long: its processes still load."""

ENDING = 20.0
"""The other processes have so long [s] to end after the leader has."""

REACH_MS = 0.1

NAMES = ("leader", "recorder", "console", "follower")
"""Processes of a session, in the order in which they are waited for."""

Round = dict[str, tuple[Ticks, dict[str, int]]]
"""Ticks of each side, and why some are late."""


def bare_round(folder: Path, seconds: float) -> np.ndarray:
    """How late each tick of a bare loop woke [ns], in a process of its own.

    Args:
        folder: For its notes.
        seconds: How long.
    """
    notes = folder / "bare.json"
    measure_process(["-m", "foretouch.bench.side", str(notes), "bare", str(seconds)])
    return np.array(read_notes(notes).late_ns, dtype=np.int64)


def session_round(folder: Path, seconds: float) -> Round:
    """What a session of so many seconds did, from its recording and the notes of its sides.

    Args:
        folder: For both.
        seconds: How long the leader runs.

    Raises:
        ForetouchError: A process ended otherwise than well.
    """
    from foretouch.recordings import read_session

    recording = folder / "session.mcap"
    notes = {side: folder / f"{side}.json" for side in SIDES}
    with _processes(folder, recording, notes, seconds) as running:
        try:
            codes = [process.wait(seconds + 60.0 if not place else ENDING) for place, process in enumerate(running)]
        except subprocess.TimeoutExpired as error:
            raise ForetouchError(f"a process of the session did not end: {error}") from None
    failed = [
        f"{name} ended with exit code {code}: {last_line(_said(folder, name).read_text(errors='replace'))}"
        for name, code in zip(NAMES, codes, strict=True)
        if code
    ]
    if failed:
        raise ForetouchError(f"a session failed: {'; '.join(failed)}")
    log = read_session(recording)
    found: Round = {}
    for side, rows in (("leader", log.leader), ("follower", log.follower)):
        ticks = ticks_of(rows)
        counted = ticks.deadline_ns > int(log.leader["time_ns"][0]) + SETTLING_NS
        ticks = Ticks(*(values[counted] for values in ticks))
        found[side] = ticks, causes(ticks, read_notes(notes[side]).collections)
    return found


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
        return ["-m", "foretouch.bench.side", str(notes[name]), "foretouch", name]

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
            with _said(folder, name).open("wb") as said:
                full = [sys.executable, *command]
                running[name] = started.start(full, cwd=folder, stdout=subprocess.DEVNULL, stderr=said)
        yield [running[name] for name in NAMES]


def _said(folder: Path, name: str) -> Path:
    """What a process of a session says to people."""
    return folder / f"{name}-said.txt"


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
    rows += [
        Row.of(
            f"{side}, of 1,000 ticks over {LATE_NS * 1e-6:g} ms late by: {cause}",
            spread([why[cause] for why in reasons[side]]),
            "ticks",
        )
        for side in SIDES
        for cause in CAUSES
    ]
    return rows


def _p99(late_ns: np.ndarray) -> float:
    return float(np.percentile(late_ns, 99)) * 1e-6
