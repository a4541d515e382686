"""From a running session to a live ROS 2 graph, one way."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Final

from foretouch.link import ZenohLink
from foretouch.messages import Hello, LeaderState, Message, Telemetry
from foretouch.ros2.clock import SessionClock, wall_offset_ns
from foretouch.ros2.graph import Graph
from foretouch.ros2.pace import Pace
from foretouch.ros2.topics import as_ros, probe_on_a_line

__all__ = ["BRIDGE_CHANNELS", "Bridge"]

SENDERS: Final = {
    "telemetry": "follower",
    "leader": "leader",
    "model": "follower",
    "follower-space": "follower",
    "fixture": "camera",
    "image": "camera",
}
"""Channels whose messages go on, and whose clock is in them."""

BRIDGE_CHANNELS: Final = (*SENDERS, "hello", "stop")
"""What the bridge's link receives."""

POLL_PERIOD = 0.002
"""Between two looks at what has come [s]."""

ROUTER_PERIOD = 2.0
"""Between two looks for the router, and at the clock [s]."""


class Bridge:
    """Publishes what a session says as ROS 2 messages.

    It only listens to the session. Of several leaders that one goes on which the follower obeys.

    Args:
        graph: Where to.
        rate: Messages a second of each topic at most, above 0.
        router: Of the graph, as people know it.
        say: Prints one line for people.

    Raises:
        SettingError: The rate is none.
    """

    def __init__(self, graph: Graph, *, rate: float, router: str, say: Callable[[str], None]) -> None:
        self._graph, self._router, self._say = graph, router, say
        self._clock = SessionClock()
        self._paces = {name: Pace(rate) for name in SENDERS}
        self._on_a_line: bool | None = None  # None until the follower has said it
        self._obeyed = 0
        self._offset_ns = 0
        self._there: bool | None = None
        self._ended = False

    def run(self, link: ZenohLink, should_stop: Callable[[], bool]) -> None:
        """Go on until told to stop, or the session has ended.

        Args:
            link: With `BRIDGE_CHANNELS`.
            should_stop: Asked in every round, 500 times a second.
        """
        looked = -math.inf
        while not (should_stop() or self._ended):
            if time.monotonic() - looked >= ROUTER_PERIOD:
                self.look()
                looked = time.monotonic()
            for name in BRIDGE_CHANNELS:
                for arrival_ns, message in link.take(name):
                    self.take(name, message, arrival_ns)
            time.sleep(POLL_PERIOD)

    def look(self) -> None:
        """Look for the router and at the clock that ROS 2 goes by; say so where the router has come or gone."""
        there = self._graph.connect()
        self._offset_ns = wall_offset_ns()
        if there is self._there:
            return
        if there:
            self._say(f"bridge: on the ROS 2 graph, through {self._router}")
        elif self._there is None:
            self._say(
                f"bridge: no ROS 2 router at {self._router}: goes on trying; one is `ros2 run rmw_zenoh_cpp rmw_zenohd`"
            )
        else:
            self._say(f"bridge: the ROS 2 router at {self._router} is gone: goes on trying")
        self._there = there

    def take(self, channel: str, message: Message, arrival_ns: int) -> None:
        """Pass one message on, if there is a router and it is the message's turn.

        Args:
            channel: On which it came.
            message: Of the session.
            arrival_ns: When it came, by this machine's monotonic clock [ns].
        """
        if isinstance(message, Telemetry):
            self._obeyed = message.epoch
        if channel not in SENDERS:
            self._note(channel, message)
            return
        if not self._there:
            return
        if isinstance(message, LeaderState) and self._obeyed not in (0, message.epoch):
            return
        process = message.epoch if isinstance(message, LeaderState) else getattr(message, "run", 0)
        local_ns = self._clock.local_ns((SENDERS[channel], process), message.time_ns, arrival_ns)
        if not self._paces[channel].is_due(local_ns):
            return
        stamp_ns = local_ns + self._offset_ns
        topics = as_ros(message, stamp_ns)
        if self._on_a_line and isinstance(message, Telemetry):
            topics += probe_on_a_line(message, stamp_ns)
        for topic, data in topics:
            self._graph.publish(topic, data)

    def _note(self, channel: str, message: Message) -> None:
        """What the session says of itself."""
        if channel == "stop":
            self._ended = True
        elif isinstance(message, Hello) and message.role == "follower":
            self._on_a_line = not message.texts.get("scene")
