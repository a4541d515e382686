"""The other end of a wire: a process that sends commands at 1 kHz over TCP, TLS, QUIC and the link, by turns.

`python -m foretouch.bench.wire FOLDER STRETCHES KIND=ENDPOINT ...`. TLS and QUIC show certificates of the private
authority in the folder, both ends to each other, as a session between machines does.
"""

from __future__ import annotations

import base64
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from foretouch.link import ZenohLink, load_credentials
from foretouch.messages import VERSION, Command, encode
from foretouch.session.runners.loop_timer import LoopTimer, steady

KINDS = ("tcp", "tls", "quic")
"""Of bare wires."""

DELAYED = "delayed"
"""The link of a session, over TCP, with a delay in it."""

KEY = "foretouch/bench"

PERIOD = 1e-3
STRETCH = 1000
"""Between commands [s], and how many are sent before it is the next wire's turn."""

SETTLING = 2.0
"""Wires find each other for so long [s] before the first command."""


def open_wire(kind: str, endpoint: str, folder: Path, *, listen: bool) -> Any:
    """A session of Zenoh as the link opens one: no scouting, low latency, nothing queued by priority.

    Args:
        kind: One of `KINDS`.
        endpoint: ``HOST:PORT``.
        folder: Of keys.
        listen: Whether this end listens, as the follower; else it connects, as the leader.
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


def main(folder: str, stretches: str, *wires: str) -> None:
    """Send.

    Args:
        folder: Of keys.
        stretches: How many of each wire.
        *wires: ``KIND=HOST:PORT``.
    """
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
        for _ in range(int(stretches)):
            for send in sends:
                for _ in range(STRETCH):
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


if __name__ == "__main__":
    main(*sys.argv[1:])
