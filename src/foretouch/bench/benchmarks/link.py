"""What the link adds: one-way times over TCP, TLS and QUIC by turns, and what a session adds to a configured delay.

Times are one-way because both processes are on this machine and share its monotonic clock. What a session adds lasts
from the moment before a command is handed to the link until the stage that simulates the delay would give it to the
follower's next tick, less the delay.

The other end is `python -m foretouch.bench.benchmarks.link FOLDER SEGMENTS KIND=ENDPOINT ...`, which sends commands at
1 kHz. TLS and QUIC show certificates of the private authority in the folder, both ends to each other, as a session
between machines does.
"""

from __future__ import annotations

import base64
import functools
import json
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from foretouch.bench.timing import Array, Row, Scope, spread
from foretouch.errors import ForetouchError, MissingExtraError
from foretouch.files.children import children
from foretouch.link import Faults, FaultStage, KeyFolder, ZenohLink, free_endpoint, load_credentials
from foretouch.link.certificates import utc_now
from foretouch.messages import VERSION, Command, decode, encode
from foretouch.session.runners.loop_timer import LoopTimer, steady

KINDS = ("tcp", "tls", "quic")  # Transports of the bare wires
DELAYED = "delayed"  # The link of a session, over TCP, with a delay in it

KEY = "foretouch/bench"

PERIOD = 1e-3
SEGMENT = 1000  # Time between commands [s], and number sent before the next wire's turn
SETTLING = 2.0  # Time that wires have to find each other before the first command [s]


def open_wire(kind: str, endpoint: str, folder: Path, *, listen: bool) -> Any:
    """A session of Zenoh as the link opens one: no scouting, low latency, nothing queued by priority.

    The endpoint is ``HOST:PORT`` and the folder holds keys. The follower listens; the leader connects.
    """
    import zenoh

    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": "peer",
        "listen/endpoints": [f"{kind}/{endpoint}"] if listen else [],
        "connect/endpoints": [] if listen else [f"{kind}/{endpoint}"],
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/unicast/lowlatency": True,
        "transport/unicast/qos/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    if kind != "tcp":
        settings["transport/link/tls"] = _secured(folder, "follower" if listen else "leader")
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def _secured(folder: Path, role: str) -> dict[str, object]:
    shown = load_credentials(role, folder)
    own = {"private_key": shown.identity.key, "certificate": shown.identity.certificate}
    files = {f"{end}_{name}": content for end in ("listen", "connect") for name, content in own.items()}
    files["root_ca_certificate"] = shown.authority.certificate
    encoded = {f"{name}_base64": base64.b64encode(content).decode() for name, content in files.items()}
    return {"enable_mtls": True, "verify_name_on_connect": False, **encoded}


def main(folder: str, segments: str, *wires: str) -> None:
    """Send `segments` times by turns over each of the wires, ``KIND=HOST:PORT``, with the keys of a folder."""
    sends: list[Callable[[Command], object]] = []
    opened: list[Any] = []
    for kind, _, endpoint in (wire.partition("=") for wire in wires):
        if kind == DELAYED:
            opened.append(ZenohLink(connect=[f"tcp/{endpoint}"]))
            sends.append(opened[-1].publish)
        else:
            opened.append(open_wire(kind, endpoint, Path(folder), listen=False))
            sends.append(_sender(opened[-1]))
    time.sleep(SETTLING)
    timer, sequence = LoopTimer(PERIOD), 0
    with steady():
        for _ in range(int(segments)):
            for send in sends:
                for _ in range(SEGMENT):
                    timer.wait()
                    sequence += 1
                    send(Command(VERSION, sequence, time.monotonic_ns(), 0.01, 0))
    time.sleep(1.0)  # what is under way arrives
    for each in opened:
        each.close()


def _sender(session: Any) -> Callable[[Command], object]:
    import zenoh

    publisher = session.declare_publisher(KEY, congestion_control=zenoh.CongestionControl.DROP)
    return lambda command: publisher.put(encode(command))


DELAY, SEGMENTS = 0.08, 4
REACH_MS = 0.4
POLL = 2e-5  # Period at which the stage is polled [s]; a follower polls once a tick


def one_way_times(kinds: tuple[str, ...], segments: int) -> dict[str, Array]:
    """Milliseconds one way of the messages that arrived, by kind, in the order in which they were sent.

    Of each of some `KINDS`, and of `DELAYED`, whose delay is taken off, `segments` seconds at 1 kHz by turns.
    """
    result: dict[str, list[float]] = defaultdict(list)
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
                    opened[kind].declare_subscriber(KEY, functools.partial(_receive, result[kind]))
            wires = [f"{kind}={endpoint}" for kind, endpoint in ends.items()]
            command = [sys.executable, "-m", "foretouch.bench.benchmarks.link", str(folder), str(segments), *wires]
            with children() as started, steady():
                sender = started.start(command)
                _wait(sender, opened.get(DELAYED), result[DELAYED].append)
        finally:
            for each in opened.values():
                each.close()
    if sender.returncode:
        raise ForetouchError(f"the sending process ended with exit code {sender.returncode}")
    return {kind: np.array(result[kind]) for kind in kinds}


def _receive(kept: list[float], sample: Any) -> None:
    arrival = time.monotonic_ns()
    kept.append((arrival - decode(sample.payload.to_bytes(), Command).time_ns) * 1e-6)


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


def _rows(what: str, times: Array, reach: float | None) -> list[Row]:
    parts = np.array_split(times, max(1, times.size // SEGMENT))
    return [
        Row.of(f"{what}, 50 %", spread([np.percentile(part, 50) for part in parts]), "ms", reach),
        Row.of(f"{what}, 99 %", spread([np.percentile(part, 99) for part in parts]), "ms"),
    ]


def measure_link(scope: Scope) -> list[Row]:
    """Milliseconds one way, and how many times those of TCP the others take."""
    try:
        times = one_way_times((DELAYED, *KINDS), SEGMENTS)
    except MissingExtraError as error:
        scope.say(f"{error}: the rows of the link are left out")
        return []
    rows = []
    medians = {kind: float(np.median(sent)) for kind, sent in times.items() if sent.size}
    for kind in KINDS:
        if kind not in medians:
            scope.say(f"nothing came over {kind}: its rows are left out")
    came = [kind for kind in KINDS if kind in medians]
    for kind in came[1:] if "tcp" in came else ():
        rows.append(Row(f"one way over {kind.upper()} over that over TCP, 50 %", medians[kind] / medians["tcp"], "x"))
    if DELAYED in medians:
        rows += _rows(f"a command over a configured delay of {DELAY * 1e3:g} ms, beyond it", times[DELAYED], REACH_MS)
    for kind in came:
        rows += _rows(f"one way over {kind.upper()}", times[kind], None)
    return rows


if __name__ == "__main__":
    main(*sys.argv[1:])
