"""A node on a live ROS 2 graph, without ROS 2: over Zenoh, as `rmw_zenoh_cpp` is there."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from foretouch.errors import LinkError, MissingExtraError
from foretouch.link import check_endpoint, is_encrypted
from foretouch.recordings.formats.topics import StandardTopic
from foretouch.ros2.keys import Node, attachment, publisher_gid
from foretouch.ros2.topics import qos_of, type_of

if TYPE_CHECKING:
    import zenoh

CONNECTING_MS = 1000
"""Longest time that an attempt to reach the router takes [ms]."""

NODE_NUMBER = 0
"""Number of the node in its session; publishers have the numbers behind it."""


@dataclass
class _Publisher:
    """One topic that is offered: what sends it, its liveliness token, its identifier and how many went out."""

    publisher: Any
    token: Any
    gid: bytes
    sent: int = 0


class Graph:
    """A node and its publishers, on a Zenoh router where the ROS 2 graph meets.

    It is a client of the router: it listens on no port, and what it sends goes through the router. A topic is offered
    from its first message on. Where the router goes away, Zenoh looks for it in the background, and offers everything
    again once it is back.

    Args:
        router: Endpoint, such as ``"tcp/127.0.0.1:7447"``.
        node: Name of the node.
        insecure: Allow a router off this machine without encryption.

    Attributes:
        unsent: Messages that were not sent, because there was no router or the network refused them.

    Raises:
        LinkError: The endpoint is malformed or not allowed.
        MissingExtraError: eclipse-zenoh is not installed.
    """

    def __init__(self, router: str, node: Node, *, insecure: bool = False) -> None:
        try:
            import zenoh
        except ImportError:
            raise MissingExtraError("eclipse-zenoh", "link") from None
        check_endpoint(router, insecure=insecure)
        if is_encrypted(router):
            raise LinkError(f"router {router!r}: write it as tcp/HOST:PORT; keys for a ROS 2 graph are not read here")
        self._zenoh: Any = zenoh
        self._router, self._node = router, node
        self._session: Any = None
        self._token: Any = None
        self._publishers: dict[str, _Publisher] = {}
        self.unsent = 0

    @property
    def connected(self) -> bool:
        """Whether the router is there."""
        return self._session is not None and bool(self._session.info.routers_zid())

    @property
    def sent(self) -> dict[str, int]:
        """Messages sent, by full name of the topic."""
        return {self._node.full_name(name): publisher.sent for name, publisher in self._publishers.items()}

    def connect(self) -> bool:
        """Look for the router, for at most a second if it was never there; whether it is."""
        if self._session is None:
            try:
                self._session = self._zenoh.open(_config(self._router))
            except self._zenoh.ZError:
                return False
            token = self._node.token(self._id, NODE_NUMBER)
            self._token = self._session.liveliness().declare_token(token)
        return self.connected

    def publish(self, topic: StandardTopic, data: bytes) -> None:
        """Send a message; never waits and never raises.

        Args:
            topic: Topic to publish on.
            data: CDR bytes of the message.
        """
        if self._session is None:
            self.unsent += 1
            return
        try:
            there = self._publishers.get(topic.name)
            if there is None:
                there = self._publishers[topic.name] = self._offer(topic)
            there.publisher.put(data, attachment=attachment(there.sent + 1, time.time_ns(), there.gid))
        except self._zenoh.ZError:
            self.unsent += 1
        else:
            there.sent += 1

    def close(self) -> None:
        """Leave the graph: topics and node are gone from it at once."""
        if self._session is not None:
            self._session.close()
            self._session = None

    @property
    def _id(self) -> str:
        return str(self._session.info.zid())

    def _offer(self, topic: StandardTopic) -> _Publisher:
        kind, qos = type_of(topic), qos_of(topic)
        reliability = self._zenoh.Reliability.RELIABLE if qos.reliable else self._zenoh.Reliability.BEST_EFFORT
        numbers = NODE_NUMBER, NODE_NUMBER + 1 + len(self._publishers)
        token = self._node.publisher_token(self._id, numbers, topic.name, kind, qos)
        publisher = self._session.declare_publisher(
            self._node.topic_key(topic.name, kind),
            congestion_control=self._zenoh.CongestionControl.DROP,
            reliability=reliability,
        )
        return _Publisher(publisher, self._session.liveliness().declare_token(token), publisher_gid(token))


def _config(router: str) -> zenoh.Config:
    import zenoh

    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": "client",
        "connect/endpoints": [router],
        "connect/timeout_ms": CONNECTING_MS,
        "connect/retry": {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/protocols": ["tcp"],
        "transport/shared_memory/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config
