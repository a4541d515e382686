"""The gate: a process by which a program that speaks no Zenoh takes a side of a session, over one TCP connection."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

import msgspec

from foretouch.errors import DecodeError, PeerVersionError
from foretouch.link import Faults, FaultStage, FrameServer, ZenohLink, may_publish
from foretouch.messages import CHANNELS, PROCESS, Command, Hello, Message, Settings, Stop, Telemetry, decode, encode
from foretouch.session.runners.housekeeping import Greeter
from foretouch.session.runners.live import as_texts, fault_texts, link_counts
from foretouch.session.runners.loop_timer import steady

DELAYED = {"leader": ("model", "telemetry", "field", "fixture"), "follower": ("command",)}
"""Channels of what comes to a side over the network that is simulated; the other side's own gate, or its loop, delays
what goes there."""

AT_ONCE = {"leader": ("stop", "hello"), "follower": ("stop", "emergency", "fixture", "hello")}
"""Channels that come to a side without simulated faults, as to the sides of this package."""

OWN = ("hello", "settings")  # Channels of a side on which its gate speaks, and not the program
DELAYS = {"leader": ("force_delay", "return_"), "follower": ("position_delay", "")}
"""Name of the setting that delays what comes to a side, and the prefix of its other faults, in a hello."""

TICK, IDLE = 0.001, 0.05  # Longest wait with and without a program [s]
ARRIVED = 4096  # Messages that wait until the loop takes them; beyond it the oldest are dropped


def gate_channels(side: str) -> tuple[str, ...]:
    """Channels that the link of a side's gate receives."""
    return (*DELAYED[side], *AT_ONCE[side], "settings")


class Gate:
    """Passes a session's messages to a program, and the program's to the session, as a side of this package would.

    What the program says is decoded before it goes on, and only what its side may say. Nothing is judged here: the
    other side does that, as with any peer.

    Args:
        side: ``"leader"`` or ``"follower"``, whose place the program takes.
        server: Where the program connects.
        faults: Simulated faults of what comes to it.

    Attributes:
        ended: Why the session has ended; "" while it has not.
    """

    def __init__(self, side: str, server: FrameServer, faults: Faults) -> None:
        self._side, self._server = side, server
        self._says = {name for name in may_publish(side) if name not in OWN}
        self._names = {CHANNELS[name].kind: name for name in gate_channels(side)}
        self._arrived = deque[tuple[int, Message]](maxlen=ARRIVED)
        self._arriving: FaultStage[Message] = FaultStage(faults)
        self._changed_ns = self._obeyed = self._visit = 0
        self._process: dict[str, str] = {}  # what a hello says of the program, once it has said it
        self.ended = ""

    def hear(self, message: Message) -> None:
        """Take a message of the session; called on the link's thread."""
        self._arrived.append((time.monotonic_ns(), message))
        self._server.ring()

    def run(self, link: ZenohLink, should_stop: Callable[[], bool]) -> None:
        """Pass messages on until the session has ended, or until stopped.

        Args:
            link: Link with `gate_channels`, whose messages `hear` is given.
            should_stop: Asked after each wait.
        """
        greeter, server = Greeter(link, self._side), self._server
        with steady():
            while not (self.ended or should_stop()):
                frames = server.exchange(TICK if server.connected else IDLE)
                if server.visits != self._visit:  # another program, of which nothing is known
                    self._visit, self._process, self._obeyed = server.visits, {}, 0
                for name, data in frames:
                    if server.connected:  # else it was sent away for a frame before this one
                        self._pass_out(link, name, data)
                while self._arrived:
                    self._take(*self._arrived.popleft())
                for message in self._arriving.pop_due(time.monotonic_ns()):
                    self._pass_in(message)
                if server.connected and self._process and greeter.due():
                    greeter.greet(self._texts(link))
        server.exchange(0.0)

    def counts(self) -> dict[str, int]:
        """Frames of the program, and what was lost on the way to it."""
        server = self._server
        return {"taken": server.taken, "handed": server.handed, "dropped": server.dropped}

    def _pass_out(self, link: ZenohLink, name: str, data: bytes) -> None:
        """Send a message of the program to the session."""
        if name not in self._says:
            self._server.send_away(f"a message on channel {name}, on which a {self._side} does not speak")
            return
        try:
            message = decode(data, CHANNELS[name].kind)
        except (DecodeError, PeerVersionError) as error:
            self._server.send_away(f"a message on channel {name} is none: {error}")
            return
        if isinstance(message, Command):
            if link.name:  # as others check it
                message = msgspec.structs.replace(message, holder=link.name)
            self._process = {"leader": message.holder, PROCESS: str(message.epoch)}
        elif isinstance(message, Telemetry):
            self._process, self._obeyed = {PROCESS: str(message.run)}, message.epoch
        link.publish(message)

    def _take(self, arrival_ns: int, message: Message) -> None:
        """Take a message of the session in the loop."""
        if isinstance(message, Settings):
            delay = getattr(message, DELAYS[self._side][0])
            self._arriving.change(delay=delay, jitter=message.jitter, loss=message.loss, outage=message.outage)
            self._changed_ns = arrival_ns
        elif self._names[type(message)] in DELAYED[self._side]:
            self._arriving.push(arrival_ns, message)
        elif not (isinstance(message, Hello) and message.role == self._side):
            self._pass_in(message)
        # A leader without control ends no session, whoever the follower is.
        if isinstance(message, Stop) and (self._side == "leader" or message.epoch in (0, self._obeyed)):
            self.ended = message.reason or "the session was ended"

    def _pass_in(self, message: Message) -> None:
        self._server.hand(self._names[type(message)], encode(message))

    def _texts(self, link: ZenohLink) -> dict[str, str]:
        delay, prefix = DELAYS[self._side]
        counts = {f"gate_{name}": count for name, count in self.counts().items()} | link_counts(self._side, link)
        own = self._process | ({"insecure": "yes"} if link.insecure else {})
        return own | fault_texts(self._arriving, delay, self._changed_ns, prefix) | as_texts(counts)
