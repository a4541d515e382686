"""Messages over Eclipse Zenoh: explicit endpoints, no scouting, nothing in the loop that can wait."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Any

from foretouch.errors import DecodeError, LinkError, MissingExtraError, PeerVersionError
from foretouch.link.endpoints import check_endpoint, check_port_free
from foretouch.messages import CHANNELS, Message, decode, encode

if TYPE_CHECKING:
    import zenoh

__all__ = ["ZenohLink"]

LONGEST_QUEUE = 20_000
"""Messages that an inbox holds; beyond it the oldest are dropped, so that a reader that stopped costs no memory."""


class ZenohLink:
    """One process's place on the network.

    Arriving messages are decoded on Zenoh's threads and wait in an inbox, a `deque` per channel, whose append and
    popleft are atomic: the loop takes no lock. What does not decode is counted and dropped.

    Args:
        listen: Endpoints to listen on.
        connect: Endpoints to connect to; a peer that is not there yet is waited for in the background.
        subscribe: Names of the channels to receive.
        insecure: Allow endpoints off this machine.
        watch: Called with each arriving message on Zenoh's thread, instead of filling the inboxes.

    Attributes:
        inboxes: By channel: ``(arrival [ns, this machine's monotonic clock], message)``, oldest first.
        undecodable: Messages that arrived and were dropped.
        unsent: Messages that the network refused to take.
        version_error: Set when a peer speaks another version.

    Raises:
        LinkError: An endpoint is malformed, not allowed or in use.
        MissingExtraError: eclipse-zenoh is not installed.
    """

    def __init__(
        self,
        *,
        listen: Sequence[str] = (),
        connect: Sequence[str] = (),
        subscribe: Iterable[str] = (),
        insecure: bool = False,
        watch: Callable[[Message], None] | None = None,
    ) -> None:
        try:
            import zenoh
        except ImportError:
            raise MissingExtraError("eclipse-zenoh", "link") from None
        for endpoint in (*listen, *connect):
            check_endpoint(endpoint, insecure=insecure)
        for endpoint in listen:
            check_port_free(endpoint)
        self.inboxes: dict[str, deque[tuple[int, Message]]] = {}
        self.undecodable = 0
        self.unsent = 0
        self._send_error = zenoh.ZError
        self.version_error: PeerVersionError | None = None
        self._watch = watch
        try:
            self._session: Any = zenoh.open(_config(listen, connect))
        except zenoh.ZError as error:
            raise LinkError(f"cannot open the link on {', '.join((*listen, *connect))}: {error}") from None
        self._publishers = {
            channel.kind: self._session.declare_publisher(
                f"foretouch/{channel.name}", congestion_control=zenoh.CongestionControl.DROP
            )
            for channel in CHANNELS.values()
        }
        self._subscribers = [self._subscribe(name) for name in subscribe]

    def _subscribe(self, name: str) -> Any:
        kind = CHANNELS[name].kind
        inbox = self.inboxes[name] = deque(maxlen=LONGEST_QUEUE)

        def receive(sample: zenoh.Sample) -> None:
            arrival = time.monotonic_ns()
            try:
                message = decode(sample.payload.to_bytes(), kind)
            except PeerVersionError as error:
                self.undecodable += 1
                self.version_error = error
            except DecodeError:
                self.undecodable += 1
            else:
                if self._watch is None:
                    inbox.append((arrival, message))
                else:
                    self._watch(message)

        return self._session.declare_subscriber(f"foretouch/{name}", receive)

    def publish(self, message: Message) -> None:
        """Send a message on its channel; never waits and never raises: what cannot be sent is dropped."""
        try:
            self._publishers[type(message)].put(encode(message))
        except self._send_error:
            self.unsent += 1

    def take(self, name: str) -> list[tuple[int, Any]]:
        """What has arrived on a channel since the last call, oldest first."""
        inbox = self.inboxes[name]
        return [inbox.popleft() for _ in range(len(inbox))]

    def close(self) -> None:
        """Leave the network."""
        self._session.close()

    def __enter__(self) -> ZenohLink:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _config(listen: Sequence[str], connect: Sequence[str]) -> zenoh.Config:
    import zenoh

    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": "peer",
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        # A peer that is not there yet is retried for ever, quickly, and is no error.
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        # Without these two, jitter of the machine alone loses messages on loopback.
        "transport/unicast/lowlatency": True,
        "transport/unicast/qos/enabled": False,
        "transport/link/tx/lease": 2000,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config
