"""Publishes a running session to a live ROS 2 graph, one way.

A message is stamped by the clock that ROS 2 goes by, though its sender gave only its own monotonic time; and of each
kind no more go out than their rate allows.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Hashable
from typing import Final

from foretouch.errors import SettingError
from foretouch.link import ZenohLink
from foretouch.messages import LeaderState, Message, Telemetry
from foretouch.ros2.graph import Graph, as_ros

BLOCK_NS = 30_000_000_000
"""The smallest transit is that of this block of time and of the one before [ns]: the last half to whole minute."""

MOST_SENDERS = 64
"""Largest number of processes of a session kept apart; beyond it, the one that was met first is forgotten."""


READS = 5  # Number of readings of both clocks, of which the closest counts: a process may be put aside between the two


def wall_offset_ns() -> int:
    """Offset from this machine's monotonic clock to nanoseconds since 1970."""
    readings = [(time.monotonic_ns(), time.time_ns(), time.monotonic_ns()) for _ in range(READS)]
    before, wall, after = min(readings, key=lambda reading: reading[2] - reading[0])
    return wall - (before + after) // 2


class SessionClock:
    r"""Puts the times of all senders of a session on this machine's monotonic clock.

    A message carries its sender's monotonic clock t_s, and comes here at t_r. The transit :math:`t_r - t_s` holds the
    unknown difference of both clocks, always the same, and how long the message travelled. Its smallest value of the
    last minute is the difference and the shortest way, so that

    .. math:: t = t_s + \min (t_r - t_s)

    is when the message was made, late by that shortest way alone (some 0.1 ms on one machine), with the sender's own
    even spacing and without jitter of the network. Clocks that drift are followed, two blocks behind at most: at 50
    parts in a million, within 3 ms.
    """

    def __init__(self) -> None:
        # by sender: begin of its block, smallest transit of the block before and of this one [ns]
        self._transits: dict[Hashable, tuple[int, int, int]] = {}

    def local_ns(self, sender: Hashable, sent_ns: int, arrival_ns: int) -> int:
        """The time at which a message was made, by this machine's monotonic clock [ns].

        Args:
            sender: Tells processes apart, each with a clock of its own.
            sent_ns: The sender's clock in the message [ns].
            arrival_ns: Time of its arrival [ns].
        """
        transit = arrival_ns - sent_ns
        if sender not in self._transits and len(self._transits) >= MOST_SENDERS:
            self._transits.pop(next(iter(self._transits)))
        begun, before, now = self._transits.get(sender, (arrival_ns, transit, transit))
        if arrival_ns - begun >= BLOCK_NS:
            begun, before, now = arrival_ns, now, transit
        self._transits[sender] = begun, before, min(now, transit)
        return sent_ns + min(now, transit, before)


EARLY, EARLY_NS = 0.25, 250_000
"""Largest lead of a message over its turn, in periods and at most [ns]: ticks are not quite even."""


class Pace:
    """Lets messages through at a rate at most, evenly, and none that is older than one before.

    Args:
        rate: Messages a second, above 0 and finite.

    Raises:
        SettingError: The rate is none.
    """

    __slots__ = ("_early_ns", "_newest_ns", "_period_ns", "_turn_ns")

    def __init__(self, rate: float) -> None:
        if not 0.0 < rate < math.inf:
            raise SettingError("rate", rate, "must be above 0 messages a second")
        self._period_ns = 1e9 / rate
        self._early_ns = min(EARLY * self._period_ns, EARLY_NS)
        self._turn_ns = self._newest_ns = -math.inf

    def is_due(self, now_ns: int) -> bool:
        """Whether a message that was made now goes out; counts it if so."""
        if now_ns <= self._newest_ns or now_ns < self._turn_ns - self._early_ns:
            return False
        self._newest_ns = now_ns
        late = now_ns > self._turn_ns + self._period_ns
        self._turn_ns = (now_ns if late else self._turn_ns) + self._period_ns
        return True


SENDERS: Final = {
    "telemetry": "follower",
    "leader": "leader",
    "model": "follower",
    "fixture": "camera",
    "image": "camera",
}
"""Channels whose messages are published, and whose clock is in them."""

BRIDGE_CHANNELS: Final = (*SENDERS, "stop")
"""Channels that the bridge's link receives."""

POLL_PERIOD = 0.002  # Time between two polls of the link [s]
ROUTER_PERIOD = 2.0  # Time between two looks for the router, and at the clock [s]


class Bridge:
    """Publishes what a session says as ROS 2 messages.

    It only listens to the session. Of several leaders that one goes on which the follower obeys.

    Args:
        graph: Graph to publish to.
        rate: Messages a second of each topic at most, above 0.
        router: Router of the graph, as people know it.
        say: Prints one line for people.

    Raises:
        SettingError: The rate is none.
    """

    def __init__(self, graph: Graph, *, rate: float, router: str, say: Callable[[str], None]) -> None:
        self._graph, self._router, self._say = graph, router, say
        self._clock = SessionClock()
        self._paces = {name: Pace(rate) for name in SENDERS}
        self._obeyed = 0
        self._offset_ns = 0
        self._there: bool | None = None
        self._ended = False

    def run(self, link: ZenohLink, should_stop: Callable[[], bool]) -> None:
        """Go on until stopped, or the session has ended.

        Args:
            link: Link with `BRIDGE_CHANNELS`.
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
        before, self._there = self._there, self._graph.connect()
        self._offset_ns = wall_offset_ns()
        if self._there is before:
            return
        if self._there:
            text = f"on the ROS 2 graph, through {self._router}"
        elif before is None:
            text = f"no ROS 2 router at {self._router}: goes on trying; one is `ros2 run rmw_zenoh_cpp rmw_zenohd`"
        else:
            text = f"the ROS 2 router at {self._router} is gone: goes on trying"
        self._say(f"bridge: {text}")

    def take(self, channel: str, message: Message, arrival_ns: int) -> None:
        """Pass one message on, if there is a router and it is the message's turn.

        Args:
            channel: Channel on which it came.
            message: Message of the session.
            arrival_ns: Time of its arrival, by this machine's monotonic clock [ns].
        """
        if isinstance(message, Telemetry):
            self._obeyed = message.epoch
        if channel == "stop":
            self._ended = True
        if channel not in SENDERS:
            return
        if not self._there or (isinstance(message, LeaderState) and self._obeyed not in (0, message.epoch)):
            return
        process = message.epoch if isinstance(message, LeaderState) else getattr(message, "run", 0)
        local_ns = self._clock.local_ns((SENDERS[channel], process), message.time_ns, arrival_ns)
        if not self._paces[channel].is_due(local_ns):
            return
        stamp_ns = local_ns + self._offset_ns
        for topic, data in as_ros(message, stamp_ns):
            self._graph.publish(topic, data)
