"""What the link adds: one-way times over TCP, TLS and QUIC by turns, and what a session adds to a configured delay.

Times are one-way because both processes are on this machine and share its monotonic clock. What a session adds lasts
from the moment before a command is handed to the link until the stage that simulates the delay would give it to the
follower's next tick, less the delay.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.bench.children import children
from foretouch.bench.rows import Row, Scope
from foretouch.bench.timing import spread
from foretouch.bench.wire import DELAYED, KEY, KINDS, STRETCH, open_wire
from foretouch.errors import ForetouchError, MissingExtraError
from foretouch.link import Faults, FaultStage, KeyFolder, ZenohLink, free_endpoint
from foretouch.link.certificates import utc_now
from foretouch.messages import Command, decode
from foretouch.session.runners.loop_timer import steady

DELAY, STRETCHES = 0.08, 4
REACH_MS = 0.4
POLL = 2e-5
"""The stage is looked at so often [s]; a follower looks once a tick."""

Times = NDArray[np.float64]


def one_way_times(kinds: tuple[str, ...], stretches: int) -> dict[str, Times]:
    """Milliseconds from one process to the other, shape (messages that arrived,), in the order in which they were sent.

    Args:
        kinds: Some of `KINDS`, and `DELAYED`, whose delay is taken off.
        stretches: Seconds at 1 kHz of each, by turns.
    """
    found: dict[str, list[float]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        KeyFolder(folder).init(utc_now())
        for role in ("leader", "follower"):
            KeyFolder(folder).issue(role, "", utc_now())
        ends = {kind: free_endpoint().removeprefix("tcp/") for kind in kinds}
        opened: dict[str, Any] = {}
        try:
            for kind, endpoint in ends.items():
                if kind == DELAYED:
                    opened[kind] = ZenohLink(listen=[f"tcp/{endpoint}"], subscribe=["command"])
                else:
                    opened[kind] = open_wire(kind, endpoint, folder, listen=True)
                    opened[kind].declare_subscriber(KEY, _receiver(found[kind].append))
            wires = [f"{kind}={endpoint}" for kind, endpoint in ends.items()]
            command = [sys.executable, "-m", "foretouch.bench.wire", str(folder), str(stretches), *wires]
            with children() as started, steady():
                sender = started.start(command)
                _wait(sender, opened.get(DELAYED), found[DELAYED].append)
        finally:
            for each in opened.values():
                each.close()
    if sender.returncode:
        raise ForetouchError(f"the sending process ended with exit code {sender.returncode}")
    return {kind: np.array(found[kind]) for kind in kinds}


def _receiver(keep: Callable[[float], None]) -> Callable[[Any], None]:
    def receive(sample: Any) -> None:
        arrival = time.monotonic_ns()
        keep((arrival - decode(sample.payload.to_bytes(), Command).time_ns) * 1e-6)

    return receive


def _wait(sender: subprocess.Popen[bytes], link: ZenohLink | None, keep: Callable[[float], None]) -> None:
    """Until the sender has ended; meanwhile hold back what comes over the link, as a follower does."""
    stage: FaultStage[Command] = FaultStage(Faults(delay=DELAY))
    while sender.poll() is None:
        for _ in range(50):
            if link is not None:
                for arrival, command in link.take("command"):
                    stage.push(arrival, command)
                now = time.monotonic_ns()
                for command in stage.pop_due(now):
                    keep((now - command.time_ns) * 1e-6 - DELAY * 1e3)
            time.sleep(POLL)


def _rows(what: str, times: Times, reach: float | None) -> list[Row]:
    """Median and 99 % of each stretch."""
    parts = np.array_split(times, max(1, times.size // STRETCH))
    return [
        Row.of(f"{what}, 50 %", spread([np.percentile(part, 50) for part in parts]), "ms", reach),
        Row.of(f"{what}, 99 %", spread([np.percentile(part, 99) for part in parts]), "ms"),
    ]


def measure_link(scope: Scope) -> list[Row]:
    """Milliseconds one way, and how many times those of TCP the others take."""
    try:
        times = one_way_times((DELAYED, *KINDS), STRETCHES)
    except MissingExtraError as error:
        scope.say(f"{error}: the rows of the link are left out")
        return []
    rows = []
    medians = {kind: float(np.median(sent)) for kind, sent in times.items() if sent.size}
    for kind in KINDS:
        if kind not in medians:
            scope.say(f"nothing came over {kind}: its rows are left out")
    rows += [
        Row(f"one way over {kind.upper()} over that over TCP, 50 %", medians[kind] / medians["tcp"], "x")
        for kind in KINDS[1:]
        if kind in medians and "tcp" in medians
    ]
    if DELAYED in medians:
        rows += _rows(f"a command over a configured delay of {DELAY * 1e3:g} ms, beyond it", times[DELAYED], REACH_MS)
    for kind in KINDS:
        if kind in medians:
            rows += _rows(f"one way over {kind.upper()}", times[kind], None)
    return rows
